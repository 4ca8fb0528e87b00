//! The layout of the rows of each sensor head that has a driver. The simulation and the tests on a PC need
//! the same numbers as the driver.

use crate::row::{Geometry, LARGEST_COUNT, Polarity};

/// Words of a TCD1304DG's read-out before the one that samples the sensor's first output, D0. The converter
/// runs before the sensor puts out D0, so that the phase between their clocks does not depend on the
/// program's speed. A slow program has three words to see one of them end. Word `LEAD_IN + k` samples output
/// k. An even number: the core sums pixels in half the time if the first of them lies at a multiple of 4
/// bytes.
pub const TCD1304DG_LEAD_IN: usize = 4;

/// Toshiba TCD1304DG behind a 12-bit converter.
///
/// The sensor puts out D0-D15 dummies, D16-D28 shielded, D29-D31 transition, S1-S3648 light, D32-D45 dummies
/// (data sheet, timing chart). The read-out has as many words as the sensor has outputs, so the lead-in costs
/// the last four dummies.
///
/// The black level comes from D18 to D26, the shielded pixels without two at each edge. Light that leaks
/// under the edge of the shield would raise it. With nine pixels of thirteen its noise is 1.2 times as much.
///
/// 22 words come before D18, 34 us: [`TCD1304DG_LEAD_IN`] and D0-D17. The converter wakes up when chip
/// select falls, which takes its first word and may disturb the supply. No word before D18 counts.
///
/// Electrons a count: 40 ke- at the saturation of 0.6 V (as measured by drmcnelson's TCD1304 project), spread
/// over the converter's 4096 counts.
///
/// Saturation: full scale. The data sheet's least saturation voltage is 0.45 V, which is 3072 counts if the
/// typical 0.6 V are 4096. A sensor that saturates between the two still gives no wrong distance: auto
/// exposure aims at 70 % of the room above the background (2956 counts if the background has 300), and the
/// check recognises a flat top below full scale.
pub const fn tcd1304dg() -> Geometry {
    const D18: usize = TCD1304DG_LEAD_IN + 18;
    const S1: usize = TCD1304DG_LEAD_IN + 32;
    Geometry {
        words: 3694,
        shielded: D18..D18 + 9,
        light: S1..S1 + 3648,
        polarity: Polarity::Falling,
        bits: 12,
        // One over ten electrons.
        shot_variance_per_count_q16: 6554,
        saturation: LARGEST_COUNT,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_a_row_lie_within_it() {
        let head = tcd1304dg();
        assert_eq!((head.shielded.start, head.shielded.end), (22, 31));
        assert_eq!((head.light.start, head.light.end), (36, 3684));
        assert!(head.light.end <= head.words);
    }
}
