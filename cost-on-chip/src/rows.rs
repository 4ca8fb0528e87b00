//! Rows of pixels with a gaussian spot on them, made from a seed: bit for bit the same on the chip and on a PC.
//!
//! So all is integers, single IEEE 754 operations or functions of `libm`.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore as _, SeedableRng as _};
use slitrange::row::Geometry;
use slitrange::sensor_heads;

/// Pixels of a row that see light: those of the TCD1304DG.
pub const PIXELS: usize = 3648;

/// Words of its read-out.
pub const WORDS: usize = 3694;

/// The widths (sigma in pixels) that are measured: 11.3 has the longest window.
pub const WIDTHS: [f32; 5] = [1.5, 4.5, 10.5, 11.3, 25.0];

/// Rows that are measured at each width. Each has another sub-pixel phase.
pub const ROWS: usize = 8;

/// The spot's height and the black level in counts.
const AMPLITUDE: f64 = 2000.0;
const BLACK_LEVEL: f64 = 300.0;

/// White noise in counts.
const READ_NOISE: f64 = 4.0;

/// What a row reads: the TCD1304DG's counts, light positive.
pub fn geometry() -> Geometry {
    sensor_heads::tcd1304dg()
}

/// One of two rows of the same spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// The row before.
    Before,
    /// The row that is measured.
    Now,
}

/// Writes a row's pixels: a spot of the given width, the `row`-th of [`ROWS`].
pub fn light(width: f32, row: usize, turn: Turn, pixels: &mut [u16; PIXELS]) {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let phase = row as f64 * GOLDEN;
    let centre = 1800.0 + phase - libm::floor(phase) - 0.5 + 16.0 * row as f64;
    let mut random = ChaCha8Rng::seed_from_u64(u64::from(width.to_bits()));
    random.set_stream(2 * row as u64 + u64::from(turn == Turn::Now));
    // Variance of the light's own noise in counts squared a count.
    let shot = f64::from(geometry().shot_variance_per_count_q16) / 65536.0;
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let from_centre = (i as f64 - centre) / f64::from(width);
        // Beyond eight widths it is below a millionth of a count.
        let signal = if from_centre > -8.0 && from_centre < 8.0 {
            AMPLITUDE * libm::exp(-0.5 * from_centre * from_centre)
        } else {
            0.0
        };
        let noise = libm::sqrt(READ_NOISE * READ_NOISE + shot * signal);
        // `as` takes the whole part, and saturates.
        *pixel = (BLACK_LEVEL + signal + noise * nearly_normal(random.next_u32()) + 0.5) as u16;
    }
}

/// A number of nearly normal distribution, mean 0 and standard deviation 1, from 32 random bits: the sum of four bytes,
/// each of variance (256^2 - 1)/12. It stays within 3.5.
fn nearly_normal(bits: u32) -> f64 {
    let sum: i32 = bits.to_le_bytes().iter().map(|&byte| i32::from(byte)).sum();
    f64::from(sum - 2 * 255) / 147.801_217_4
}

/// Writes the words of a read-out whose light is `pixels`: the TCD1304DG's output falls with light.
pub fn words(pixels: &[u16; PIXELS], words: &mut [u16; WORDS]) {
    let geometry = geometry();
    words.fill(geometry.full_scale() - BLACK_LEVEL as u16);
    let light = words.get_mut(geometry.light.clone()).unwrap_or_default();
    for (word, pixel) in light.iter_mut().zip(pixels) {
        *word = geometry.full_scale() - pixel;
    }
}
