//! The second judge: rows and frames with faults, from a generator that shares no code with the first judge.
//!
//! The firmware's check is tuned on the first judge's rows ([`hard_cases`](crate::hard_cases)). A check can
//! learn its generator. So no constant of the firmware may be tuned on this one: it only judges.
//!
//! It differs from the first judge in three ways. The rows have one fault each, or two that belong together,
//! of [`Kind::all`], with ranges of their own. The fault stays in all rows of a frame, as dust and
//! reflections do, so a frame's mean does not average it out. Sensor, spots and noise are drawn and computed
//! by other code.
//!
//! A **confident error** is a centre without a flag that is off by more than five times the claimed standard
//! uncertainty, and by more than 0.1 pixels. The claim is r, the shape and the motion, and for pixels that
//! differ also their part ([`Claim`]). The surface's part of u is off.

mod beside;
mod front_end;
mod kinds;
mod lopsided;
mod moving;
mod optics;
mod pixels;
pub mod plan;
pub mod report;
pub mod sensor;
mod signal;
pub mod spot;
pub mod story;
pub mod tally;
mod target;
mod words;

pub use kinds::{Claim, Kind};
pub use plan::Frame;
use plan::Plan;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
pub use tally::{KindReport, Report, judge, judge_with};

/// Where the random numbers come from.
pub type Rng = ChaCha8Rng;
/// Rows of a frame: the default of the firmware.
pub const ROWS_OF_FRAME: usize = 16;

/// A single row with a fault. The same number gives the same row.
pub fn row(kind: &Kind, number: u64) -> Frame {
    take(kind, 1, number)
}

/// A frame with a fault that stays in all its rows. The same number gives the same frame.
pub fn frame(kind: &Kind, number: u64) -> Frame {
    take(kind, ROWS_OF_FRAME, number)
}

fn take(kind: &Kind, rows: usize, number: u64) -> Frame {
    let mut random = Rng::seed_from_u64(seed(kind.name, rows, number));
    let mut plan = Plan::draw(rows, &mut random);
    plan.calibrate(&mut random);
    (kind.put)(&mut plan, &mut random);
    plan.frame(&mut random)
}

/// A seed of a kind's name, so that a new kind changes no other kind's rows. SplitMix64's finaliser mixes the
/// bits (S. Vigna, 2015).
fn seed(name: &str, rows: usize, number: u64) -> u64 {
    let mix = |bits: u64| {
        let bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^ (bits >> 31)
    };
    let start = mix(0x5ec0_4d1d_6e00_0000 ^ rows as u64);
    let named = name
        .bytes()
        .fold(start, |seed, byte| mix(seed ^ u64::from(byte)));
    mix(named ^ number)
}

/// A number that is even over its logarithm.
fn log_even(random: &mut Rng, from: f64, to: f64) -> f64 {
    (from.ln() + (to / from).ln() * random.random::<f64>()).exp()
}

fn side(random: &mut Rng) -> f64 {
    if random.random_bool(0.5) { 1.0 } else { -1.0 }
}

/// A gaussian of height 1.
fn gaussian(place: f64, centre: f64, width: f64) -> f64 {
    (-0.5 * ((place - centre) / width).powi(2)).exp()
}
