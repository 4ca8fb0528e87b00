//! Pairs of samples, one as far to the right of a spot's centre as the other to the left, and the sums over
//! them.
//!
//! The pairs are most of the check's work, and the check is part of each row's. So [`Pairs::sums`] goes
//! over the pixels once, for both parts, and leaves a short list for the products of the [`Odd`] part: the
//! sums of both parts need more registers than the chip has. The norms of the [`Even`] part need no loop.

mod gaps;

use heapless::Vec;

pub(super) use self::gaps::Gaps;
use super::REACH;
use crate::base::{Counts, Pixels, numeric};
use crate::centre::spot_shape::COMPONENTS;
use crate::row::Light;

/// The least norm of u^4 e that is left without its parts along the other functions, over its full norm. With
/// less, k4 is only rounding: three or four pairs have too few samples for the four functions of the even
/// part.
const LEAST_NORM: f32 = 1e-5;
/// The most pairs. A sample has at least a sixth of the width, so the pitch is at least 0.166: s is below
/// 6.01 samples.
const MOST_PAIRS: usize = 37;
/// The most pixels of a sample for which 2^-16 counts are a unit in which the sums of a pair, and the level
/// under it, are below 2^31: 2 * 4 * 4095 * 2^16.
const MOST_EXACT: usize = 4;

/// What the odd part needs of a pair: z is the difference of the samples, right less left, without the error
/// of their interpolation.
#[derive(Clone, Copy)]
struct Pair {
    /// One over the variance of z.
    weight: f32,
    weighted_z: f32,
    /// The distance from the centre in widths, and u e.
    u: f32,
    ue: f32,
}

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

impl Pairs<'_> {
    /// The number of pairs up to [`REACH`], and of those that the row has: with a pixel more at either end of
    /// a sample, for the interpolation.
    fn number(&self) -> (usize, usize) {
        let Self { mirror, pixels, .. } = self;
        // The width is at most 2^15 pixels, and so the pitch 1/6 or more.
        let most = numeric::whole_usize(REACH / self.pitch).saturating_add(1);
        let right = (self.light.len()).saturating_sub(mirror.right.saturating_add(1));
        let left = mirror.left.saturating_sub(1);
        let fit = right.min(left).checked_div(*pixels).unwrap_or_default();
        (most, most.min(fit))
    }

    /// Whether all pairs up to [`REACH`] count, and are as near to each other as [`Norms::of_all`] needs.
    fn are_whole(&self) -> bool {
        let (most, number) = self.number();
        self.pitch <= FINE_PITCH && number == most && !self.gaps.exist()
    }

    /// The unit of z and p in counts: 2^-16 where that makes them whole numbers.
    pub(super) fn units_a_count(&self) -> f32 {
        if self.pixels <= MOST_EXACT && self.are_whole() {
            65536.0
        } else {
            1.0
        }
    }

    /// Sums all pairs, in [`Self::units_a_count`].
    pub(super) fn sums(&self, noise: &Noise, is_tilted: bool) -> (Odd, Even) {
        if !self.are_whole() {
            return self.sums_of_any(noise, is_tilted);
        }
        match self.pixels {
            1 => self.sums_of_whole::<1>(noise, is_tilted),
            2 => self.sums_of_whole::<2>(noise, is_tilted),
            3 => self.sums_of_whole::<3>(noise, is_tilted),
            4 => self.sums_of_whole::<4>(noise, is_tilted),
            5 => self.sums_of_whole::<5>(noise, is_tilted),
            6 => self.sums_of_whole::<6>(noise, is_tilted),
            _ => self.sums_of_any(noise, is_tilted),
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
        let offset = self.mirror.offset;
        let rise = if offset > 0.0 {
            f32::from(after) - f32::from(middle)
        } else {
            f32::from(middle) - f32::from(before)
        };
        let above = numeric::sub_i32(i32::from(middle) * (1 << Counts::FRACTION), self.level);
        Some(2.0 * (above as f32 / 256.0 + offset * rise))
    }

    /// The words of all samples to the right of the mirror and of all to the left. A sample moves by a part
    /// of a pixel from zero to one, towards the row's end. So each side has a pixel more at its end, and all
    /// lie a pixel further to the left if the centre does.
    fn sides(&self) -> Option<(&[u16], &[u16])> {
        let (words, _) = self.light.words();
        let (_, number) = self.number();
        let length = number.checked_mul(self.pixels)?;
        let back = usize::from(self.mirror.offset <= 0.0);
        let right = self.mirror.right.checked_sub(back)?;
        let left = self.mirror.left.checked_sub(back)?;
        Some((
            words.get(right..right.checked_add(length)?.checked_add(1)?)?,
            words.get(left.checked_sub(length)?..left.checked_add(1)?)?,
        ))
    }

    /// As [`Self::sums`] where all pairs count. The compiler knows the number of pixels.
    #[inline(never)]
    fn sums_of_whole<const PIXELS: usize>(&self, noise: &Noise, is_tilted: bool) -> (Odd, Even) {
        self.sums_by::<PIXELS, true, _, _>(noise, is_tilted, |right, left| {
            let (right, _) = right.as_chunks::<PIXELS>();
            let (_, left) = left.as_rchunks::<PIXELS>();
            right.iter().zip(left.iter().rev())
        })
    }

    /// As [`Self::sums`] for any number of pixels, with gaps.
    #[inline(never)]
    fn sums_of_any(&self, noise: &Noise, is_tilted: bool) -> (Odd, Even) {
        let pixels = self.pixels.max(1);
        self.sums_by::<{ usize::MAX }, false, _, _>(noise, is_tilted, |right, left| {
            right.chunks_exact(pixels).zip(left.rchunks_exact(pixels))
        })
    }

    /// `samples` takes the words of both sides apart, the samples next to the mirror first.
    #[inline(always)]
    fn sums_by<'s, const PIXELS: usize, const ARE_WHOLE: bool, S: AsRef<[u16]> + 's + ?Sized, I>(
        &'s self,
        noise: &Noise,
        is_tilted: bool,
        samples: impl FnOnce(&'s [u16], &'s [u16]) -> I,
    ) -> (Odd, Even)
    where
        I: Iterator<Item = (&'s S, &'s S)>,
    {
        let Some((right, left)) = self.sides() else {
            return Default::default();
        };
        let (Some((inner, right)), Some((end, left))) = (right.split_first(), left.split_last())
        else {
            return Default::default();
        };
        let mut ends = Ends::new(*inner, *end);
        let above = AboveLevel::new(self);
        let mut at = Steps::new(self.u, self.pitch);
        let mut pairs = Vec::<Pair, MOST_PAIRS>::new();
        let (mut odd, mut even) = (Odd::default(), Even::default());
        let mut gaps = if !ARE_WHOLE && self.gaps.exist() {
            self.places_of_gaps()
        } else {
            0
        };
        for (right, left) in samples(right, left) {
            let sums = ends.next(right.as_ref(), left.as_ref());
            let Steps { u, e, .. } = at;
            at.step();
            let is_gap = gaps & 1 == 1;
            gaps >>= 1;
            if is_gap {
                continue;
            }
            let (z, both, lit) = if PIXELS <= MOST_EXACT {
                above.exact(&sums)
            } else {
                above.of(&sums)
            };
            even.add::<ARE_WHOLE>(both, u, e);
            if pairs.push(noise.pair(&mut odd, z, lit, u, e)).is_err() {
                break;
            }
        }
        if ARE_WHOLE {
            even.norms = Norms::of_all(self.u, self.pitch, pairs.len());
        }
        odd.add_products(&pairs);
        if is_tilted {
            return (Odd::without(odd.slope(), &mut pairs), even);
        }
        (odd, even)
    }
}

impl Noise {
    /// A pair, whose square it adds.
    #[inline(always)]
    fn pair(&self, odd: &mut Odd, z: f32, lit: f32, u: f32, e: f32) -> Pair {
        let z = z + self.correction.at(u, e);
        let weight = 1.0 / (self.dark + self.shot * lit);
        let weighted_z = weight * z;
        odd.add_square(weighted_z * z);
        Pair {
            weight,
            weighted_z,
            u,
            ue: u * e,
        }
    }
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
    /// The part of a pixel by which the samples of [`Pairs::sides`] move, and the same in 2^-16 pixels, both
    /// with the sign.
    part: f32,
    part_bits: i32,
    /// The level under a pair, less its full scale where words fall with light: in 2^-16 counts, and as
    /// counts and a part of a count.
    level_bits: i32,
    level: i32,
    level_rest: f32,
}

impl AboveLevel {
    fn new(pairs: &Pairs<'_>) -> Self {
        let offset = pairs.mirror.offset;
        let part = if offset > 0.0 { offset } else { 1.0 + offset };
        let (_, inverted) = pairs.light.words();
        let sign: i16 = if inverted == 0 { 1 } else { -1 };
        let part = part * f32::from(sign);
        // At most 2^12 pixels of 12 bits.
        let pixels = 2 * numeric::to_i32(pairs.pixels.min(1 << 12));
        let full_scale = pixels.wrapping_mul(inverted.into());
        let level_bits = pixels.wrapping_mul(pairs.level).wrapping_mul(1 << 8);
        let level = pixels.wrapping_mul(pairs.level >> Counts::FRACTION);
        Self {
            sign: sign.into(),
            part,
            // Exact: a centre has 16 bits after the binary point.
            part_bits: numeric::whole_i32(part * 65536.0),
            // Used for at most `MOST_EXACT` pixels.
            level_bits: level_bits.wrapping_sub(full_scale.wrapping_mul(1 << 16)),
            level: level.wrapping_sub(full_scale),
            level_rest: pixels.wrapping_mul(pairs.level & 0xFF) as f32 / 256.0,
        }
    }

    /// The difference of a pair, its sum above the level, and the same without what is below the level. In
    /// 2^-16 counts: for samples of at most [`MOST_EXACT`] pixels. The samples lie between sums of their
    /// pixels and the next ones, so only intermediate results wrap.
    #[inline(always)]
    fn exact(&self, sums: &Sums) -> (f32, f32, f32) {
        let between = |sum: i32, rise: i32| {
            (sum.wrapping_mul(self.sign.wrapping_mul(1 << 16)))
                .wrapping_add(self.part_bits.wrapping_mul(rise))
        };
        let difference = between(sums.difference, sums.rise_of_difference);
        let both = between(sums.both, sums.rise_of_both).wrapping_sub(self.level_bits);
        let lit = both & !(both >> 31);
        (difference as f32, both as f32, lit as f32)
    }

    /// As [`Self::exact`] in counts, for any number of pixels. Subtracts the level in whole numbers and then
    /// its rest, so a constant on the row changes no bit.
    #[inline(always)]
    fn of(&self, sums: &Sums) -> (f32, f32, f32) {
        let difference = self.sign.wrapping_mul(sums.difference) as f32
            + self.part * sums.rise_of_difference as f32;
        let both = (self.sign.wrapping_mul(sums.both)).wrapping_sub(self.level) as f32
            + (self.part * sums.rise_of_both as f32 - self.level_rest);
        (difference, both, if both > 0.0 { both } else { 0.0 })
    }
}

/// A sum of counts, below 2^12 pixels of 12 bits.
#[inline(always)]
fn sum(first: i32, rest: &[u16]) -> i32 {
    rest.iter()
        .fold(first, |sum, &count| numeric::add_i32(sum, count.into()))
}

/// u and e = exp(-u^2/2) of one pair after the other.
#[derive(Clone, Copy)]
struct Steps {
    u: f32,
    e: f32,
    /// As in the fit of a spot: each step multiplies e by `ratio`, and `ratio` by `falls`.
    ratio: f32,
    falls: f32,
    pitch: f32,
}

impl Steps {
    fn new(u: f32, pitch: f32) -> Self {
        Self {
            u,
            e: libm::expf(-0.5 * u * u),
            ratio: libm::expf(-pitch * (u + 0.5 * pitch)),
            falls: libm::expf(-pitch * pitch),
            pitch,
        }
    }

    #[inline(always)]
    fn step(&mut self) {
        self.u += self.pitch;
        self.e *= self.ratio;
        self.ratio *= self.falls;
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
    pub(super) offset: f32,
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
            offset: Pixels::from_bits(offset).to_f32(),
        }
    }
}

/// Corrects z for the error of linear interpolation of a gaussian: add [`Correction::at`] to z.
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

    #[inline(always)]
    fn at(&self, u: f32, e: f32) -> f32 {
        let uu = u * u;
        u * e * (self.c0 + uu * (self.c1 + uu * self.c2))
    }
}

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

    #[inline(always)]
    fn add(&mut self, e: f32, e1: f32, e2: f32) {
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
    /// Adds a pair, and its norms unless [`Norms::of_all`] sums these.
    #[inline(always)]
    fn add<const ARE_WHOLE: bool>(&mut self, p: f32, u: f32, e: f32) {
        let uu = u * u;
        let e1 = uu * e;
        let e2 = uu * e1;
        if !ARE_WHOLE {
            self.norms.add(e, e1, e2);
        }
        self.p += p;
        self.p0 += p * e;
        self.p1 += p * e1;
        self.p2 += p * e2;
        self.squares += p * p;
    }

    pub(super) fn add_middle(&mut self, p: f32) {
        self.add::<false>(p, 0.0, 1.0);
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

/// Sums of the odd part, weighted: products of u e, u^3 e, u^5 e, u^7 e and u with each other and with z. The
/// product of u^j e and u^k e depends on j + k alone: `m1` is that of u e with itself, `m7` of u^7 e with
/// itself. `t1` is the product of u with u e.
#[derive(Default)]
pub(super) struct Odd {
    pub(super) m1: f32,
    m2: f32,
    m3: f32,
    m4: f32,
    m5: f32,
    m6: f32,
    m7: f32,
    tt: f32,
    t1: f32,
    t3: f32,
    t5: f32,
    t7: f32,
    z1: f32,
    z3: f32,
    z5: f32,
    z7: f32,
    zt: f32,
    pub(super) squares: f32,
    pub(super) worst: f32,
}

impl Odd {
    /// Adds a pair's w z^2.
    #[inline(always)]
    fn add_square(&mut self, square: f32) {
        self.squares += square;
        if square > self.worst {
            self.worst = square;
        }
    }

    #[inline(always)]
    fn add_products(&mut self, pairs: &[Pair]) {
        for pair in pairs {
            self.add(*pair);
        }
    }

    /// Subtracts a slope from z, and sums the pairs again.
    #[cold]
    #[inline(never)]
    fn without(slope: f32, pairs: &mut [Pair]) -> Self {
        let mut odd = Self::default();
        for pair in &mut *pairs {
            let z = pair.weighted_z / pair.weight - slope * pair.u;
            pair.weighted_z = pair.weight * z;
            odd.add_square(pair.weighted_z * z);
        }
        odd.add_products(pairs);
        odd
    }

    /// The slope of the tilt, in units of z for each u.
    fn slope(&self) -> f32 {
        (self.zt - self.t1 / self.m1 * self.z1) / (self.tt - self.t1 * self.t1 / self.m1)
    }

    /// The product of u^j e and u^k e depends on j + k alone, so each sum takes the product of a function and
    /// of another that has the weight already.
    #[inline(always)]
    fn add(&mut self, pair: Pair) {
        let Pair {
            weight,
            weighted_z: wz,
            u,
            ue: f1,
        } = pair;
        let uu = u * u;
        let f3 = f1 * uu;
        let f5 = f3 * uu;
        let f7 = f5 * uu;
        let (w1, w7, wu) = (weight * f1, weight * f7, weight * u);
        self.m1 += w1 * f1;
        self.m2 += w1 * f3;
        self.m3 += w1 * f5;
        self.m4 += w1 * f7;
        self.m5 += w7 * f3;
        self.m6 += w7 * f5;
        self.m7 += w7 * f7;
        self.tt += wu * u;
        self.t1 += wu * f1;
        self.t3 += wu * f3;
        self.t5 += wu * f5;
        self.t7 += wu * f7;
        self.z1 += wz * f1;
        self.z3 += wz * f3;
        self.z5 += wz * f5;
        self.z7 += wz * f7;
        self.zt += wz * u;
    }

    /// The components along u e, u, u^3 e, u^5 e and u^7 e, each less its parts along those before, in
    /// standard deviations. By Cholesky's method: if A = L L^T are the functions' products, the components
    /// are L^-1 z. Zero for a function that only rounding tells from those before.
    pub(super) fn components(&self) -> [f32; COMPONENTS] {
        let inverse_root = |pivot: f32, element: f32| {
            if pivot > LEAST_NORM * element {
                1.0 / dual_mac::square_root(pivot)
            } else {
                0.0
            }
        };
        let p1 = inverse_root(self.m1, 0.0);
        let (t1, l31, l51, l71) = (self.t1 * p1, self.m2 * p1, self.m3 * p1, self.m4 * p1);
        let y1 = self.z1 * p1;
        let pt = inverse_root(self.tt - t1 * t1, self.tt);
        let l3t = (self.t3 - l31 * t1) * pt;
        let l5t = (self.t5 - l51 * t1) * pt;
        let l7t = (self.t7 - l71 * t1) * pt;
        let yt = (self.zt - t1 * y1) * pt;
        let p3 = inverse_root(self.m3 - l31 * l31 - l3t * l3t, self.m3);
        let l53 = (self.m4 - l51 * l31 - l5t * l3t) * p3;
        let l73 = (self.m5 - l71 * l31 - l7t * l3t) * p3;
        let y3 = (self.z3 - l31 * y1 - l3t * yt) * p3;
        let p5 = inverse_root(self.m5 - l51 * l51 - l5t * l5t - l53 * l53, self.m5);
        let l75 = (self.m6 - l71 * l51 - l7t * l5t - l73 * l53) * p5;
        let y5 = (self.z5 - l51 * y1 - l5t * yt - l53 * y3) * p5;
        let rest = self.m7 - l71 * l71 - l7t * l7t - l73 * l73 - l75 * l75;
        let p7 = inverse_root(rest, self.m7);
        let y7 = (self.z7 - l71 * y1 - l7t * yt - l73 * y3 - l75 * y5) * p7;
        [y1, yt, y3, y5, y7]
    }
}

#[cfg(test)]
mod tests;
