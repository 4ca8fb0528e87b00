//! Rows of pixels with a gaussian spot on them, made from a seed: bit for bit the same on the chip and on a
//! PC.
//!
//! So all is integers, single IEEE 754 operations or functions of `libm`.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore as _, SeedableRng as _};
use slitrange::frame::comb::{Comb, MAX_SLITS};
use slitrange::{Geometry, Pixels, sensor_heads};

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

/// Which row of a spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// The row before, the target at rest: the same spot, other noise.
    Before,
    /// The row before, the target on the move: the spot lies up to half a pixel beside where it will be, its
    /// width is up to 5 % another, and its height 10 %.
    BeforeMoved,
    /// The row that is measured.
    Now,
    /// A row of a frame, the target at rest: the same spot, and noise of its own.
    OfFrame(u16),
}

/// Writes a row's pixels: a spot of the given width, the `row`-th of [`ROWS`].
pub fn light(width: f32, row: usize, turn: Turn, pixels: &mut [u16; PIXELS]) {
    let moved = if turn == Turn::BeforeMoved { 1.0 } else { 0.0 };
    // Irrational steps, each of its own, spread evenly.
    let centre = 1800.0 + 16.0 * row as f64 + 0.5 * even(row, 1.618_033_988_749_895);
    let centre = centre + moved * 0.5 * even(row + 1, 2.645_751_311_064_591);
    let width = f64::from(width) * (1.0 + moved * 0.05 * even(row + 1, core::f64::consts::SQRT_2));
    let amplitude = AMPLITUDE * (1.0 + moved * 0.1 * even(row + 1, 1.732_050_807_568_877));
    let spot = Spot {
        centre,
        width,
        amplitude,
    };
    write_spots(&[spot], width.to_bits(), stream(row, turn), pixels);
}

/// Writes a row's pixels: images of the nominal comb, 10.5 pixels wide and of heights as speckle makes them.
pub fn comb_light(turn: Turn, pixels: &mut [u16; PIXELS]) {
    let comb = Comb::nominal();
    let x0 = Pixels::from_f32(1823.7);
    let mut spots = [Spot::default(); MAX_SLITS];
    for ((spot, slit), number) in spots.iter_mut().zip(comb.slits()).zip(0..) {
        // Half a pixel of speckle, and a tenth to all of the height.
        *spot = Spot {
            centre: slit.from_axis(x0).to_f64() + 0.5 * even(number, core::f64::consts::SQRT_2),
            width: f64::from(crate::whole_rows::WIDTH),
            amplitude: AMPLITUDE * (0.55 + 0.45 * even(number, 1.618_033_988_749_895)),
        };
    }
    write_spots(&spots, 0xc0b, stream(0, turn), pixels);
}

/// A gaussian.
#[derive(Clone, Copy, Default)]
struct Spot {
    centre: f64,
    width: f64,
    amplitude: f64,
}

/// The number of the random stream of a row.
fn stream(row: usize, turn: Turn) -> u64 {
    match turn {
        Turn::Before | Turn::BeforeMoved => 2 * row as u64,
        Turn::Now => 2 * row as u64 + 1,
        Turn::OfFrame(place) => (ROWS * (2 + usize::from(place)) + row) as u64,
    }
}

fn write_spots(spots: &[Spot], seed: u64, stream: u64, pixels: &mut [u16; PIXELS]) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(stream);
    // Variance of the light's own noise in counts squared a count.
    let shot = f64::from(geometry().shot_variance_per_count_q16) / 65536.0;
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let of_spot = |spot: &Spot| {
            let from_centre = (i as f64 - spot.centre) / spot.width;
            // Beyond eight widths it is below a millionth of a count.
            if from_centre > -8.0 && from_centre < 8.0 {
                spot.amplitude * libm::exp(-0.5 * from_centre * from_centre)
            } else {
                0.0
            }
        };
        let signal: f64 = spots.iter().map(of_spot).sum();
        let noise = libm::sqrt(READ_NOISE * READ_NOISE + shot * signal);
        // `as` takes the whole part, and saturates.
        *pixel = (BLACK_LEVEL + signal + noise * nearly_normal(random.next_u32()) + 0.5) as u16;
    }
}

/// The `n`-th of numbers from -1 to 1 that are a step apart, modulo 2.
fn even(n: usize, step: f64) -> f64 {
    let place = n as f64 * step;
    2.0 * (place - libm::floor(place)) - 1.0
}

/// A number of nearly normal distribution, mean 0 and standard deviation 1, from 32 random bits: the sum of
/// four bytes, each of variance (256^2 - 1)/12. It stays within 3.5.
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
