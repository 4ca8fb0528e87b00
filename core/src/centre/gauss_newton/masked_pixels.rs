//! The pixels that a fit left out.

use core::ops::Range;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct MaskedPixels {
    /// The first pixel of the first sample.
    pub(crate) first: usize,
    /// Pixels in a sample.
    pub(crate) block: usize,
    /// A bit for each sample, the lowest for the first.
    pub(crate) samples: u128,
}

impl MaskedPixels {
    /// The pixels of masked samples, of those side by side together.
    pub(crate) fn runs(&self) -> impl Iterator<Item = Range<usize>> {
        let Self {
            first,
            block,
            mut samples,
        } = *self;
        let runs = core::iter::from_fn(move || {
            if samples == 0 {
                return None;
            }
            let start = samples.trailing_zeros();
            // The carry goes on through the run, to the first sample that is not masked.
            let (carried, is_last) = samples.overflowing_add(1u128.wrapping_shl(start));
            let end = if is_last {
                u128::BITS
            } else {
                (carried & !samples).trailing_zeros()
            };
            samples &= carried;
            Some((start, end))
        });
        runs.map(move |(start, end)| {
            let pixel = |sample: u32| first.saturating_add((sample as usize).saturating_mul(block));
            pixel(start)..pixel(end)
        })
    }

    pub(crate) fn has(&self, pixel: usize) -> bool {
        let from_first = pixel.checked_sub(self.first);
        let sample = from_first.and_then(|pixels| pixels.checked_div(self.block));
        let bit = sample.and_then(|sample| self.samples.checked_shr(u32::try_from(sample).ok()?));
        bit.is_some_and(|bits| bits & 1 == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_have_the_pixels_of_all_masked_samples() {
        let mut samples = 0x9E37_79B9_7F4A_7C15_F39C_C060_5CED_C834u128;
        for round in 0..60 {
            let (first, block) = (7, 3);
            let masked = MaskedPixels {
                first,
                block,
                samples,
            };
            let mut last = 0;
            let mut found = std::vec::Vec::new();
            for run in masked.runs() {
                assert!(run.start > last && !run.is_empty(), "{run:?}");
                last = run.end;
                found.extend(run);
            }
            let all: std::vec::Vec<usize> = (0..500).filter(|&it| masked.has(it)).collect();
            assert_eq!(found, all, "{samples:x}");
            samples = match round {
                0 => 0,
                1 => u128::MAX,
                2 => 1 << 127,
                _ => samples.rotate_left(13) ^ samples.wrapping_mul(5) | samples >> 1,
            };
        }
    }

    #[test]
    fn a_bit_is_a_sample() {
        let masked = MaskedPixels {
            first: 10,
            block: 2,
            samples: 0b101,
        };
        let pixels: std::vec::Vec<usize> = (0..400).filter(|&pixel| masked.has(pixel)).collect();
        assert_eq!(pixels, [10, 11, 14, 15]);
        assert!(!MaskedPixels::default().has(0));
    }
}
