//! Pairs of samples, one as far to the right of a spot's centre as the other to the left, and the sums over
//! them.
//!
//! The pairs are most of the check's work, and the check is part of each row's. So [`Pairs::sums`] is in
//! integers, and goes over the pixels once, or twice if z is very large. It sums the [`Even`] part at once.
//! For the [`Odd`] part it writes a table of six columns with 16 bits. The chip multiplies these two at a
//! time.
//!
//! | number | unit | range |
//! |---|---|---|
//! | z and p | 2^-16 counts, coarser for samples of more than two pixels ([`fraction`]) | below 2^30 |
//! | u | widths, Q6.26 | 0 to 10 |
//! | u^2 | Q8.24 | 0 to 100 |
//! | e, u e, u^2 e, u^3 e, u^4 e, u^5 e, u^7 e | Q31, Q30, Q30, Q29, Q28, Q27, Q25 | below 2^31 |
//! | root of an unlit pair's variance over the pair's | Q30 | 0 to 1, see [`root_of_weight`] |
//! | columns u e, u, u^3 e, u^5 e, u^7 e, times this root | Q14, Q10, Q13, Q11, Q9 | below 2^14 |
//! | column z, times this root | 2^-7 standard deviations ([`DEVIATION`]) | up to [`LARGEST`] |
//!
//! The products of a column with itself are below 2^31 for all pitches, so that those of two columns are too.
//! The tests compare all of it with sums in f64.

mod gaps;

use dual_mac::{SixPairs, upper_product};

pub(super) use self::gaps::Gaps;
use super::REACH;
use crate::base::numeric::exp_of_minus;
use crate::base::{Counts, Pixels, numeric};
use crate::centre::spot_shape::COMPONENTS;
use crate::row::Light;

/// The most pairs. A sample has at least a sixth of the width, so the pitch is at least 0.166: s is below
/// 6.01 samples.
const MOST_PAIRS: usize = 37;
/// A standard deviation of z in its column.
const DEVIATION: i32 = 1 << 7;
/// The largest z in its column, 59 standard deviations: the sum of the squares of [`MOST_PAIRS`] such numbers
/// is below 2^31. Where z is larger, its column gets another unit.
const LARGEST: i32 = 7600;
/// Bits after the point of z and p: as many as leave 2 * pixels * 4095 counts, which both are below, under
/// 2^30. The interpolation needs no more than 16 bits.
const fn fraction(pixels: usize) -> u32 {
    // A sample has at most 2^12 pixels.
    match pixels.saturating_sub(1).checked_ilog2() {
        // One pixel and two.
        None => 16,
        Some(log2) => 16u32.saturating_sub(log2),
    }
}

const _: () = {
    let most = LARGEST as i64 + 1;
    assert!(MOST_PAIRS as i64 * most * most < 1 << 31);
    let mut pixels = 1;
    while pixels <= 1 << 12 {
        assert!((2 * pixels as u64 * 4095) << fraction(pixels) <= 1 << 30);
        pixels += 1;
    }
};

/// The pairs of a row, as far as its ends and [`REACH`] allow.
pub(super) struct Pairs<'a> {
    pub(super) light: Light<'a>,
    pub(super) mirror: Place,
    /// Pixels in a sample.
    pub(super) pixels: usize,
    /// The first pair's distance from the centre, and the distance between pairs, in widths.
    pub(super) u: f32,
    pub(super) pitch: f32,
    /// The background's level, Q24.8.
    pub(super) level: i32,
    pub(super) gaps: Gaps<'a>,
}

/// How z becomes a deviation, in [`Pairs::units_a_count`].
pub(super) struct Noise {
    pub(super) correction: Correction,
    /// The variance of an unlit pair.
    pub(super) dark: f32,
    /// The variance of the shot noise for each unit of light.
    pub(super) shot: f32,
}

/// A pair's z and p: the difference of the samples, right less left, and their sum above the level.
#[derive(Clone, Copy, Default)]
struct Pair {
    z: i32,
    p: i32,
}

/// [`Noise`] in integers.
struct Scale {
    correction: [i32; 3],
    /// By how many bits the correction is smaller.
    correction_shift: u32,
    /// The shot noise's variance for each unit of light, over that of an unlit pair: times 2^32 [`UNLIT`].
    /// Saturates if the noise is below 0.25 counts, where quantisation alone has 0.29.
    shot: i32,
    /// What makes z, times its pair's root, a number of its column: 2^34 `deviation` over the standard
    /// deviation of an unlit pair. Saturates for samples of 1000 pixels, which leave no three pairs.
    z: i32,
    /// A standard deviation in z's column: [`DEVIATION`], or less where z would be above [`LARGEST`].
    deviation: f32,
}

impl Scale {
    fn of(noise: &Noise, pitch: f32, deviation: f32) -> Self {
        const POWER: f32 = (1u64 << 34) as f32;
        let per_root = deviation / dual_mac::square_root(noise.dark);
        let shot = noise.shot / noise.dark * ((1u64 << 32) as f32 * UNLIT as f32);
        let (correction, correction_shift) = noise.correction.coefficients(REACH + pitch);
        Self {
            correction,
            correction_shift,
            shot: numeric::whole_i32(shot),
            z: numeric::whole_i32(per_root * POWER),
            deviation,
        }
    }

    /// The columns of a pair's functions, in the upper halves of the numbers, and that of z. Adds the pair to
    /// the even part.
    #[inline(always)]
    fn columns(&self, pair: Pair, at: Steps, sums: &mut EvenSums) -> ([i32; COMPONENTS], i32) {
        let Pair { z, p } = pair;
        let Steps { u, e, .. } = at;
        let square = at.square();
        sums.add(p, &at, square);
        // Not negative.
        let variance = UNLIT.wrapping_add(upper_product(p.max(0), self.shot).cast_unsigned());
        // Q30.
        let root = root_of_weight(variance);
        let f1 = upper_product(upper_product(e, root), u).wrapping_mul(1 << 7);
        let f3 = upper_product(f1, square).wrapping_mul(1 << 7);
        let f5 = upper_product(f3, square).wrapping_mul(1 << 6);
        let f7 = upper_product(f5, square).wrapping_mul(1 << 6);
        let [c0, c1, c2] = self.correction;
        // See `Correction::coefficients`.
        let c1 = upper_product(c2, square).wrapping_add(c1);
        let c0 = upper_product(c1.wrapping_mul(1 << 8), square).wrapping_add(c0);
        let correction = upper_product(c0, f1).wrapping_shl(self.correction_shift);
        let z = upper_product(z, root).wrapping_add(correction);
        let t = upper_product(u, root).wrapping_mul(1 << 2);
        ([f1, t, f3, f5, f7], upper_product(z, self.z))
    }
}

impl Pairs<'_> {
    /// The number of pairs up to [`REACH`], and of those that the row has: with a pixel more at either end of
    /// a sample, for the interpolation.
    fn number(&self) -> (usize, usize) {
        let Self { mirror, pixels, .. } = self;
        // The pitch is at least 0.166: see `MOST_PAIRS`.
        let most = numeric::whole_usize(REACH / self.pitch).saturating_add(1);
        let right = (self.light.len()).saturating_sub(mirror.right.saturating_add(1));
        let left = mirror.left.saturating_sub(1);
        let fit = right.min(left).checked_div(*pixels).unwrap_or_default();
        (most, most.min(fit))
    }

    fn have_gaps(&self) -> bool {
        self.gaps.saturation.is_some() || self.gaps.masked.samples != 0
    }

    /// Whether all pairs up to [`REACH`] count, and are as near to each other as [`Norms::of_all`] needs.
    fn are_whole(&self) -> bool {
        let (most, number) = self.number();
        self.pitch <= FINE_PITCH && number == most && !self.have_gaps()
    }

    /// The units of z and p in a count.
    pub(super) fn units_a_count(&self) -> f32 {
        1u32.wrapping_shl(fraction(self.pixels)) as f32
    }

    /// Sums all pairs, in [`Self::units_a_count`]. If the row is tilted, z is without the tilt's slope.
    pub(super) fn sums(&self, noise: &Noise, is_tilted: bool) -> (Odd, Even) {
        let gaps = if self.have_gaps() {
            self.places_of_gaps()
        } else {
            0
        };
        let number = self.number().1.min(MOST_PAIRS);
        let mut table = [SixPairs::default(); MOST_PAIRS.div_ceil(2)];
        let table = table.get_mut(..number.div_ceil(2)).unwrap_or_default();
        let (mut scale, at) = (
            Scale::of(noise, self.pitch, DEVIATION as f32),
            Steps::new(self.u, self.pitch),
        );
        self.list(number, gaps, table);
        let (mut largest, mut sums) = tabulate(at, &scale, table);
        if largest > LARGEST {
            // Rare, so the pairs have no coarser column from the start.
            let coarser = scale.deviation * LARGEST as f32 / (largest as f32 + 1.0);
            scale = Scale::of(noise, self.pitch, coarser);
            self.list(number, gaps, table);
            (largest, sums) = tabulate(at, &scale, table);
        }
        if number % 2 == 1 {
            leave_out(table, number);
        }
        let norms = if self.are_whole() {
            Norms::of_all(self.u, self.pitch, number)
        } else {
            // A pair that does not count still has its correction.
            places(gaps).for_each(|place| leave_out(table, place));
            largest = largest_z(table);
            norms(at, number, gaps)
        };
        let mut odd = Odd::of(table, largest, scale.deviation);
        if is_tilted {
            odd = odd.without_slope(table);
        }
        (odd, sums.even(norms))
    }

    /// Writes z and p of all pairs into the first four columns of the table, those of gaps as zeros.
    fn list(&self, number: usize, gaps: u64, table: &mut [SixPairs]) {
        match self.pixels {
            1 => self.list_of::<1>(number, table),
            2 => self.list_of::<2>(number, table),
            3 => self.list_of::<3>(number, table),
            4 => self.list_of::<4>(number, table),
            5 => self.list_of::<5>(number, table),
            6 => self.list_of::<6>(number, table),
            _ => self.list_any(number, table),
        }
        for place in places(gaps) {
            if let Some(row) = table.get_mut(place / 2) {
                let z = place % 2 * 2;
                (row.0[z], row.0[z + 1]) = (0, 0);
            }
        }
    }

    /// The light of the pixel in the mirror's middle, twice, in counts: it is its own image.
    pub(super) fn middle(&self) -> Option<f32> {
        if self.pixels != 1 || self.mirror.to_right != 1.0 {
            return None;
        }
        let middle = self.mirror.right.checked_sub(1)?;
        let near = middle.checked_sub(1)?..middle.saturating_add(2);
        if !self.gaps.leave(self.light, near.clone()) {
            return None;
        }
        let at = |pixel: usize| self.light.get(pixel);
        let (before, after) = (at(near.start)?, at(middle.saturating_add(1))?);
        let middle = at(middle)?;
        let offset = self.mirror.offset.to_f32();
        let rise = if offset > 0.0 {
            f32::from(after) - f32::from(middle)
        } else {
            f32::from(middle) - f32::from(before)
        };
        let above = numeric::sub_i32(i32::from(middle) * (1 << Counts::FRACTION), self.level);
        Some(2.0 * (above as f32 / 256.0 + offset * rise))
    }

    /// The words of so many samples to the right of the mirror and to the left. A sample moves by a part
    /// of a pixel from zero to one, towards the row's end. So each side has a pixel more at its end, and all
    /// lie a pixel further to the left if the centre does.
    fn sides(&self, number: usize) -> Option<(&[u16], &[u16])> {
        let (words, _) = self.light.words();
        let length = number.checked_mul(self.pixels)?;
        let back = usize::from(self.mirror.offset <= Pixels::default());
        let right = self.mirror.right.checked_sub(back)?;
        let left = self.mirror.left.checked_sub(back)?;
        Some((
            words.get(right..right.checked_add(length)?.checked_add(1)?)?,
            words.get(left.checked_sub(length)?..left.checked_add(1)?)?,
        ))
    }

    /// Writes all pairs. The compiler knows the number of pixels.
    #[inline(never)]
    fn list_of<const PIXELS: usize>(&self, number: usize, table: &mut [SixPairs]) {
        self.list_by::<PIXELS, _, _>(number, table, |right, left| {
            let (right, _) = right.as_chunks::<PIXELS>();
            let (_, left) = left.as_rchunks::<PIXELS>();
            right.iter().zip(left.iter().rev())
        });
    }

    /// As [`Self::list_of`] for any number of pixels.
    #[inline(never)]
    fn list_any(&self, number: usize, table: &mut [SixPairs]) {
        let pixels = self.pixels.max(1);
        self.list_by::<0, _, _>(number, table, |right, left| {
            right.chunks_exact(pixels).zip(left.rchunks_exact(pixels))
        });
    }

    /// `PIXELS` is the number of pixels in a sample, or zero for any number. `samples` takes the words of
    /// both sides apart, the samples next to the mirror first.
    #[inline(always)]
    fn list_by<'s, const PIXELS: usize, S: AsRef<[u16]> + 's + ?Sized, I>(
        &'s self,
        number: usize,
        table: &mut [SixPairs],
        samples: impl FnOnce(&'s [u16], &'s [u16]) -> I,
    ) where
        I: Iterator<Item = (&'s S, &'s S)>,
    {
        let Some((right, left)) = self.sides(number) else {
            return;
        };
        let (Some((inner, right)), Some((end, left))) = (right.split_first(), left.split_last())
        else {
            return;
        };
        let mut ends = Ends::new(*inner, *end);
        let above = AboveLevel::new(self, if PIXELS == 0 { self.pixels } else { PIXELS });
        let mut samples = samples(right, left);
        for row in table {
            let [one, other] = [(); 2].map(|()| {
                let Some((right, left)) = samples.next() else {
                    return Pair::default();
                };
                above.of(&ends.next(right.as_ref(), left.as_ref()))
            });
            let numbers = [one.z, one.p, other.z, other.p, 0, 0];
            row.0 = numbers.map(i32::cast_unsigned);
        }
    }
}

/// Writes the table of the odd part over z and p. Returns the largest z in its column, without sign, and the
/// even part without its norms.
#[inline(never)]
fn tabulate(mut at: Steps, scale: &Scale, table: &mut [SixPairs]) -> (i32, EvenSums) {
    let (mut largest, mut sums) = (0, EvenSums::default());
    for row in table {
        let [z, p, other_z, other_p, ..] = row.0.map(u32::cast_signed);
        let two = [
            Pair { z, p },
            Pair {
                z: other_z,
                p: other_p,
            },
        ];
        let [(one, z), (other, other_z)] = two.map(|pair| {
            let columns = scale.columns(pair, at, &mut sums);
            at.step();
            largest = largest.max(columns.1 ^ (columns.1 >> 31));
            columns
        });
        let [f1, t, f3, f5, f7, zs] = &mut row.0;
        let functions = [f1, t, f3, f5, f7]
            .into_iter()
            .zip(one.into_iter().zip(other));
        for (column, (one, other)) in functions {
            *column = pair(one >> 16, other >> 16);
        }
        *zs = pair(z, other_z);
    }
    (largest, sums)
}

/// The norms of the even part over the pairs that count.
#[cold]
#[inline(never)]
fn norms(mut at: Steps, number: usize, mut gaps: u64) -> Norms {
    let mut norms = Norms::default();
    for _ in 0..number {
        if gaps & 1 == 0 {
            norms.add(&at);
        }
        gaps >>= 1;
        at.step();
    }
    norms
}

/// The largest z in its column, without sign.
#[cold]
fn largest_z(table: &[SixPairs]) -> i32 {
    let z = table.iter().flat_map(|row| halves(row.0[COMPONENTS]));
    z.fold(0, |largest, z| largest.max(z.abs()))
}

/// The places of the bits of a number, the lowest first.
fn places(mut number: u64) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        let place = number.trailing_zeros();
        // Clears the lowest bit.
        number &= number.checked_sub(1)?;
        usize::try_from(place).ok()
    })
}

/// Clears a pair's functions and its z.
fn leave_out(table: &mut [SixPairs], place: usize) {
    let others = [!0xffff, 0xffff][place % 2];
    if let Some(row) = table.get_mut(place / 2) {
        row.0 = row.0.map(|pair| pair & others);
    }
}

/// The lower 16 bits of two numbers of a column.
#[inline(always)]
fn pair(one: i32, other: i32) -> u32 {
    one.cast_unsigned() & 0xffff | other.cast_unsigned().wrapping_shl(16)
}

/// The numbers of a [`pair`].
fn halves(pair: u32) -> [i32; 2] {
    let pair = pair.cast_signed();
    [pair.wrapping_mul(1 << 16) >> 16, pair >> 16]
}

/// The pixels that two neighbouring samples share: the first of the next sample to the right, and the one
/// behind the next sample to the left.
struct Ends {
    right: i32,
    left: i32,
}

/// The sums of the pixels of a pair, right less left and right plus left, and how they rise with the part of
/// a pixel by which the samples move.
#[derive(Default)]
struct Sums {
    difference: i32,
    both: i32,
    rise_of_difference: i32,
    rise_of_both: i32,
}

impl Ends {
    fn new(right: u16, left: u16) -> Self {
        Self {
            right: right.into(),
            left: left.into(),
        }
    }

    /// The next pair. `right` has the pixels from the second of the sample on to the one behind it.
    #[inline(always)]
    fn next(&mut self, right: &[u16], left: &[u16]) -> Sums {
        let (Some((behind, right)), Some((first, left))) = (right.split_last(), left.split_first())
        else {
            return Sums::default();
        };
        let (behind, first) = (i32::from(*behind), i32::from(*first));
        let rise_right = behind.wrapping_sub(self.right);
        let rise_left = self.left.wrapping_sub(first);
        let (right, left) = (sum(self.right, right), sum(first, left));
        *self = Self {
            right: behind,
            left: first,
        };
        Sums {
            difference: right.wrapping_sub(left),
            both: right.wrapping_add(left),
            rise_of_difference: rise_right.wrapping_sub(rise_left),
            rise_of_both: rise_right.wrapping_add(rise_left),
        }
    }
}

/// How sums of words become light above the level. Where words fall with light, a count is full scale less a
/// word: the sums change their sign.
struct AboveLevel {
    /// One, or minus one where words fall with light.
    sign: i32,
    /// The part of a pixel by which the samples of [`Pairs::sides`] move, Q16, with the sign.
    part: i32,
    /// The level under a pair, less its full scale where words fall with light.
    level: i32,
    /// Bits after the point of z and p.
    fraction: u32,
}

impl AboveLevel {
    #[inline(always)]
    fn new(pairs: &Pairs<'_>, pixels: usize) -> Self {
        // Within a quarter of a pixel: the part is above zero, and at most one pixel.
        let offset = pairs.mirror.offset.to_bits();
        let part = if offset > 0 {
            offset
        } else {
            offset.wrapping_add(1 << Pixels::FRACTION)
        };
        let (_, inverted) = pairs.light.words();
        let sign = if inverted == 0 { 1 } else { -1 };
        let fraction = fraction(pixels);
        // At most 2^13 pixels with a level of 12 bits, Q24.8, and below 2^30 in its unit.
        let pixels = 2 * numeric::to_i32(pixels.min(1 << 12));
        let level = i64::from(pixels).wrapping_mul(pairs.level.into());
        let level = level.wrapping_mul(1i64.wrapping_shl(fraction)) >> Counts::FRACTION;
        let full_scale = pixels.wrapping_mul(inverted.into());
        Self {
            sign,
            part: sign.wrapping_mul(part),
            level: numeric::i64_to_i32(level).wrapping_sub(full_scale.wrapping_shl(fraction)),
            fraction,
        }
    }

    /// The difference of a pair, and its sum above the level: below 2^30 in all steps, and the interpolation
    /// below 2^29, so nothing wraps. A constant on the row changes no bit.
    #[inline(always)]
    fn of(&self, sums: &Sums) -> Pair {
        let between = |sum: i32, rise: i32| {
            (sum.wrapping_mul(self.sign).wrapping_shl(self.fraction)).wrapping_add(
                self.part
                    .wrapping_mul(rise)
                    .wrapping_shr(16u32.wrapping_sub(self.fraction)),
            )
        };
        let both = between(sums.both, sums.rise_of_both);
        Pair {
            z: between(sums.difference, sums.rise_of_difference),
            p: both.wrapping_sub(self.level),
        }
    }
}

/// A sum of counts, below 2^12 pixels of 12 bits.
#[inline(always)]
fn sum(first: i32, rest: &[u16]) -> i32 {
    rest.iter()
        .fold(first, |sum, &count| numeric::add_i32(sum, count.into()))
}

/// u, Q26, and e = exp(-u^2/2), Q31, of one pair after the other.
#[derive(Clone, Copy)]
struct Steps {
    u: i32,
    e: i32,
    /// As in the fit of a spot: each step multiplies e by `ratio`, and `ratio` by `falls`.
    ratio: i32,
    falls: i32,
    pitch: i32,
}

impl Steps {
    fn new(u: f32, pitch: f32) -> Self {
        let q26 = |u: f32| numeric::whole_i32(u * (1 << 26) as f32);
        let (u, pitch) = (q26(u), q26(pitch));
        // Half a product: it has 52 bits after the point, and 26 after the shift. Read with 27, it is half. A
        // spot that is wider than 0.3 pixels has none above 16.
        let half = |a: i32, b: i32| {
            let product = i64::from(a).wrapping_mul(b.into()) >> 26;
            exp_of_minus(numeric::i64_to_i32(product.min(i32::MAX.into())))
        };
        let both = u.wrapping_mul(2).wrapping_add(pitch);
        Self {
            u,
            e: half(u, u),
            ratio: half(pitch, both),
            falls: half(pitch, pitch.wrapping_mul(2)),
            pitch,
        }
    }

    /// u^2, Q24.
    #[inline(always)]
    fn square(&self) -> i32 {
        upper_product(self.u, self.u).wrapping_mul(1 << 4)
    }

    /// u^2 e, Q30, and u^4 e, Q28.
    #[inline(always)]
    fn even(&self, square: i32) -> (i32, i32) {
        let e1 = upper_product(self.e, square).wrapping_mul(1 << 7);
        (e1, upper_product(e1, square).wrapping_mul(1 << 6))
    }

    #[inline(always)]
    fn step(&mut self) {
        self.u = self.u.wrapping_add(self.pitch);
        self.e = upper_product(self.e, self.ratio).wrapping_mul(2);
        self.ratio = upper_product(self.ratio, self.falls).wrapping_mul(2);
    }
}

/// The place about which the row is mirrored.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// The mirror's right side begins with this pixel. At least 1.
    right: usize,
    /// The mirror's left side has so many pixels.
    left: usize,
    /// From that place to pixel `right`: half a pixel or one.
    pub(super) to_right: f32,
    /// From that place to the centre: within a quarter of a pixel.
    pub(super) offset: Pixels,
}

impl Place {
    /// Takes the nearest middle or end of a pixel. A place before the row has no pixels to its left.
    pub(super) fn of(centre: Pixels) -> Self {
        const HALF_LOG2: u32 = Pixels::FRACTION - 1;
        let halves = centre.to_bits().saturating_add(1 << (HALF_LOG2 - 1)) >> HALF_LOG2;
        // Within 2^14 of zero.
        let offset = (centre.to_bits()).wrapping_sub(halves.wrapping_mul(1 << HALF_LOG2));
        let halves = usize::try_from(halves).unwrap_or_default();
        let right = (halves / 2).wrapping_add(1);
        Self {
            right,
            left: halves.div_ceil(2),
            to_right: right as f32 - 0.5 * halves as f32,
            offset: Pixels::from_bits(offset),
        }
    }
}

/// Corrects z for the error of linear interpolation of a gaussian: add u e (c0 + c1 u^2 + c2 u^4) to z.
///
/// Interpolation by a part t of a pixel adds t (1-t) ((1-t)^(n-1) - t^(n-1)) / n! times the nth derivative to
/// a function that is even about the centre, with the sign of t, for n = 3 and 5. The derivatives of a
/// gaussian are e (3 u - u^3) / s^3 and e (10 u^3 - 15 u - u^5) / s^5.
#[derive(Clone, Copy)]
pub(super) struct Correction {
    pub(super) third: f32,
    c0: f32,
    c1: f32,
    c2: f32,
}

impl Correction {
    pub(super) fn of(offset: f32, per_s: f32, height: f32) -> Self {
        let d = offset.abs();
        let t = 1.0 - d;
        let (dd, tt, per_s2) = (d * d, t * t, per_s * per_s);
        let scale = 2.0 * offset * t * height * per_s * per_s2;
        let third = scale * (tt - dd) / 6.0;
        let fifth = scale * per_s2 * (tt * tt - dd * dd) / 120.0;
        Self {
            third,
            c0: 15.0 * fifth - 3.0 * third,
            c1: third - 10.0 * fifth,
            c2: fifth,
        }
    }

    /// The coefficients of 1, u^2 and u^4 in units of z, and by how many bits they are smaller so that all
    /// products have room up to a distance. The last one is 2^8 times as large, as the product with u^2, Q24,
    /// makes up for.
    fn coefficients(&self, furthest: f32) -> ([i32; 3], u32) {
        let square = furthest * furthest;
        let most = self.c0.abs() + square * (self.c1.abs() + square * self.c2.abs());
        // The sum of all is below 2^27 then, so c1 * 2^8 is below 2^30: the distance is at least 6.
        let log2 = (most.to_bits() >> 23).saturating_sub(127);
        // No light of 12 bits needs more: more is left out, so that nothing wraps.
        let shift = log2.saturating_sub(26).min(6);
        let most_left = (1u64 << 33) as f32;
        let unit = if most > most_left {
            most_left / most
        } else {
            1.0
        };
        let unit = unit / 1u32.wrapping_shl(shift) as f32;
        let [c0, c1, c2] =
            [self.c0, self.c1, 256.0 * self.c2].map(|it| numeric::whole_i32(it * unit));
        ([c0, c1, c2], shift)
    }
}

/// A variance with the unit that [`root_of_weight`] takes: that of a pair without light. It lies in the
/// middle of its entry, so the root of an unlit pair's weight is exact.
const UNLIT: u32 = 4096 + 32;

/// 2^16 over the root of a variance, in units of [`UNLIT`]. The place of an entry is the highest eight bits
/// of a variance with 18 leading zeros: places below 64 are not used.
static ROOTS: [u16; 256] = roots();

#[expect(clippy::cast_possible_truncation, reason = "the root is below 2^16")]
const fn roots() -> [u16; 256] {
    let mut roots = [u16::MAX; 256];
    let mut bits = 65;
    while bits < 256 {
        // The middle of the entry is bits + 1/2, and that of UNLIT's entry 64 + 1/2. Below 2^16.
        let square = (129u64 << 32) / (2 * bits as u64 + 1);
        roots[bits] = square.isqrt() as u16;
        bits += 1;
    }
    roots
}

/// The root of one over a variance, which is at least [`UNLIT`] / 1.008 and below 2^31: Q30, one for `UNLIT`,
/// to 0.4 %.
#[inline(always)]
fn root_of_weight(variance: u32) -> i32 {
    // An even number of leading zeros, at most 18: so many as the variance of an unlit pair has.
    let zeros = variance.leading_zeros() & !1;
    let [.., highest] = variance.wrapping_shl(zeros).to_le_bytes();
    let root = i32::from(ROOTS[usize::from(highest)]);
    // Below 2^16 * 2^9 * 2^5.
    root.wrapping_shl(zeros >> 1).wrapping_mul(1 << 5)
}

/// The least norm of u^4 e that is left without its parts along the other functions, over its full norm. With
/// less, k4 is only rounding: three or four pairs have too few samples for the four functions.
const LEAST_NORM: f32 = 1e-5;

/// Sums of the even part: those of the functions alone, and the products of 1, e, u^2 e and u^4 e with p.
#[derive(Default)]
pub(super) struct Even {
    pub(super) norms: Norms,
    pub(super) p: f32,
    p0: f32,
    p1: f32,
    p2: f32,
    squares: f32,
}

/// The number of samples, and the sums of u^k e (`l`) and of u^k e^2 (`m`) over them, for even k. They depend
/// on the distances of the samples alone.
#[derive(Clone, Copy, Default)]
pub(super) struct Norms {
    pub(super) samples: f32,
    l0: f32,
    l1: f32,
    l2: f32,
    pub(super) m0: f32,
    m1: f32,
    m2: f32,
    m3: f32,
    m4: f32,
}

/// Up to this distance between pairs, the sums over all pairs are integrals, to a few parts in a million.
const FINE_PITCH: f32 = 0.5;

impl Norms {
    /// The sums over all `number` pairs up to [`REACH`] widths, the first at `u`, without a loop.
    ///
    /// The sum of a function over u, u + h, u + 2h ... follows from its integral, after Euler and Maclaurin.
    /// If the function is even, the integral from zero is I, and f, f2, f4 ... are its value and derivatives
    /// at zero, the sum is I/h - B1(x) f - B3(x)/3! h^2 f2 - B5(x)/5! h^4 f4 ..., with x = u/h and
    /// Bernoulli's polynomials B. Less than a millionth of a sum lies beyond the reach.
    fn of_all(u: f32, pitch: f32, number: usize) -> Self {
        // Integrals from zero, without their common factor: of u^k e over sqrt(pi/2), of u^k e^2 over
        // sqrt(pi)/2.
        const GAUSSIAN: f32 = 1.253_314_1;
        const SQUARED: f32 = 0.886_226_9;
        let per_pitch = 1.0 / pitch;
        let x = u * per_pitch;
        // From the middle of the range, where the polynomials are zero.
        let y = x - 0.5;
        let (yy, hh) = (y * y, pitch * pitch);
        // B1 = y, B3 = y (y^2 - 1/4), B5 = B3 (y^2 - 7/12), B7 = B3 (y^4 - 3/2 y^2 + 31/48).
        let b3 = y * (yy - 0.25);
        let h2 = hh * b3 * (1.0 / 6.0);
        let h4 = hh * hh * b3 * (yy - 7.0 / 12.0) * (1.0 / 120.0);
        let h6 = hh * hh * hh * b3 * (yy * (yy - 1.5) + 31.0 / 48.0) * (1.0 / 5040.0);
        let (e, ee) = (GAUSSIAN * per_pitch, SQUARED * per_pitch);
        Self {
            samples: number as f32,
            l0: e - y + h2 - 3.0 * h4 + 15.0 * h6,
            l1: e - 2.0 * h2 + 12.0 * h4 - 90.0 * h6,
            l2: 3.0 * e - 24.0 * h4 + 360.0 * h6,
            m0: ee - y + 2.0 * h2 - 12.0 * h4 + 120.0 * h6,
            m1: 0.5 * ee - 2.0 * h2 + 24.0 * h4 - 360.0 * h6,
            m2: 0.75 * ee - 24.0 * h4 + 720.0 * h6,
            m3: 1.875 * ee - 720.0 * h6,
            m4: 6.5625 * ee,
        }
    }

    fn add(&mut self, at: &Steps) {
        let (e1, e2) = at.even(at.square());
        let e = at.e as f32 * (1.0 / (1u32 << 31) as f32);
        let e1 = e1 as f32 * (1.0 / (1 << 30) as f32);
        let e2 = e2 as f32 * (1.0 / (1 << 28) as f32);
        self.samples += 1.0;
        self.l0 += e;
        self.l1 += e1;
        self.l2 += e2;
        self.m0 += e * e;
        self.m1 += e * e1;
        self.m2 += e1 * e1;
        self.m3 += e1 * e2;
        self.m4 += e2 * e2;
    }
}

pub(super) struct Shape {
    /// The coefficient of u^2 e over that of e: how much wider the light is than the spot.
    pub(super) wider: f32,
    /// The coefficient of u^4 e, and the norm of the part that u^4 e shares with no other function. `None` if
    /// rounding is all of it.
    pub(super) k4: Option<(f32, f32)>,
    /// The sum of squares that the fit without k4 leaves.
    pub(super) rest: f32,
}

impl Even {
    /// The middle has u = 0 and e = 1.
    pub(super) fn add_middle(&mut self, p: f32) {
        self.norms.samples += 1.0;
        self.norms.l0 += 1.0;
        self.norms.m0 += 1.0;
        self.p += p;
        self.p0 += p;
        self.squares += p * p;
    }

    /// Subtracts from each function in turn its parts along those before.
    pub(super) fn solve(&self) -> Shape {
        let norms = &self.norms;
        let samples = norms.samples;
        let (l0, l1, l2, p) = (
            norms.l0 / samples,
            norms.l1 / samples,
            norms.l2 / samples,
            self.p / samples,
        );
        let c00 = norms.m0 - l0 * norms.l0;
        let c01 = norms.m1 - l0 * norms.l1;
        let c02 = norms.m2 - l0 * norms.l2;
        let p0 = self.p0 - p * norms.l0;
        let (f1, f2) = (c01 / c00, c02 / c00);
        let c11 = norms.m2 - l1 * norms.l1 - f1 * c01;
        let c12 = norms.m3 - l1 * norms.l2 - f1 * c02;
        let p1 = self.p1 - p * norms.l1 - f1 * p0;
        let f = c12 / c11;
        let norm = norms.m4 - l2 * norms.l2 - f2 * c02 - f * c12;
        let p2 = self.p2 - p * norms.l2 - f2 * p0 - f * p1;
        let (second, first) = (p1 / c11, p0 / c00);
        Shape {
            // p0 has the part of u^2 e along e.
            wider: second / (first - f1 * second),
            k4: (norm > LEAST_NORM * norms.m4).then(|| (p2 / norm, norm)),
            rest: self.squares - p * self.p - p0 * p0 / c00 - p1 * p1 / c11,
        }
    }
}

/// Products of p with the even functions, in integers: p / 4 is below 2^28, and the sums of the functions, of
/// at most [`MOST_PAIRS`] pairs with a pitch of a sixth or more, are at most 8 (e), 8 (u^2 e) and 23 (u^4 e).
/// So no sum exceeds 2^31, and that of the squares is below 2^62.
#[derive(Default)]
struct EvenSums {
    /// Of p in 2^6 units, and of its products with the functions in 2^3, 2^4 and 2^6 units.
    p: i32,
    p0: i32,
    p1: i32,
    p2: i32,
    squares: i64,
}

impl EvenSums {
    #[inline(always)]
    fn add(&mut self, p: i32, at: &Steps, square: i32) {
        let p = p >> 2;
        let (e1, e2) = at.even(square);
        self.p = self.p.wrapping_add(p >> 4);
        self.p0 = self.p0.wrapping_add(upper_product(p, at.e));
        self.p1 = self.p1.wrapping_add(upper_product(p, e1));
        self.p2 = self.p2.wrapping_add(upper_product(p, e2));
        self.squares = (self.squares).wrapping_add(i64::from(p).wrapping_mul(p.into()));
    }

    fn even(&self, norms: Norms) -> Even {
        Even {
            norms,
            p: 64.0 * self.p as f32,
            p0: 8.0 * self.p0 as f32,
            p1: 16.0 * self.p1 as f32,
            p2: 64.0 * self.p2 as f32,
            squares: 16.0 * self.squares as f32,
        }
    }
}

/// The least norm of a column that is left without its parts along those before, over its full norm. With
/// less it is only rounding.
const LEAST_NORM_OF_COLUMN: f32 = 1e-4;

/// The products of the columns of u e, u, u^3 e, u^5 e, u^7 e and z with each other.
#[derive(Default)]
pub(super) struct Odd {
    /// The lower triangle, in the columns' units.
    products: [f32; 21],
    /// The largest z, without sign.
    largest: i32,
    /// A standard deviation in z's column.
    deviation: f32,
}

impl Odd {
    #[inline(always)]
    fn of(table: &[SixPairs], largest: i32, deviation: f32) -> Self {
        Self {
            products: dual_mac::gram(table).map(|sum| sum as f32),
            largest,
            deviation,
        }
    }

    /// The products after the slope of a tilt is subtracted from z.
    #[cold]
    #[inline(never)]
    fn without_slope(&self, table: &mut [SixPairs]) -> Self {
        let [m11, mt1, mtt, .., z1, zt, _, _, _, _] = self.products;
        // That of the tilt without its part along the shift.
        let slope = (zt - mt1 / m11 * z1) / (mtt - mt1 * mt1 / m11);
        let mut largest = 0;
        for row in &mut *table {
            let [_, t, _, _, _, z] = &mut row.0;
            let [one, other] = [0, 1].map(|half| {
                let (t, z) = (halves(*t)[half], halves(*z)[half]);
                let rest = numeric::whole_i32(z as f32 - slope * t as f32);
                rest.clamp(-LARGEST, LARGEST)
            });
            largest = largest.max(one.abs()).max(other.abs());
            *z = pair(one, other);
        }
        Self::of(table, largest, self.deviation)
    }

    /// The sum of (u e)^2 over the pairs, weighted as if an unlit pair had the weight one.
    pub(super) fn norm_of_shift(&self) -> f32 {
        let [norm, ..] = self.products;
        norm * (1.0 / (1 << 28) as f32)
    }

    /// The square of the worst pair's deviation, in variances.
    pub(super) fn worst(&self) -> f32 {
        numeric::square(self.largest as f32 / self.deviation)
    }

    /// The sum of the squares of all pairs' deviations, in variances.
    pub(super) fn squares(&self) -> f32 {
        let [.., squares] = self.products;
        squares / numeric::square(self.deviation)
    }

    /// The components along u e, u, u^3 e, u^5 e and u^7 e, each less its parts along those before, in
    /// standard deviations. By Cholesky's method: if A = L L^T are the functions' products, the components
    /// are L^-1 z. Zero for a function that only rounding tells from those before.
    pub(super) fn components(&self) -> [f32; COMPONENTS] {
        let inverse_root = |pivot: f32, element: f32| {
            if pivot > LEAST_NORM_OF_COLUMN * element {
                1.0 / dual_mac::square_root(pivot)
            } else {
                0.0
            }
        };
        let [m11, mt1, mtt, m31, m3t, m33, m51, m5t, m53, m55, ..] = self.products;
        let [.., m71, m7t, m73, m75, m77, z1, zt, z3, z5, z7, _] = self.products;
        let p1 = inverse_root(m11, 0.0);
        let (t1, l31, l51, l71) = (mt1 * p1, m31 * p1, m51 * p1, m71 * p1);
        let y1 = z1 * p1;
        let pt = inverse_root(mtt - t1 * t1, mtt);
        let l3t = (m3t - l31 * t1) * pt;
        let l5t = (m5t - l51 * t1) * pt;
        let l7t = (m7t - l71 * t1) * pt;
        let yt = (zt - t1 * y1) * pt;
        let p3 = inverse_root(m33 - l31 * l31 - l3t * l3t, m33);
        let l53 = (m53 - l51 * l31 - l5t * l3t) * p3;
        let l73 = (m73 - l71 * l31 - l7t * l3t) * p3;
        let y3 = (z3 - l31 * y1 - l3t * yt) * p3;
        let p5 = inverse_root(m55 - l51 * l51 - l5t * l5t - l53 * l53, m55);
        let l75 = (m75 - l71 * l51 - l7t * l5t - l73 * l53) * p5;
        let y5 = (z5 - l51 * y1 - l5t * yt - l53 * y3) * p5;
        let rest = m77 - l71 * l71 - l7t * l7t - l73 * l73 - l75 * l75;
        let p7 = inverse_root(rest, m77);
        let y7 = (z7 - l71 * y1 - l7t * yt - l73 * y3 - l75 * y5) * p7;
        let per_deviation = 1.0 / self.deviation;
        [y1, yt, y3, y5, y7].map(|component| component * per_deviation)
    }
}

#[cfg(test)]
mod tests;
