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
//! | e, u e, u^2 e, u^3 e, u^4 e, u^5 e, u^7 e | Q31, Q30, Q30, Q29, Q28, Q27, Q24 | below 2^31 |
//! | root of an unlit pair's variance over the pair's | Q30 | 0 to 1, see [`root_of_weight`] |
//! | columns u e, u, u^3 e, u^5 e, u^7 e, times this root | Q14, Q10, Q13, Q11, Q8 | below 2^14 |
//! | column z, times this root | standard deviations, Q7, coarser where needed | up to [`LARGEST`] |
//!
//! The products of a column with itself are below 2^30 for all pitches, so that those of two columns are too.
//! The tests compare all of it with sums in f64.

mod gaps;

use dual_mac::{SixPairs, add_upper_product, upper_product};

pub(super) use self::gaps::Gaps;
use super::REACH;
use crate::base::numeric::{ROOTS, exp_of_minus, inverse_root, product, shifted, shifted_32};
use crate::base::{Counts, Pixels, numeric};
use crate::centre::spot_shape::COMPONENTS;
use crate::row::Light;

/// The most pairs. A sample has at least a sixth of the width, so the pitch is at least 0.166: s is below
/// 6.01 samples.
pub(super) const MOST_PAIRS: usize = 37;
/// The largest z in its column, 41 standard deviations: the sum of the squares of [`MOST_PAIRS`] such numbers
/// is below 2^30. Where z is larger, its column has fewer bits after the point.
const LARGEST: i32 = 5300;
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
    assert!(MOST_PAIRS as i64 * most * most < 1 << 30);
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
    /// The distance between pairs in widths, Q6.26, and one over it, Q8.24.
    pub(super) pitch: i32,
    pub(super) per_pitch: i32,
    /// The background's level, Q24.8.
    pub(super) level: i32,
    pub(super) gaps: Gaps<'a>,
}

/// How z becomes a deviation, in units of z.
pub(super) struct Noise {
    /// For samples of one pixel. With larger samples the spot is so wide that interpolation adds at most 2e-4
    /// of its height, a twentieth of a deviation.
    pub(super) correction: Option<Correction>,
    /// One over the root of the variance of an unlit pair over 2^64: see [`inverse_root`].
    pub(super) per_root: (i32, u32),
    /// The variance of the shot noise for each count of light, in counts squared, Q0.16.
    pub(super) shot: u16,
}

/// A pair's z and p: the difference of the samples, right less left, and their sum above the level.
#[derive(Clone, Copy, Default)]
struct Pair {
    z: i32,
    p: i32,
}

/// [`Noise`] for the columns.
struct Scale {
    correction: Option<Correction>,
    /// The shot noise's variance for each unit of light, over that of an unlit pair: times 2^32 [`UNLIT`].
    /// Saturates if the noise is below 0.25 counts, where quantisation alone has 0.29.
    shot: i32,
    /// What makes z, times its pair's root, a number of its column: 2^34 standard deviations, in the column's
    /// unit, over that of an unlit pair. Saturates for samples of 1000 pixels, which leave no three pairs.
    z: i32,
    /// Half a step of z's column, in units of z: added before the product, it rounds z to the nearest step.
    half: i32,
}

impl Scale {
    /// z's column has so many bits fewer after the point.
    fn of(noise: &Noise, fraction: u32, coarser: i32) -> Self {
        // 2^(16 + fraction) over the variance, which is above 2^(6 + fraction).
        let (inverse, doublings) = numeric::inverse(noise.per_root);
        let by = 76i32
            .wrapping_sub(fraction.cast_signed())
            .wrapping_sub(doublings);
        let shot = i64::from(UNLIT.wrapping_mul(noise.shot.into())).wrapping_mul(inverse.into());
        // 2^(34 + 7) times the root's 2^-29 and 2^-32.
        let (root, halvings) = noise.per_root;
        let more = halvings
            .cast_signed()
            .wrapping_sub(20)
            .wrapping_sub(coarser);
        let z = shifted_32(root, more).max(1);
        Self {
            correction: noise.correction,
            shot: numeric::saturated(shifted(shot, by.wrapping_neg())),
            z,
            half: i32::MAX / z,
        }
    }

    /// The columns of a pair's functions, in the upper halves of the numbers, and that of z. Adds the pair to
    /// the even part.
    #[inline(always)]
    fn columns(
        &self,
        pair: Pair,
        at: Steps,
        correction: Option<&Correction>,
        sums: &mut EvenSums,
    ) -> ([i32; COMPONENTS], i32) {
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
        let f7 = upper_product(f5, square).wrapping_mul(1 << 5);
        let mut z = upper_product(z, root);
        if let Some(correction) = correction {
            let Correction { c0, c1, c2, .. } = *correction;
            let c1 = add_upper_product(c1, c2, square);
            let c0 = add_upper_product(c0, c1.wrapping_mul(1 << 8), square);
            let product = upper_product(c0, f1);
            z = z.wrapping_add(product.wrapping_shl(correction.coarser));
        }
        let t = upper_product(u, root).wrapping_mul(1 << 2);
        (
            [f1, t, f3, f5, f7],
            upper_product(z.wrapping_add(self.half), self.z),
        )
    }
}

impl Pairs<'_> {
    /// The number of pairs up to [`REACH`], and of those that the row has: with a pixel more at either end of
    /// a sample, for the interpolation.
    fn number(&self) -> (usize, usize) {
        let Self { mirror, pixels, .. } = self;
        // Q24, and below 37.
        let most = self.per_pitch.wrapping_mul(REACH) >> 24;
        let most = usize::try_from(most).unwrap_or_default().saturating_add(1);
        let right = (self.light.len()).saturating_sub(mirror.right.saturating_add(1));
        let left = mirror.left.saturating_sub(1);
        let fit = right.min(left).checked_div(*pixels).unwrap_or_default();
        (most, most.min(fit))
    }

    /// The first pair's distance from the centre in widths, Q6.26: half a sample, and half a pixel if the
    /// mirror is in a pixel's middle.
    fn first(&self) -> i32 {
        let pixels = if self.mirror.is_in_a_pixel {
            numeric::to_i32(self.pixels)
        } else {
            i32::MAX
        };
        let pixel = self.pitch.checked_div(pixels).unwrap_or_default();
        self.pitch.wrapping_add(pixel) / 2
    }

    fn have_gaps(&self) -> bool {
        self.gaps.saturation.is_some() || self.gaps.masked.samples != 0
    }

    /// Whether all pairs up to [`REACH`] count, and are as near to each other as [`Norms::of_all`] needs.
    fn are_whole(&self) -> bool {
        let (most, number) = self.number();
        self.pitch <= FINE_PITCH && number == most && !self.have_gaps()
    }

    /// The bits after the point of z and p in counts.
    pub(super) const fn fraction(&self) -> u32 {
        fraction(self.pixels)
    }

    /// Sums all pairs. If the row is tilted, z is without the tilt's slope.
    pub(super) fn sums(&self, noise: &Noise, is_tilted: bool) -> (Odd, Even) {
        let gaps = if self.have_gaps() {
            self.places_of_gaps()
        } else {
            0
        };
        let number = self.number().1.min(MOST_PAIRS);
        let rows = number.div_ceil(2);
        let mut listed = [[Pair::default(); 2]; MOST_PAIRS.div_ceil(2)];
        let listed = listed.get_mut(..rows).unwrap_or_default();
        let mut table = [SixPairs::default(); MOST_PAIRS.div_ceil(2)];
        let table = table.get_mut(..rows).unwrap_or_default();
        self.list(number, gaps, listed.as_flattened_mut());
        let at = Steps::new(self.first(), self.pitch);
        let sum = |listed: &[[Pair; 2]], table: &mut _| self.sum(noise, at, gaps, listed, table);
        let (mut odd, sums) = sum(listed, table);
        if is_tilted {
            // A slope from a coarse column is only near: the rest has a finer one.
            for _ in 0..2 {
                let scale = Scale::of(noise, self.fraction(), odd.coarser);
                odd.subtract_slope(&scale, at, listed.as_flattened_mut());
                let is_fine = odd.coarser < 4;
                (odd, _) = sum(listed, table);
                if is_fine {
                    break;
                }
            }
        }
        let norms = if self.are_whole() {
            Norms::of_all(self, number)
        } else {
            norms(at, number, gaps)
        };
        (odd, Even { norms, sums })
    }

    /// Sums the pairs that were listed.
    fn sum(
        &self,
        noise: &Noise,
        at: Steps,
        gaps: u64,
        listed: &[[Pair; 2]],
        table: &mut [SixPairs],
    ) -> (Odd, EvenSums) {
        let mut tabulate = |coarser| {
            let scale = Scale::of(noise, self.fraction(), coarser);
            tabulate(at, &scale, listed, table)
        };
        let (mut largest, sums) = tabulate(0);
        let mut coarser = 0;
        if largest > LARGEST {
            // Rare, so the pairs have no coarser column from the start.
            let times = (largest / LARGEST).leading_zeros();
            coarser = 32i32.wrapping_sub(times.cast_signed());
            (largest, _) = tabulate(coarser);
        }
        let number = self.number().1.min(MOST_PAIRS);
        if number % 2 == 1 {
            leave_out(table, number);
        }
        if !self.are_whole() {
            // A pair that does not count still has its correction.
            places(gaps).for_each(|place| leave_out(table, place));
            largest = largest_z(table);
        }
        (Odd::of(table, largest, coarser), sums)
    }

    /// Writes z and p of all pairs, those of gaps as zeros.
    fn list(&self, number: usize, gaps: u64, pairs: &mut [Pair]) {
        match self.pixels {
            1 => self.list_of::<1>(number, pairs),
            2 => self.list_of::<2>(number, pairs),
            3 => self.list_of::<3>(number, pairs),
            4 => self.list_of::<4>(number, pairs),
            5 => self.list_of::<5>(number, pairs),
            6 => self.list_of::<6>(number, pairs),
            _ => self.list_any(number, pairs),
        }
        for place in places(gaps) {
            if let Some(pair) = pairs.get_mut(place) {
                *pair = Pair::default();
            }
        }
    }

    /// The light of the pixel in the mirror's middle, twice, as a p: it is its own image.
    pub(super) fn middle(&self) -> Option<i32> {
        if self.pixels != 1 || !self.mirror.is_in_a_pixel {
            return None;
        }
        let middle = self.mirror.right.checked_sub(1)?;
        let near = middle.checked_sub(1)?..middle.saturating_add(2);
        if !self.gaps.leave(self.light, near.clone()) {
            return None;
        }
        let at = |pixel: usize| self.light.get(pixel).map(i32::from);
        let (before, middle, after) = (at(near.start)?, at(middle)?, at(middle.saturating_add(1))?);
        let offset = self.mirror.offset.to_bits();
        let (from, to) = if offset > 0 {
            (middle, after)
        } else {
            (before, middle)
        };
        // With 16 bits after the point: below 2^28, and the rise times a quarter of a pixel below 2^26.
        let above = middle
            .wrapping_mul(1 << Counts::FRACTION)
            .wrapping_sub(self.level);
        let rise = offset.wrapping_mul(to.wrapping_sub(from));
        Some(
            above
                .wrapping_mul(1 << 8)
                .wrapping_add(rise)
                .wrapping_mul(2),
        )
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
    fn list_of<const PIXELS: usize>(&self, number: usize, pairs: &mut [Pair]) {
        self.list_by::<PIXELS, _, _>(number, pairs, |right, left| {
            let (right, _) = right.as_chunks::<PIXELS>();
            let (_, left) = left.as_rchunks::<PIXELS>();
            right.iter().zip(left.iter().rev())
        });
    }

    /// As [`Self::list_of`] for any number of pixels.
    #[inline(never)]
    fn list_any(&self, number: usize, pairs: &mut [Pair]) {
        let pixels = self.pixels.max(1);
        self.list_by::<0, _, _>(number, pairs, |right, left| {
            right.chunks_exact(pixels).zip(left.rchunks_exact(pixels))
        });
    }

    /// `PIXELS` is the number of pixels in a sample, or zero for any number. `samples` takes the words of
    /// both sides apart, the samples next to the mirror first.
    #[inline(always)]
    fn list_by<'s, const PIXELS: usize, S: AsRef<[u16]> + 's + ?Sized, I>(
        &'s self,
        number: usize,
        pairs: &mut [Pair],
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
        for (pair, (right, left)) in pairs.iter_mut().zip(samples(right, left)) {
            *pair = above.of(&ends.next(right.as_ref(), left.as_ref()));
        }
    }
}

/// Writes the table of the odd part. Returns the largest z in its column, without sign, and the even part
/// without its norms.
fn tabulate(
    at: Steps,
    scale: &Scale,
    pairs: &[[Pair; 2]],
    table: &mut [SixPairs],
) -> (i32, EvenSums) {
    match &scale.correction {
        None => tabulate_with(at, scale, None, pairs, table),
        correction => tabulate_with(at, scale, correction.as_ref(), pairs, table),
    }
}

/// As [`tabulate`], with or without a correction: the compiler knows which.
#[inline(always)]
fn tabulate_with(
    mut at: Steps,
    scale: &Scale,
    correction: Option<&Correction>,
    pairs: &[[Pair; 2]],
    table: &mut [SixPairs],
) -> (i32, EvenSums) {
    let (mut largest, mut sums) = (0, EvenSums::default());
    for (row, &[pair_before, pair_after]) in table.iter_mut().zip(pairs) {
        let (one, z) = scale.columns(pair_before, at, correction, &mut sums);
        at.step();
        let (other, other_z) = scale.columns(pair_after, at, correction, &mut sums);
        at.step();
        largest = largest.max(z ^ (z >> 31)).max(other_z ^ (other_z >> 31));
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
#[derive(Clone, Copy, Default)]
struct Steps {
    u: i32,
    e: i32,
    /// As in the fit of a spot: each step multiplies e by `ratio`, and `ratio` by `falls`.
    ratio: i32,
    falls: i32,
    pitch: i32,
}

impl Steps {
    fn new(u: i32, pitch: i32) -> Self {
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
    /// Whether that place is the middle of a pixel.
    pub(super) is_in_a_pixel: bool,
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
        Self {
            right: (halves / 2).wrapping_add(1),
            left: halves.div_ceil(2),
            is_in_a_pixel: halves.is_multiple_of(2),
            offset: Pixels::from_bits(offset),
        }
    }
}

/// Corrects z for the error of linear interpolation of a gaussian: add u e (c0 + c1 u^2 + c2 u^4) to z.
///
/// Interpolation by a part t of a pixel adds t (1-t) ((1-t)^(n-1) - t^(n-1)) / n! times the nth derivative to
/// a function that is even about the centre, with the sign of t, for n = 3 and 5. The derivatives of a
/// gaussian are e (3 u - u^3) / s^3 and e (10 u^3 - 15 u - u^5) / s^5.
///
/// The unit of c0 and c1 is 2^`coarser` units of z. That of c2 is 2^8 times smaller: its product with u^2,
/// Q24, is then in the unit of c1.
#[derive(Clone, Copy)]
pub(super) struct Correction {
    /// The factor of the third derivative, in units of z.
    pub(super) third: i32,
    c0: i32,
    c1: i32,
    c2: i32,
    coarser: u32,
}

impl Correction {
    /// `per_s` is pixels in widths, Q6.26, and `height` that of the spot in units of z.
    pub(super) fn of(offset: Pixels, per_s: i32, height: i32) -> Self {
        // Of spots that are narrower than the check trusts the correction would be larger.
        let per_s = per_s.min(5 << 24);
        // 2^14 counts. A fit of the flanks may claim more: then less is corrected.
        let height = height.min(1 << 30);
        let offset = offset.to_bits();
        // At most a quarter of a pixel, Q16.
        let d = offset.wrapping_abs();
        // Twice t (1-t), Q32, times (1-t)^2 - t^2 = 1 - 2 t, Q31: Q31, at most 0.2.
        let twice = offset.wrapping_mul(0x2_0000i32.wrapping_sub(d.wrapping_mul(2)));
        let rest = 0x1_0000i32
            .wrapping_sub(d.wrapping_mul(2))
            .wrapping_mul(1 << 15);
        let of_height = upper_product(upper_product(twice, rest), height);
        // Q-1 becomes Q0 with a sixth.
        let sixth = of_height / 3;
        // Q29.
        let per_s = per_s.wrapping_mul(1 << 3);
        let times = |a: i32, b: i32| upper_product(a.wrapping_mul(1 << 3), b);
        let third = times(times(times(sixth, per_s), per_s), per_s);
        // (1-t)^4 - t^4 is (1 - 2 t) (1 - 2 t (1-t)), Q29.
        let less = (1i32 << 29).wrapping_sub(twice.wrapping_abs() >> 3);
        let fifth = times(times(times(third, per_s), per_s), less) / 20;
        // All sums up to eight widths have room: for s from 3, `third` is below 2^21, c1 + c2 u^2 below 2^22,
        // and the whole below 2^28. For narrower spots `third` is below 2^27, and all have six bits less.
        let coarser = if per_s > (1 << 29) / 3 { 6 } else { 0 };
        let half = 1i32.wrapping_shl(coarser) / 2;
        let rounded = |value: i32| value.wrapping_add(half).wrapping_shr(coarser);
        Self {
            coarser,
            third,
            c0: rounded(fifth.wrapping_mul(15).wrapping_sub(third.wrapping_mul(3))),
            c1: rounded(third.wrapping_sub(fifth.wrapping_mul(10))),
            c2: rounded(fifth.wrapping_mul(1 << 8)),
        }
    }
}

/// A variance with the unit that [`root_of_weight`] takes: that of a pair without light. It lies in the
/// middle of its entry, so the root of an unlit pair's weight is exact.
const UNLIT: u32 = 4096 + 32;

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

/// The norms of the functions 1, e, u^2 e and u^4 e, and their products with each other, over the samples:
/// the sums of u^k e (`l`) and of u^k e^2 (`m`) for even k. They depend on the distances of the samples
/// alone. Q24, below 2^30.
#[derive(Clone, Copy, Default)]
struct Norms {
    /// The number of samples.
    samples: i32,
    l0: i32,
    l1: i32,
    l2: i32,
    m0: i32,
    m1: i32,
    m2: i32,
    m3: i32,
    m4: i32,
}

/// Up to this distance between pairs, Q6.26, the sums over all pairs are integrals, to a few parts in a
/// million.
const FINE_PITCH: i32 = 1 << 25;

impl Norms {
    /// The sums over all `number` pairs up to [`REACH`] widths, without a loop.
    ///
    /// The sum of a function over u, u + h, u + 2h ... follows from its integral, after Euler and Maclaurin.
    /// If the function is even, the integral from zero is I, and f, f2, f4 ... are its value and derivatives
    /// at zero, the sum is I/h - B1(x) f - B3(x)/3! h^2 f2 - B5(x)/5! h^4 f4 ..., with x = u/h and
    /// Bernoulli's polynomials B. Less than a millionth of a sum lies beyond the reach.
    fn of_all(pairs: &Pairs<'_>, number: usize) -> Self {
        // Integrals from zero, without their common factor: of u^k e over sqrt(pi/2), Q30, of u^k e^2 over
        // sqrt(pi)/2, Q31.
        const GAUSSIAN: i32 = 1_345_735_808;
        const SQUARED: i32 = 1_903_157_831;
        // From the middle of the range, where the polynomials are zero: 1/2 over the pixels of a sample, Q30.
        let half = (1i32 << 29).checked_div(numeric::to_i32(pairs.pixels));
        let y = half
            .filter(|_| pairs.mirror.is_in_a_pixel)
            .unwrap_or_default();
        let times = |a, b| upper_product(a, b).wrapping_mul(4);
        let (yy, pitch) = (times(y, y), pairs.pitch.wrapping_mul(1 << 4));
        let hh = times(pitch, pitch);
        // B1 = y, B3 = y (y^2 - 1/4), B5 = B3 (y^2 - 7/12).
        let b3 = times(times(y, yy.wrapping_sub(1 << 28)), hh);
        let b5 = times(times(b3, yy.wrapping_sub(626_349_397)), hh);
        // h2 to h4 have Q30, and the rest has Q24.
        let (h2, h4) = (b3 / 6, b5 / 120);
        let part = |h2: i32, h4: i32| h2.wrapping_add(h4) >> 6;
        let e = upper_product(pairs.per_pitch, GAUSSIAN).wrapping_mul(4);
        let ee = upper_product(pairs.per_pitch, SQUARED).wrapping_mul(2);
        let y = y >> 6;
        let scaled = |h2_factor: i32, h4_factor: i32| {
            part(h2.wrapping_mul(h2_factor), h4.wrapping_mul(h4_factor))
        };
        Self {
            samples: numeric::to_i32(number),
            l0: e.wrapping_sub(y).wrapping_add(scaled(1, -3)),
            l1: e.wrapping_add(scaled(-2, 12)),
            l2: e.wrapping_mul(3).wrapping_add(scaled(0, -24)),
            m0: ee.wrapping_sub(y).wrapping_add(scaled(2, -12)),
            m1: (ee / 2).wrapping_add(scaled(-2, 24)),
            m2: (ee / 4).wrapping_mul(3).wrapping_add(scaled(0, -24)),
            m3: (ee / 8).wrapping_mul(15),
            m4: (ee / 16).wrapping_mul(105),
        }
    }

    fn add(&mut self, at: &Steps) {
        let (e1, e2) = at.even(at.square());
        let terms = [
            (&mut self.samples, 1),
            (&mut self.l0, at.e >> 7),
            (&mut self.l1, e1 >> 6),
            (&mut self.l2, e2 >> 4),
            (&mut self.m0, upper_product(at.e, at.e) >> 6),
            (&mut self.m1, upper_product(at.e, e1) >> 5),
            (&mut self.m2, upper_product(e1, e1) >> 4),
            (&mut self.m3, upper_product(e1, e2) >> 2),
            (&mut self.m4, upper_product(e2, e2)),
        ];
        for (sum, term) in terms {
            *sum = sum.wrapping_add(term);
        }
    }
}

/// The even part: p as b + A e (1 + k2 u^2 + k4 u^4), by least squares.
pub(super) struct Even {
    norms: Norms,
    sums: EvenSums,
}

/// What [`Even`] says of the light. The parts of p are in units of z times 2^`unit`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shape {
    /// How much wider the light is than the spot, times 2 to the second number: the coefficient of u^2 e over
    /// that of e. `None` if the light does not tell.
    pub(super) wider: Option<(i32, i32)>,
    /// The peak of p, the coefficient of e, times 2 to the second number. Zero if the light does not tell.
    pub(super) peak: (i32, i32),
    pub(super) unit: i32,
    /// The norm of the part of u^4 e that it shares with no other function, Q15, and the part of p along it,
    /// Q15. `None` if rounding is all of it.
    pub(super) fourth: Option<(i32, i32)>,
    /// The sum of squares that the fit without u^4 e leaves of p.
    pub(super) rest: i32,
    /// The sum of e^2, Q24.
    pub(super) squares_of_e: i32,
    /// The mean of p, in units of z, and the number of samples.
    pub(super) mean: i32,
    pub(super) samples: i32,
}

impl Even {
    /// The number of samples.
    pub(super) fn number(&self) -> i32 {
        self.norms.samples
    }

    /// The middle has u = 0 and e = 1.
    pub(super) fn add_middle(&mut self, p: i32) {
        let one = Steps {
            e: i32::MAX,
            ..Steps::default()
        };
        self.norms.add(&one);
        self.sums.add(p, &one, 0);
    }

    /// Solves the normal equations.
    pub(super) fn solve(&self) -> Shape {
        /// The least norm of u^4 e that is left without its parts along the other functions, over its full
        /// norm: 2^-17. With less, k4 is only rounding: three or four pairs have too few samples for the four
        /// functions.
        const LEAST_NORM: u32 = 17;
        let Norms {
            l0,
            l1,
            l2,
            m0,
            m1,
            m2,
            m3,
            m4,
            samples,
        } = self.norms;
        if m0 < 1 << 8 {
            // No pair is within 3.3 widths: the products are rounding.
            return Shape::default();
        }
        let EvenSums {
            p,
            p0,
            p1,
            p2,
            squares,
        } = self.sums;
        // p / 4 gets so many bits fewer that the sum of its squares is below 2^30. That sum is below 2^62.
        let bits = 64u32.wrapping_sub(squares.cast_unsigned().leading_zeros());
        let fewer = (bits.saturating_sub(29) / 2).cast_signed();
        // The functions have 12 bits after the point, so that their products have 24. After Cauchy no
        // product exceeds 2^30.
        let with_p = |sum: i32, log2: i32| shifted_32(sum, log2.wrapping_sub(fewer));
        let squares = squares.wrapping_shr(2 * fewer.cast_unsigned());
        #[rustfmt::skip]
        let products = [
            // At most 38 samples.
            samples.wrapping_mul(1 << 24),
            l0, m0,
            l1, m1, m2,
            l2, m2, m3, m4,
            0, 0, 0, 0, 0,
            with_p(p, 16), with_p(p0, 13), with_p(p1, 14), with_p(p2, 16), 0, numeric::i64_to_i32(squares),
        ];
        let factors = Factors::of(&products, LEAST_NORM);
        let [_, shift1, shift2, shift3, _, shift_p] = factors.enlarged;
        let [_, l11, l22, norm, _] = factors.norms;
        let [_, y1, y2, y3, _] = factors.last;
        let (l21, rest) = (factors.third_along_second, factors.rest);
        let y3_squared = upper_product(y3, y3).wrapping_mul(4);
        // Their units differ by the columns' bits. The inverse is that of first / 2^32.
        let second = upper_product(y2, l11);
        let first = upper_product(y1, l22).wrapping_sub(upper_product(l21, y2));
        let (inverse, doublings) = numeric::inverse(inverse_root(first.unsigned_abs()));
        let ratio = upper_product(second, inverse).wrapping_mul(first.signum());
        let by = doublings
            .wrapping_sub(28)
            .wrapping_add(shift2)
            .wrapping_sub(shift1);
        let unit = shift_p.wrapping_sub(2).wrapping_sub(fewer);
        // `first` is the coefficient of the columns times the two norms, and below 2^29 without sign: here
        // the coefficient has 16 bits after the point. The column of e has 12 and those by which it was
        // enlarged.
        let norms = upper_product(l11, l22) >> 14;
        let peak = if norms > 0 {
            first.wrapping_mul(4) / norms
        } else {
            0
        };
        let norm = shifted_32(norm, shift3.wrapping_add(12).wrapping_neg());
        Shape {
            wider: (first != 0).then_some((ratio, by)),
            peak: (peak, shift1.wrapping_sub(unit).wrapping_sub(4)),
            unit,
            fourth: (norm > 0).then_some((norm, y3)),
            rest: rest.wrapping_add(y3_squared),
            squares_of_e: m0,
            // At most 2^30.
            mean: (p / samples.max(1)).wrapping_mul(64),
            samples,
        }
    }
}

/// Products of p with the even functions, in integers: p / 4 is below 2^28, and the sums of the functions, of
/// at most [`MOST_PAIRS`] pairs with a pitch of a sixth or more, are at most 8 (e), 8 (u^2 e) and 23 (u^4 e).
/// So no sum exceeds 2^31, and that of the squares is below 2^62.
#[derive(Clone, Copy, Default)]
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
        self.p0 = add_upper_product(self.p0, p, at.e);
        self.p1 = add_upper_product(self.p1, p, e1);
        self.p2 = add_upper_product(self.p2, p, e2);
        self.squares = (self.squares).wrapping_add(i64::from(p).wrapping_mul(p.into()));
    }
}

/// The odd part: the products of the columns of u e, u, u^3 e, u^5 e, u^7 e and z with each other.
pub(super) struct Odd {
    factors: Factors,
    /// The largest z, without sign.
    largest: i32,
    /// By how many bits z's column is coarser.
    coarser: i32,
}

impl Odd {
    fn of(table: &[SixPairs], largest: i32, coarser: i32) -> Self {
        /// The least norm of a column that is left without its parts along those before, over its full norm:
        /// 2^-13. With less it is only rounding.
        const LEAST_NORM: u32 = 13;
        Self {
            factors: Factors::of(&dual_mac::gram(table), LEAST_NORM),
            largest,
            coarser,
        }
    }

    /// Subtracts from each z the slope that the sums show: that of the tilt without its part along the shift.
    #[cold]
    #[inline(never)]
    fn subtract_slope(&self, scale: &Scale, mut at: Steps, pairs: &mut [Pair]) {
        let Factors {
            enlarged,
            norms,
            last,
            ..
        } = self.factors;
        let ([_, norm, ..], [_, along, ..]) = (norms, last);
        let [_, enlarged, .., enlarged_z] = enlarged;
        // In steps of z's column for one of u's, Q16, and in units of z for a width. A step of u is 2^-10
        // widths, and one of z 2^34 units over the scale.
        let by = 16i32.wrapping_add(enlarged).wrapping_sub(enlarged_z);
        let slope = shifted(along.into(), by)
            .checked_div(norm.into())
            .unwrap_or_default();
        let slope = shifted(slope, 28)
            .checked_div(scale.z.into())
            .unwrap_or_default();
        let slope = numeric::saturated(slope);
        for pair in pairs {
            // Those that do not count stay zero.
            if (pair.z, pair.p) != (0, 0) {
                // Limited, so that z stays below 2^30.
                let tilt = product(slope, at.u) >> 26;
                let rest = i64::from(pair.z).wrapping_sub(tilt);
                pair.z = numeric::i64_to_i32(rest.clamp(-(1 << 30) + 1, (1 << 30) - 1));
            }
            at.step();
        }
    }

    /// The norm of u e over the pairs, weighted as if an unlit pair had the weight one: a number, and the
    /// bits after its point.
    pub(super) fn norm_of_shift(&self) -> (i32, i32) {
        let ([norm, ..], [enlarged, ..]) = (self.factors.norms, self.factors.enlarged);
        (norm, enlarged.wrapping_add(29))
    }

    /// The worst pair's deviation, in standard deviations, Q7: limited to 2^14.
    pub(super) fn worst(&self) -> i32 {
        shifted_32(self.largest, self.coarser).min(1 << 21)
    }

    /// The components along u e, u, u^3 e, u^5 e and u^7 e, each less its parts along those before, in
    /// standard deviations, Q12. Zero for a function that only rounding tells from those before. The sum of
    /// the squares of all pairs' deviations, without the first component, in variances, Q8, times a factor,
    /// Q16.
    pub(super) fn components(&self, white: i32) -> ([i32; COMPONENTS], i64) {
        let Factors {
            enlarged,
            last,
            rest,
            ..
        } = self.factors;
        let [.., enlarged] = enlarged;
        // The numbers have Q15, and the column Q7.
        let more = self.coarser.wrapping_sub(enlarged);
        let components = last.map(|it| shifted_32(it, more.wrapping_sub(10)));
        let squares = last
            .iter()
            .skip(1)
            .map(|&it| upper_product(it, it).wrapping_mul(4));
        let squares = squares.fold(rest, i32::wrapping_add);
        let by = more.wrapping_mul(2).wrapping_sub(6 + 16);
        (components, shifted(product(squares, white), by))
    }
}

/// The product of two columns, less the products of their parts along the columns before.
#[inline(always)]
fn left<const N: usize>(product: i32, one: [i32; N], other: [i32; N]) -> i32 {
    let parts = one.into_iter().zip(other);
    let sum = parts.fold(0, |sum, (one, other)| add_upper_product(sum, one, other));
    product.wrapping_sub(sum.wrapping_mul(4))
}

/// Cholesky's factors of the products of six columns with each other, A = L L^T: of the columns with some
/// bits more, and times 2^15.
///
/// The first five columns span a space. The last row of L has the components of the last column along its
/// orthonormal directions. They are zero for a column that only rounding tells from those before.
struct Factors {
    /// By how many bits each column was enlarged, so that the sum of its squares is at least 2^28.
    enlarged: [i32; 6],
    /// The diagonal of L: the norms of the columns without their parts along those before.
    norms: [i32; 5],
    /// The element in the third row and the second column.
    third_along_second: i32,
    last: [i32; 5],
    /// The sum of squares of the part of the last column that the first five do not span.
    rest: i32,
}

impl Factors {
    /// Takes the lower triangle, one row after the other. The diagonal is below 2^30, so that no element of L
    /// exceeds 2^30 after Cauchy. Only rounding tells a column from those before if the square of what is
    /// left of it is below 2^-`least`.
    #[inline(never)]
    fn of(products: &[i32; 21], least: u32) -> Self {
        let [a00, a10, a11, a20, a21, a22, a30, a31, a32, a33, ..] = *products;
        let [.., a40, a41, a42, a43, a44, a50, a51, a52, a53, a54, a55] = *products;
        let bits = |square: i32| (square.leading_zeros() / 2).saturating_sub(1);
        let enlarged = [a00, a11, a22, a33, a44, a55].map(bits);
        let [s0, s1, s2, s3, s4, s5] = enlarged.map(|bits| 1i32.wrapping_shl(bits));
        let larger =
            |product: i32, one: i32, other: i32| product.wrapping_mul(one).wrapping_mul(other);
        let root = |whole: i32, left: i32| {
            if left > whole.wrapping_shr(least) {
                let (root, halvings) = inverse_root(left.cast_unsigned());
                (root, 4i32.wrapping_shl(halvings))
            } else {
                (0, 0)
            }
        };
        let of = |a: i32, (root, factor): (i32, i32)| upper_product(a, root).wrapping_mul(factor);
        let a00 = larger(a00, s0, s0);
        let n0 = a00;
        let r0 = root(a00, n0);
        let l10 = of(larger(a10, s1, s0), r0);
        let a11 = larger(a11, s1, s1);
        let n1 = left(a11, [l10], [l10]);
        let r1 = root(a11, n1);
        let l20 = of(larger(a20, s2, s0), r0);
        let l21 = of(left(larger(a21, s2, s1), [l20], [l10]), r1);
        let a22 = larger(a22, s2, s2);
        let n2 = left(a22, [l20, l21], [l20, l21]);
        let r2 = root(a22, n2);
        let l30 = of(larger(a30, s3, s0), r0);
        let l31 = of(left(larger(a31, s3, s1), [l30], [l10]), r1);
        let l32 = of(left(larger(a32, s3, s2), [l30, l31], [l20, l21]), r2);
        let a33 = larger(a33, s3, s3);
        let n3 = left(a33, [l30, l31, l32], [l30, l31, l32]);
        let r3 = root(a33, n3);
        let l40 = of(larger(a40, s4, s0), r0);
        let l41 = of(left(larger(a41, s4, s1), [l40], [l10]), r1);
        let l42 = of(left(larger(a42, s4, s2), [l40, l41], [l20, l21]), r2);
        let l43 = of(
            left(larger(a43, s4, s3), [l40, l41, l42], [l30, l31, l32]),
            r3,
        );
        let a44 = larger(a44, s4, s4);
        let n4 = left(a44, [l40, l41, l42, l43], [l40, l41, l42, l43]);
        let r4 = root(a44, n4);
        let l50 = of(larger(a50, s5, s0), r0);
        let l51 = of(left(larger(a51, s5, s1), [l50], [l10]), r1);
        let l52 = of(left(larger(a52, s5, s2), [l50, l51], [l20, l21]), r2);
        let l53 = of(
            left(larger(a53, s5, s3), [l50, l51, l52], [l30, l31, l32]),
            r3,
        );
        let l54 = of(
            left(
                larger(a54, s5, s4),
                [l50, l51, l52, l53],
                [l40, l41, l42, l43],
            ),
            r4,
        );
        let rest = left(
            larger(a55, s5, s5),
            [l50, l51, l52, l53, l54],
            [l50, l51, l52, l53, l54],
        );
        Self {
            enlarged: enlarged.map(u32::cast_signed),
            norms: [of(n0, r0), of(n1, r1), of(n2, r2), of(n3, r3), of(n4, r4)],
            third_along_second: l21,
            last: [l50, l51, l52, l53, l54],
            rest,
        }
    }
}

#[cfg(test)]
mod tests;
