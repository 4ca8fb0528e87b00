//! Rows, spots and centres for the tests of all modules.

use crate::base::{Counts, Pixels};
use crate::centre::RowCentre;
use crate::row::{Background, Geometry, LARGEST_COUNT, Polarity, Row};
use crate::spot::Spot;

pub use crate::row::sensor_heads::tcd1304dg;

/// A value with a change.
pub fn with<T>(mut value: T, change: impl FnOnce(&mut T)) -> T {
    change(&mut value);
    value
}

/// A centre of 1000 counts with an uncertainty of a quarter of a pixel.
pub fn found_at(centre: f32, width: f32) -> RowCentre {
    RowCentre {
        centre: Pixels::from_f32(centre),
        uncertainty: Pixels::from_f32(0.25),
        amplitude: Counts::from_int(1000),
        width: Pixels::from_f32(width),
        ..RowCentre::default()
    }
}

/// A candidate of a height on a background of a level and a noise, all in counts.
pub fn spot_at(centre: usize, block_log2: u32, height: f32, (level, noise): (f32, f32)) -> Spot {
    let [height, level, noise] = [height, level, noise].map(Counts::from_f32);
    Spot {
        centre,
        block_log2,
        height,
        background: Background { level, noise },
        black_level: level,
    }
}

/// A row of counts of 12 bits that only the converter limits.
pub fn row(light: &[u16]) -> Row<'_> {
    Row::new(light, &[], LARGEST_COUNT).expect("12 bits")
}

/// A sensor whose words are all light pixels.
pub fn bare(pixels: usize, polarity: Polarity) -> Geometry {
    Geometry {
        words: pixels,
        shielded: 0..0,
        light: 0..pixels,
        polarity,
        ..tcd1304dg()
    }
}

/// A gaussian of height 1 at a pixel.
pub fn gaussian(pixel: usize, centre: f32, width: f32) -> f32 {
    let u = (pixel as f32 - centre) / width;
    libm::expf(-0.5 * u * u)
}

/// 32 bits in any order, the same for the same number.
pub fn hash(number: usize) -> u32 {
    (number as u32).wrapping_mul(2_654_435_761)
}

/// From 0 to 1. `state` is that of a linear congruential generator.
pub fn uniform(state: &mut u64) -> f32 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 40) as f32 / (1u64 << 24) as f32
}

/// A normal deviate: twelve even ones, summed.
pub fn normal(state: &mut u64) -> f32 {
    (0..12).map(|_| uniform(state)).sum::<f32>() - 6.0
}
