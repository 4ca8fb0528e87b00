//! What the assembly does, in safe Rust.

use crate::{Pair, Pairs};

/// Sum of sample * weight over the samples, or over the weights where those are fewer. A last sample without a partner is left
/// out.
pub fn dot(samples: &[u16], weights: &[Pair]) -> i32 {
    let mut sum = 0i32;
    for (&[even, odd], &weight) in samples.as_chunks::<2>().0.iter().zip(weights) {
        sum = sum.wrapping_add(two_products(even, odd, weight));
    }
    sum
}

/// Two such sums over the same samples.
pub fn dot2(samples: &[u16], weights: &[Pairs]) -> (i32, i32) {
    let (mut first, mut second) = (0i32, 0i32);
    for (&[even, odd], weight) in samples.as_chunks::<2>().0.iter().zip(weights) {
        first = first.wrapping_add(two_products(even, odd, weight.0));
        second = second.wrapping_add(two_products(even, odd, weight.1));
    }
    (first, second)
}

fn two_products(even: u16, odd: u16, weight: Pair) -> i32 {
    // Products of 16 bits fit 31; the sum of two wraps at most for (-2^15)^2 twice, as SMLAD's does.
    (i32::from(even as i16) * i32::from(weight.0))
        .wrapping_add(i32::from(odd as i16) * i32::from(weight.1))
}

/// The square root, rounded to nearest as IEEE 754 asks.
pub fn square_root(value: f32) -> f32 {
    libm::sqrtf(value)
}
