//! Random numbers: a stream for each effect and row.

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::scene::Effect;

/// The stream of an effect in a row. Streams of one key that differ in their number are independent (ChaCha: D. J. Bernstein,
/// 2008), so that an effect more or less changes no other's numbers, and rows can be made in any order.
pub fn of_row(seed: u64, effect: Effect, row: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    // Rows are far fewer than 2^56: two thousand a second for a million years.
    random.set_stream((effect as u64) << 56 | row);
    random
}

/// The stream of what an effect draws once for a scene: the one that no row reaches.
pub fn of_scene(seed: u64, effect: Effect) -> ChaCha8Rng {
    of_row(seed, effect, (1 << 56) - 1)
}
