//! Random numbers: a stream for each effect and row, and a number in it for each pixel.
//!
//! No function of the machine's own is used, whose last bit differs from one to the next: the generator works
//! on integers, and what is made of its numbers needs additions, multiplications and square roots of IEEE
//! 754, which are the same everywhere. The one exception is [`crate::scene::Texture`], whose normal numbers
//! (`rand_distr`) use the standard library's exp and ln at the edges of its ziggurat.

use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_4, LN_2};

use rand::{RngCore as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::scene::Effect;

/// The stream of an effect in a row. Streams of one key that differ in their number are independent (ChaCha:
/// D. J. Bernstein, 2008), so that an effect more or less changes no other's numbers, and rows can be made in
/// any order.
pub fn of_row(seed: u64, effect: Effect, row: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    // Rows are far fewer than 2^56: two thousand a second for a million years.
    random.set_stream((effect as u64) << 56 | row);
    random
}

/// The stream of what an effect draws once for a scene: the one that no row reaches.
pub fn of_scene(seed: u64, effect: Effect) -> ChaCha8Rng {
    of_line(seed, effect, 0)
}

/// The stream of what an effect draws once for a line of the sensor's pixels: rows of a camera that are read
/// from the same line share it.
pub fn of_line(seed: u64, effect: Effect, line: u64) -> ChaCha8Rng {
    of_row(seed, effect, (1 << 56) - 1 - line)
}

/// Numbers that are drawn together: as many as the generator makes at a time.
pub const BLOCK: usize = 64;

/// The next [`BLOCK`] numbers of a stream, evenly distributed over all 32 bits.
pub fn words(random: &mut ChaCha8Rng) -> [u32; BLOCK] {
    std::array::from_fn(|_| random.next_u32())
}

/// The next [`BLOCK`] numbers of a stream, normal with mean 0 and variance 1: a radius and an angle make two
/// (G. E. P. Box and M. E. Muller, "A note on the generation of random normal deviates", Annals of
/// Mathematical Statistics 29, 1958).
///
/// None is beyond 6.7, where one in 2e10 would be. There is no branch, so that the compiler computes several
/// at a time.
pub fn normals(random: &mut ChaCha8Rng) -> [f32; BLOCK] {
    let words = words(random);
    let (radii, angles) = words.split_at(BLOCK / 2);
    let mut normals = [0.0; BLOCK];
    let (first, second) = normals.split_at_mut(BLOCK / 2);
    for i in 0..BLOCK / 2 {
        // 31 bits above zero, because a processor turns signed numbers into fractions and not others.
        let share = ((radii[i] >> 1) as i32 as f32 + 0.5) / SHARES;
        let radius = (-2.0 * natural_logarithm(share)).max(0.0).sqrt();
        // An eighth of a turn to either side of one of the four half axes, which two bits choose.
        let angle = ((angles[i] >> 2) as i32 - ANGLES) as f32 * (FRAC_PI_4 / ANGLES as f32);
        let (sine, cosine) = sine_and_cosine(angle);
        let (swap, sign) = (angles[i] & 1 == 1, (angles[i] & 2) << 30);
        let (x, y) = if swap { (sine, cosine) } else { (cosine, sine) };
        first[i] = f32::from_bits((radius * x).to_bits() ^ sign);
        second[i] = f32::from_bits((radius * y).to_bits() ^ sign);
    }
    normals
}

/// So many [`normals`].
pub fn normals_of(random: &mut ChaCha8Rng, count: usize) -> impl Iterator<Item = f32> {
    let blocks = (0..count.div_ceil(BLOCK)).flat_map(|_| normals(random));
    blocks.take(count)
}

/// Shares of one that 31 bits tell apart.
const SHARES: f32 = (1u32 << 31) as f32;
/// Steps of an eighth of a turn: half of what 30 bits tell apart.
const ANGLES: i32 = 1 << 29;

/// ln x of a number above zero, to 1e-7 of it or of 1, whichever is more: the polynomial of `logf` in S. L.
/// Moshier's Cephes library.
#[inline]
fn natural_logarithm(x: f32) -> f32 {
    let bits = x.to_bits() as i32;
    // x = 2^exponent (1 + f), where 1 + f is between the square roots of 1/2 and of 2.
    let exponent = bits.wrapping_sub(FRAC_1_SQRT_2.to_bits() as i32) >> 23;
    let f = f32::from_bits(bits.wrapping_sub(exponent << 23) as u32) - 1.0;
    let series = polynomial(
        f,
        [
            0.070_376_836,
            -0.115_146_1,
            0.116_769_99,
            -0.124_201_41,
            0.142_493_23,
            -0.166_680_58,
            0.200_007_15,
            -0.249_999_94,
            0.333_333_3,
        ],
    );
    let squared = f * f;
    exponent as f32 * LN_2 + (f - 0.5 * squared + f * squared * series)
}

/// Sine and cosine up to pi / 4 to either side, to 1e-7: the polynomials of `sinf` and `cosf` in Cephes.
#[inline]
fn sine_and_cosine(angle: f32) -> (f32, f32) {
    let squared = angle * angle;
    let sine = polynomial(squared, [-1.951_529_6e-4, 8.332_161e-3, -0.166_666_55]);
    let cosine = polynomial(squared, [2.443_315_7e-5, -1.388_731_6e-3, 0.041_666_646]);
    (
        angle + angle * squared * sine,
        1.0 - 0.5 * squared + squared * squared * cosine,
    )
}

/// By Horner's rule, the highest power's coefficient first.
#[inline]
fn polynomial<const N: usize>(x: f32, coefficients: [f32; N]) -> f32 {
    coefficients.iter().fold(0.0, |sum, c| sum * x + c)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the PC's own functions in double precision.
    #[test]
    fn functions_are_right_to_single_precision() {
        let (mut logarithm, mut sine, mut cosine) = (0f64, 0f64, 0f64);
        for i in 0..1_000_000 {
            let share = 2f64.powf(-32.0 * f64::from(i) / 1e6) as f32;
            let exact = f64::from(share).ln();
            let off = f64::from(natural_logarithm(share)) - exact;
            logarithm = logarithm.max(off.abs() / exact.abs().max(1.0));
            let angle = (f64::from(i) / 5e5 - 1.0) as f32 * FRAC_PI_4;
            let found = sine_and_cosine(angle);
            sine = sine.max((f64::from(found.0) - f64::from(angle).sin()).abs());
            cosine = cosine.max((f64::from(found.1) - f64::from(angle).cos()).abs());
        }
        println!("off by {logarithm:.1e}, {sine:.1e}, {cosine:.1e} at most");
        assert!(logarithm <= 1.2e-7 && sine <= 1.2e-7 && cosine <= 1.2e-7);
    }
}
