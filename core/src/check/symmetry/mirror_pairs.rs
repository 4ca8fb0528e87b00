//! Pairs of samples, one as far to the right of a spot's centre as the other to the left.

use core::ops::Range;

use heapless::Vec;

use super::REACH;
use super::antisymmetric::Odd;
use super::symmetric::{Even, FINE_PITCH, Norms};
use crate::base::{Counts, Pixels, numeric};
use crate::centre::gauss_newton::MaskedPixels;
use crate::row::Light;

/// The most pairs. A sample has at least a sixth of the width, so the pitch is at least 0.166: s is below
/// 6.01 samples.
const MOST_PAIRS: usize = 37;
/// The most pixels of a sample for which 2^-16 counts are a unit in which the sums of a pair, and the level
/// under it, are below 2^31: 2 * 4 * 4095 * 2^16.
const MOST_EXACT: usize = 4;

/// What the odd part needs of a pair: z is the difference of the samples, right less left, without the error
/// of their interpolation.
#[derive(Clone, Copy)]
pub(super) struct Pair {
    /// One over the variance of z.
    pub(super) weight: f32,
    /// `weight` times z.
    pub(super) weighted_z: f32,
    /// The distance from the centre in widths, and u e.
    pub(super) u: f32,
    pub(super) ue: f32,
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

/// Which samples do not count.
pub(super) struct Gaps<'a> {
    /// If any pixel of the row is saturated: from which count on.
    pub(super) saturation: Option<u16>,
    pub(super) masked: &'a MaskedPixels,
}

impl Gaps<'_> {
    fn exist(&self) -> bool {
        self.saturation.is_some() || self.masked.samples != 0
    }

    /// Whether no pixel of a range is saturated or masked. `false` off the row.
    fn leave(&self, light: Light<'_>, pixels: Range<usize>) -> bool {
        let Some(counts) = light.slice(pixels.clone()) else {
            return false;
        };
        let is_cut = |saturation| counts.iter().any(|count| count >= saturation);
        let has_masked = || pixels.clone().any(|pixel| self.masked.has(pixel));
        !(self.saturation.is_some_and(is_cut) || self.masked.samples != 0 && has_masked())
    }
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
        let Some((right, left)) = self.sides() else {
            return Default::default();
        };
        let (Some((inner, right)), Some((end, left))) = (right.split_first(), left.split_last())
        else {
            return Default::default();
        };
        let (right, _) = right.as_chunks::<PIXELS>();
        let (_, left) = left.as_rchunks::<PIXELS>();
        let number = right.len().min(left.len()).min(MOST_PAIRS);
        let (Some(right), Some(left)) = (right.get(..number), left.get(..number)) else {
            return Default::default();
        };
        let mut ends = Ends::new(*inner, *end);
        let above = AboveLevel::new(self);
        let mut at = Steps::new(self.u, self.pitch);
        let mut pairs = Vec::<Pair, MOST_PAIRS>::new();
        let (mut odd, mut even) = (Odd::default(), Even::default());
        for i in 0..number {
            let mirrored = number.wrapping_sub(1).wrapping_sub(i);
            let (Some(right), Some(left)) = (right.get(i), left.get(mirrored)) else {
                break;
            };
            let sums = ends.next(right, left);
            let (z, both, lit) = if PIXELS <= MOST_EXACT {
                above.exact(&sums)
            } else {
                above.of(&sums)
            };
            let Steps { u, e, .. } = at;
            at.step();
            even.add::<false>(both, u, e);
            if pairs.push(noise.pair(&mut odd, z, lit, u, e)).is_err() {
                break;
            }
        }
        even.norms = Norms::of_all(self.u, self.pitch, number);
        odd.add_products(&pairs);
        if is_tilted {
            return (Odd::without(odd.slope(), &mut pairs), even);
        }
        (odd, even)
    }

    /// As [`Self::sums`] for any number of pixels, with gaps.
    #[inline(never)]
    fn sums_of_any(&self, noise: &Noise, is_tilted: bool) -> (Odd, Even) {
        let Some((right, left)) = self.sides() else {
            return Default::default();
        };
        let (Some((inner, right)), Some((end, left))) = (right.split_first(), left.split_last())
        else {
            return Default::default();
        };
        let pixels = self.pixels.max(1);
        let mut ends = Ends::new(*inner, *end);
        let above = AboveLevel::new(self);
        let mut at = Steps::new(self.u, self.pitch);
        let mut pairs = Vec::<Pair, MOST_PAIRS>::new();
        let (mut odd, mut even) = (Odd::default(), Even::default());
        let mut gaps = if self.gaps.exist() {
            self.places_of_gaps()
        } else {
            0
        };
        for (right, left) in right.chunks_exact(pixels).zip(left.rchunks_exact(pixels)) {
            let sums = ends.next(right, left);
            let Steps { u, e, .. } = at;
            at.step();
            let is_gap = gaps & 1 == 1;
            gaps >>= 1;
            if is_gap {
                continue;
            }
            let (z, both, lit) = above.of(&sums);
            even.add::<true>(both, u, e);
            if pairs.push(noise.pair(&mut odd, z, lit, u, e)).is_err() {
                break;
            }
        }
        odd.add_products(&pairs);
        if is_tilted {
            return (Odd::without(odd.slope(), &mut pairs), even);
        }
        (odd, even)
    }

    /// A bit for each pair, the lowest for the first: whether the pair does not count.
    #[cold]
    #[inline(never)]
    fn places_of_gaps(&self) -> u64 {
        let pixels = self.pixels.max(1);
        // Where the samples to the right start, and where those to the left end.
        let from = self.mirror.right.saturating_sub(1);
        let end = self.mirror.left;
        let mut gaps = 0u64;
        // The bits of the pairs before one.
        let below = |pair: usize| {
            1u64.wrapping_shl(numeric::to_u32(pair.min(MOST_PAIRS)))
                .wrapping_sub(1)
        };
        // A sample takes its pixels, and one at either end. How far the nearest and the furthest pixel of a
        // gap are from there tells the first and the last pair.
        let mark = |gap: Range<usize>| {
            let last = gap.end.saturating_sub(1);
            let to_right = last.checked_sub(from);
            let to_left = end.checked_sub(gap.start);
            let sides = [
                to_right.map(|furthest| (gap.start.saturating_sub(from), furthest)),
                to_left.map(|furthest| (end.saturating_sub(last), furthest)),
            ];
            for (nearest, furthest) in sides.into_iter().flatten() {
                let first = (nearest.saturating_sub(pixels.saturating_add(1))).div_ceil(pixels);
                // The pairs up to the last, without those before the first.
                let end = (furthest / pixels).saturating_add(1);
                gaps |= below(end) & !below(first);
            }
        };
        self.gaps.masked.runs().for_each(mark);
        if let Some(saturation) = self.gaps.saturation {
            let below = u32::from(saturation.saturating_sub(1));
            let is_cut = |pixels: Range<usize>| {
                let end = pixels.end.min(self.light.len());
                let near = self.light.slice(pixels.start..end);
                near.is_some_and(|near| near.exceeds(below))
            };
            // Whether some pairs side by side have a gap. A row has at most 2^12 pixels.
            let have_gap = |pairs: Range<usize>| {
                let nearest = pairs.start.wrapping_mul(pixels);
                let furthest = pairs.end.wrapping_mul(pixels).wrapping_add(1);
                let right = from.wrapping_add(nearest)..from.wrapping_add(furthest).wrapping_add(1);
                let left = end.saturating_sub(furthest)..end.saturating_sub(nearest);
                is_cut(right) || is_cut(left.start..left.end.saturating_add(1))
            };
            let number = self.number().1.min(MOST_PAIRS);
            for first in (0..number).step_by(4) {
                let four = first..first.saturating_add(4).min(number);
                if have_gap(four.clone()) {
                    for pair in four.filter(|&pair| have_gap(pair..pair.wrapping_add(1))) {
                        gaps |= 1u64.wrapping_shl(numeric::to_u32(pair));
                    }
                }
            }
        }
        gaps
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
    pub(super) right: usize,
    /// The mirror's left side has so many pixels.
    pub(super) left: usize,
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
    pub(super) fn at(&self, u: f32, e: f32) -> f32 {
        let uu = u * u;
        u * e * (self.c0 + uu * (self.c1 + uu * self.c2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::Polarity;
    use crate::tests::{bare, gaussian, hash};

    #[test]
    fn the_mirror_is_the_nearest_half_pixel() {
        for (centre, right, left, to_right, offset) in [
            (10.0, 11, 10, 1.0, 0.0),
            (10.2, 11, 10, 1.0, 0.2),
            (10.3, 11, 11, 0.5, -0.2),
            (10.5, 11, 11, 0.5, 0.0),
            (9.8, 11, 10, 1.0, -0.2),
        ] {
            let place = Place::of(Pixels::from_f32(centre));
            let found = (place.right, place.left, place.to_right);
            assert_eq!(found, (right, left, to_right), "{centre}");
            assert!((place.offset - offset).abs() < 1e-4, "{centre}");
        }
        for end in [Pixels::MIN, Pixels::MAX] {
            let place = Place::of(end);
            assert!(place.right >= 1 && place.offset.abs() <= 0.5);
        }
    }

    /// Saturated pixels, masked ones, and both; samples of all sizes, and mirrors near the row's ends.
    #[test]
    fn a_pair_with_a_gap_is_one_whose_samples_take_one() {
        let light: [u16; 300] = core::array::from_fn(|i| (hash(i) >> 24) as u16);
        for (pixels, centre) in
            (1..=7).flat_map(|pixels| [150.2, 150.7, 20.0].map(|at| (pixels, at)))
        {
            for (saturation, samples) in [
                (Some(252), 0),
                (None, 1 << 40 | 3),
                (Some(252), 1 << 90 | 1 << 5),
            ] {
                let masked = MaskedPixels {
                    first: 10,
                    block: 3,
                    samples,
                };
                let pairs = Pairs {
                    light: (&light).into(),
                    mirror: Place::of(Pixels::from_f32(centre)),
                    pixels,
                    u: 0.1,
                    pitch: 0.2,
                    level: 0,
                    gaps: Gaps {
                        saturation,
                        masked: &masked,
                    },
                };
                let found = pairs.places_of_gaps();
                let (from, end) = (pairs.mirror.right - 1, pairs.mirror.left + 1);
                for pair in 0..pairs.number().1 {
                    let right = from + pair * pixels;
                    let left = end - pair * pixels;
                    let is_gap = !(pairs.gaps.leave(pairs.light, right..right + pixels + 2)
                        && pairs.gaps.leave(pairs.light, left - pixels - 2..left));
                    assert_eq!(found >> pair & 1 == 1, is_gap, "{pixels} {centre} {pair}");
                }
            }
        }
    }

    /// A gaussian sampled at whole pixels, without noise. At a width of 0.85 pixels, interpolation makes an
    /// error in z of 5 % of the height, and the correction leaves 0.2 %.
    #[test]
    fn interpolation_leaves_no_derivatives() {
        for (width, limit) in [(0.85f32, 2.5e-3), (1.5, 5e-5), (4.0, 2e-7)] {
            let (mut worst, mut without) = (0.0f32, 0.0f32);
            for step in -25..=25 {
                let offset = step as f32 / 100.0;
                let y = |x: f32| libm::expf(-0.5 * (x - offset) * (x - offset) / (width * width));
                let correction = Correction::of(offset, 1.0 / width, 1.0);
                let next = if offset > 0.0 { 1.0 } else { -1.0 };
                let moved = |x: f32| y(x) + offset.abs() * (y(x + next) - y(x));
                for i in 1..8 {
                    let x = i as f32 * 0.5;
                    let z = moved(x) - moved(-x);
                    let u = x / width;
                    worst = worst.max((z + correction.at(u, libm::expf(-0.5 * u * u))).abs());
                    without = without.max(z.abs());
                }
            }
            println!("width {width}: {worst:.1e} of the height, {without:.1e} before");
            assert!(worst < limit && without > 2.0 * worst, "{width}");
        }
    }

    /// All sums in f64, from the definitions, with the sum of their terms' magnitudes. Counts, not
    /// [`Pairs::units_a_count`].
    fn reference(pairs: &Pairs<'_>, noise: &Noise) -> [(f64, f64); 33] {
        let light = |pixel: usize| f64::from(pairs.light.get(pixel).expect("a pixel"));
        let offset = f64::from(pairs.mirror.offset);
        let level = f64::from(pairs.level) / 256.0;
        let moved = |pixel: usize| {
            let first = if offset > 0.0 { pixel } else { pixel - 1 };
            light(pixel) + offset * (light(first + 1) - light(first)) - level
        };
        let counts = |pixels: Range<usize>| {
            let saturation = pairs.gaps.saturation.unwrap_or(u16::MAX);
            let mut pixels = pixels.start - 1..pixels.end + 1;
            pixels.all(|pixel| {
                pairs.light.get(pixel) < Some(saturation) && !pairs.gaps.masked.has(pixel)
            })
        };
        let mut sums = [(0.0, 0.0); 33];
        for i in 0.. {
            let u = f64::from(pairs.u) + f64::from(pairs.pitch) * f64::from(i);
            let from = pairs.mirror.right + i as usize * pairs.pixels;
            let to = pairs.mirror.left as i64 - i64::from(i) * pairs.pixels as i64;
            let start = to - pairs.pixels as i64;
            let last = f64::from(pairs.u) + f64::from(REACH) - f64::from(pairs.pitch * 1e-4);
            if u > last || start < 1 || from + pairs.pixels >= pairs.light.len() {
                break;
            }
            let (right, left) = (from..from + pairs.pixels, start as usize..to as usize);
            if !counts(right.clone()) || !counts(left.clone()) {
                continue;
            }
            let (right, left): (f64, f64) = (right.map(moved).sum(), left.map(moved).sum());
            let e = libm::exp(-0.5 * u * u);
            let Correction { c0, c1, c2, .. } = noise.correction;
            let [c0, c1, c2] = [c0, c1, c2].map(f64::from);
            let z = right - left + u * e * (c0 + u * u * (c1 + u * u * c2));
            let p = right + left;
            let w = 1.0 / (f64::from(noise.dark) + f64::from(noise.shot) * p.max(0.0));
            let f = |power: i32| libm::pow(u, power.into()) * e;
            let mut terms = [0.0; 33];
            for (k, term) in terms[..7].iter_mut().enumerate() {
                *term = w * f(1) * f(1 + 2 * k as i32);
            }
            terms[7] = w * u * u;
            for (k, power) in [1, 3, 5, 7].into_iter().enumerate() {
                terms[8 + k] = w * u * f(power);
                terms[12 + k] = w * z * f(power);
            }
            terms[16] = w * z * u;
            terms[17] = w * z * z;
            let [e0, e1, e2] = [f(0), f(2), f(4)];
            let (alone, squares) = (
                [1.0, e0, e1, e2],
                [e0 * e0, e0 * e1, e0 * e2, e1 * e2, e2 * e2],
            );
            terms[19..23].copy_from_slice(&alone);
            terms[23..28].copy_from_slice(&squares);
            terms[28..].copy_from_slice(&[p, p * e0, p * e1, p * e2, p * p]);
            // z is a small difference of samples.
            let difference = (right.abs() + left.abs()) / z.abs().max(1e-9);
            for (i, (sum, term)) in sums.iter_mut().zip(terms).enumerate() {
                let of_z = (12..18).contains(&i);
                let cancels = if of_z { difference } else { 1.0 };
                *sum = (sum.0 + term, sum.1 + term.abs() * cancels);
            }
            sums[18].0 = sums[18].0.max(w * z * z);
        }
        // The worst pair is one of the squares.
        sums[18].1 = sums[17].1;
        sums
    }

    /// Rows with a spot, noise and a level that is no whole number: samples of all sizes, at all places about
    /// the mirror, whole, near the row's ends, and with saturated and masked pixels.
    #[test]
    fn sums_agree_with_their_definitions() {
        let (mut worst, mut whole, mut others) = (0.0f64, 0, 0);
        let widths = [
            0.9, 1.5, 2.5, 4.5, 7.0, 10.5, 14.0, 20.0, 25.0, 33.0, 40.0, 60.0f32,
        ];
        for (case, width) in (0..60).flat_map(|case| widths.map(|width| (case, width))) {
            let is_near_the_end = case % 5 == 4;
            let start = if is_near_the_end {
                4.0 * width + 3.0
            } else {
                450.0
            };
            let centre = start + 0.173 * case as f32;
            let mut light: [u16; 901] = core::array::from_fn(|i| {
                let spot = (200.0 + 2000.0 * gaussian(i, centre, width)) as u16;
                spot + (hash(i + 901 * case) >> 28) as u16
            });
            let has_saturated = case % 5 == 2;
            if has_saturated {
                light[centre as usize + 3] = 4095;
            }
            let polarity = [Polarity::Rising, Polarity::Falling][case % 2];
            let geometry = bare(light.len(), polarity);
            let words = light.map(|count| count ^ geometry.inverted());
            let row = geometry.row(&words).expect("a row");
            let masked = MaskedPixels {
                first: 440,
                block: 2,
                samples: if case % 5 == 3 { 0b1001_1000_0000 } else { 0 },
            };
            let pixels = (width / 6.0) as usize + 1;
            let block = pixels as f32;
            let per_s = 1.0 / libm::sqrtf(width * width + block * block / 12.0);
            let mirror = Place::of(Pixels::from_f32(centre));
            let pairs = Pairs {
                light: row.light(),
                mirror,
                pixels,
                u: (mirror.to_right + 0.5 * (block - 1.0)) * per_s,
                pitch: block * per_s,
                level: 200 * 256 + 77,
                gaps: Gaps {
                    saturation: has_saturated.then_some(4095),
                    masked: &masked,
                },
            };
            let unit = pairs.units_a_count();
            let noise = |unit: f32| Noise {
                correction: Correction::of(mirror.offset, per_s, 2000.0 * block * unit),
                dark: 2.0 * 16.0 * block * unit * unit,
                shot: 0.1 * unit,
            };
            let number = if pairs.are_whole() {
                &mut whole
            } else {
                &mut others
            };
            *number += 1;
            let (odd, even) = pairs.sums(&noise(unit), false);
            let (w, z) = (unit * unit, unit);
            // Weights fall with the square of the unit.
            let mut units = [w; 33];
            units[12..17].fill(w / z);
            units[17..28].fill(1.0);
            units[28..32].fill(1.0 / unit);
            units[32] = 1.0 / w;
            let found = odd.all().into_iter().chain(even.all());
            let sums = reference(&pairs, &noise(1.0)).into_iter().zip(units);
            for (i, (found, ((sum, magnitude), unit))) in found.zip(sums).enumerate() {
                let error = (f64::from(found) * f64::from(unit) - sum).abs();
                worst = worst.max(error / magnitude);
                let is_right = error <= 2e-5 * magnitude;
                assert!(is_right, "{i} of {width} at {centre}: {found} {sum}");
            }
        }
        println!("{worst:.1e} of {whole} whole and {others} others");
        assert!(whole > 100 && others > 100);
    }
}
