//! The samples around a spot that are fitted.

use super::fit::Fit;
use super::masked_pixels::MaskedPixels;
use super::normal_equations::{Parameters, SAMPLES, SATURATED, Sample};
use super::start::Start;
use crate::base::{Counts, Pixels, numeric};
use crate::centre::RowCentre;
use crate::row::{Geometry, LARGEST_COUNT, Row};
use crate::spot::Spot;

/// A width has at most so many samples: half of a window then has at least five widths.
const SAMPLES_A_WIDTH: f32 = 12.8;
/// The most pixels in a sample. The widest spot needs 170 * 10 / 128 = 13.3. The sum of this many counts is
/// below 2^16.
const LARGEST_SAMPLE: usize = 16;

// This sum fits in Q8, and is exact in an f32.
const _: () = assert!(
    LARGEST_COUNT as u64 * LARGEST_SAMPLE as u64 * (1 << Counts::FRACTION)
        <= 1 << f32::MANTISSA_DIGITS
);

/// A spot with saturated pixels needs this many other samples within three widths: one more than the
/// unknowns that only the spot's own pixels tell.
const FEWEST_SAMPLES: usize = 4;
/// The sum of squares may exceed its expectation by this many standard deviations. For n degrees of freedom
/// the expectation is n.
const MISFIT: f32 = 5.0;
/// The relative uncertainty of the noise's variance: [`crate::spot::find`] knows the noise to 3 % on a row of
/// 3648 pixels. The variance of the sum of squares is 2 n from its own scatter, and (this times n)^2 from
/// that of the noise.
const NOISE_VARIANCE_UNCERTAINTY: f32 = 0.06;

/// Half of the window of a spot of this width, in pixels.
pub(crate) fn half_window(width: f32) -> usize {
    pixels_a_sample(width, SAMPLES_A_WIDTH) * (SAMPLES / 2)
}

/// The pixels of a sample, if a width has at most so many samples.
pub(crate) fn pixels_a_sample(width: f32, samples_a_width: f32) -> usize {
    numeric::whole_usize(width / samples_a_width).min(LARGEST_SAMPLE - 1) + 1
}

/// The samples that are fitted.
pub(crate) struct Window {
    /// The first sample's first pixel.
    first: usize,
    /// Pixels in a sample.
    block: usize,
    pub(crate) samples: [Sample; SAMPLES],
    /// How many there are: fewer than [`SAMPLES`] at the sensor's edge.
    length: usize,
    saturated: usize,
    /// The variance of a sample that is not masked.
    pub(super) variance: f32,
}

impl Window {
    pub(crate) fn empty() -> Self {
        Self {
            first: 0,
            block: 1,
            samples: [Sample::default(); SAMPLES],
            length: 0,
            saturated: 0,
            variance: 0.0,
        }
    }

    pub(crate) fn around(row: &Row<'_>, spot: &Spot, start: &Start, geometry: &Geometry) -> Self {
        let block = pixels_a_sample(start.width, SAMPLES_A_WIDTH);
        let mut window = Self::empty();
        window.fill_around((SAMPLES / 2, block), row, spot, start, geometry);
        window
    }

    /// Fills the window with up to `half` samples of `block` pixels on each side of the start's centre: see
    /// [`pixels_a_sample`]. In place, because a copy takes time.
    pub(crate) fn fill_around(
        &mut self,
        (half, block): (usize, usize),
        row: &Row<'_>,
        spot: &Spot,
        start: &Start,
        geometry: &Geometry,
    ) {
        let light = row.light();
        let half = half.min(SAMPLES / 2);
        let block = block.clamp(1, LARGEST_SAMPLE);
        let middle =
            usize::try_from(start.centre.to_bits() >> Pixels::FRACTION).unwrap_or_default();
        let first = middle.saturating_sub(block * half).min(light.len());
        let end = (middle + block * half).min(light.len());
        let pixels = light.slice(first..end).unwrap_or_default();
        // Below 2^16 in Q8, and 16 counts of 12 bits: 2^24 in Q8, exact in f32.
        let level = spot.background.level_bits() * numeric::to_i32(block);
        let (noise, _) = spot.background.variances(geometry);
        (self.first, self.block) = (first, block);
        (self.length, self.saturated) = (0, 0);
        self.variance = noise * block as f32;
        let saturation = row.saturated_from();
        if block == 1 {
            let counts = pixels.iter();
            let counts = counts.map(|count| (count.into(), count >= saturation));
            self.fill(level, counts);
        } else {
            let groups = pixels.groups(block);
            self.fill(level, groups.map(|pixels| pixels.sum_of_few(saturation)));
        }
    }

    /// Makes samples of sums of counts, each with whether a pixel of it is saturated. `level` is under
    /// each sample, in Q8.
    #[inline(always)]
    fn fill(&mut self, level: i32, sums: impl Iterator<Item = (u32, bool)>) {
        for (sample, (sum, is_full)) in self.samples.iter_mut().zip(sums) {
            let sum = numeric::mul_i32(sum as i32, 1 << Counts::FRACTION);
            *sample = Sample {
                counts: numeric::sub_i32(sum, level) as f32 / 256.0,
                variance: if is_full { SATURATED } else { self.variance },
            };
            // At most SAMPLES.
            self.saturated = numeric::add_usize(self.saturated, usize::from(is_full));
            self.length = numeric::add_usize(self.length, 1);
        }
    }

    /// Whether the centre is among the samples, and so on the sensor.
    pub(crate) fn has_centre(&self, at: &Parameters) -> bool {
        (-0.5..self.length as f32 - 0.5).contains(&at.centre)
    }

    /// Unmasks the samples that [`Sample::mask`] masked. Saturated samples stay masked.
    pub(crate) fn unmask(&mut self) {
        for sample in &mut self.samples {
            if sample.is_masked_by_check() {
                sample.variance = self.variance;
            }
        }
    }

    pub(crate) fn masked_pixels(&self) -> MaskedPixels {
        MaskedPixels {
            first: self.first,
            block: self.block,
            samples: self.bits(Sample::is_masked),
        }
    }

    /// A bit for each sample, the lowest for the first.
    // Bits move up by multiplication: builds that check for overflow test the left operand of a shift.
    pub(crate) fn bits(&self, is_set: impl Fn(&Sample) -> bool) -> u128 {
        let mut words = [0u32; SAMPLES / 32];
        for (word, samples) in words.iter_mut().zip(self.samples().chunks(32)) {
            *word = (samples.iter().rev()).fold(0, |bits, sample| {
                bits.wrapping_mul(2) | u32::from(is_set(sample))
            });
        }
        (words.iter().rev()).fold(0, |all, &word| all.wrapping_mul(1 << 32) | u128::from(word))
    }

    /// The mean of the samples within `reach` of a sample, above the row's level. The samples may lie outside
    /// the window: `sample` is within -2^8 to 2^9. `None` where they are not all on the row.
    pub(crate) fn mean(
        &self,
        row: &Row<'_>,
        spot: &Spot,
        sample: i32,
        reach: usize,
    ) -> Option<f32> {
        let samples = reach.saturating_mul(2).saturating_add(1);
        let before = sample.saturating_sub_unsigned(numeric::to_u32(reach));
        let before = before.saturating_mul(numeric::to_i32(self.block));
        let first = self.first.checked_add_signed(before as isize)?;
        let end = first.checked_add(samples.checked_mul(self.block)?)?;
        let pixels = row.light().slice(first..end)?;
        // At most 2^12 pixels, below 2^20 each in Q8: below 2^32.
        let level = spot.background.level_bits();
        let sum = pixels.iter().fold(0i64, |sum, count| {
            let above = (i32::from(count) * (1 << Counts::FRACTION)).saturating_sub(level);
            sum.saturating_add(above.into())
        });
        Some(sum as f32 / (256.0 * samples as f32))
    }

    pub(crate) fn samples(&self) -> &[Sample] {
        self.samples.get(..self.length).unwrap_or_default()
    }

    /// The distance from the middle of a sample's first pixel to the middle of the sample, in pixels.
    fn half_sample(&self) -> f32 {
        (self.block as f32 - 1.0) * 0.5
    }

    pub(crate) fn parameters(&self, start: &Start) -> Parameters {
        let block = self.block as f32;
        let first = Pixels::from_int(numeric::to_i32(self.first));
        let from_first = start.centre.to_bits().saturating_sub(first.to_bits());
        let width = start.width / block;
        Parameters {
            centre: (Pixels::from_bits(from_first).to_f32() - self.half_sample()) / block,
            width: dual_mac::square_root(width * width + 1.0 / 12.0),
            amplitude: start.amplitude * block,
            level: 0.0,
        }
    }

    pub(super) fn cut_off(&self, fit: &Parameters) -> CutOff {
        if self.saturated == 0 {
            return CutOff::No;
        }
        let (mut fitted, mut full) = (0, 0);
        for (i, sample) in self.samples().iter().enumerate() {
            let distance = (i as f32 - fit.centre).abs();
            if !sample.is_masked() {
                fitted = usize::saturating_add(fitted, (distance <= 3.0 * fit.width).into());
            } else {
                full = usize::saturating_add(full, (distance <= 2.0 * fit.width).into());
            }
        }
        match (full, fitted) {
            (0, _) => CutOff::No,
            (_, FEWEST_SAMPLES..) => CutOff::Top,
            _ => CutOff::TooMuch,
        }
    }

    pub(crate) fn row_centre(&self, fit: &Fit) -> RowCentre {
        let block = self.block as f32;
        let Parameters {
            centre,
            width: s,
            amplitude,
            ..
        } = fit.parameters;
        let width = dual_mac::square_root((s * s - 1.0 / 12.0).max(0.0)) * block;
        let first = Pixels::from_int(numeric::to_i32(self.first));
        let from_first = Pixels::from_f32(centre * block + self.half_sample());
        // No more than 128 each.
        let freedom = self.length as f32 - self.saturated as f32 - 4.0;
        let is_noise = fit.squares <= freedom + allowed_scatter(freedom);
        RowCentre {
            centre: Pixels::from_bits(first.to_bits().saturating_add(from_first.to_bits())),
            uncertainty: Pixels::from_f32(fit.uncertainty * block),
            // The light, height times width, is the same in pixels and in samples.
            amplitude: Counts::from_f32(amplitude * s / width),
            width: Pixels::from_f32(width),
            misfit: !is_noise,
            ..RowCentre::default()
        }
    }
}

/// How far the sum of squares may be above its expectation, which is that of its degrees of freedom.
pub(crate) fn allowed_scatter(freedom: f32) -> f32 {
    let known = NOISE_VARIANCE_UNCERTAINTY * freedom;
    MISFIT * dual_mac::square_root((2.0 * freedom + known * known).max(0.0))
}

/// How much of a spot saturation leaves.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum CutOff {
    /// All of it.
    No,
    /// Flanks that can be fitted: at least [`FEWEST_SAMPLES`] within three widths.
    Top,
    /// Fewer samples than that.
    TooMuch,
}
