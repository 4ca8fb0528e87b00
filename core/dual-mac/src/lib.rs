//! Inner products of 16-bit samples with 16-bit weights: two products an instruction on a Cortex-M with the
//! DSP extension.
//!
//! Stable Rust emits a multiply-accumulate for one product at a time. It never emits the DSP extension's
//! SMLAD, which does two and so halves what an estimator costs. This crate is the one place with `asm!`, and
//! has the only `unsafe` of the core's arithmetic. Each function has a portable twin in [`portable`], which
//! runs on all other targets and must agree bit for bit: a program on the emulated board compares the two.
//!
//! The same targets have the extension's instructions that add and subtract two samples at once: for sums,
//! differences and comparisons.
//!
//! | target | inner products | square root |
//! |---|---|---|
//! | thumbv7em-none-eabihf | SMLAD | VSQRT |
//! | thumbv7em-none-eabi | SMLAD | portable |
//! | thumbv8m.main-none-eabihf | portable; SMLAD where the compiler reports the feature `dsp` | VSQRT |
//! | thumbv8m.main-none-eabi | the same | portable |
//! | all others | portable | portable |
//!
//! Sums wrap in both, as SMLAD does. A caller whose sums must not wrap proves for its weights that the sum of
//! |weight| * largest sample is below 2^31.
#![no_std]
#![cfg_attr(not(test), warn(clippy::cast_possible_truncation))]
#![cfg_attr(not(test), warn(clippy::cast_sign_loss, clippy::unwrap_used))]

#[cfg(not(target_os = "none"))]
extern crate std;

pub mod portable;

// `build.rs` says which of these the target has.
#[cfg(has_dsp)]
mod cortex_m;
#[cfg(has_fpu)]
mod vsqrt;

pub use portable::{BLOCK, LARGEST_SAMPLE, Pair, Pairs, SixPairs};

#[cfg(has_dsp)]
pub use cortex_m::{
    add_upper_product, blocks_at_most, dot, dot2, gram, halve, reaches, sum_blocks, sum_of_steps,
    sum_pairs, upper_product,
};
#[cfg(not(has_fpu))]
pub use portable::square_root;
#[cfg(all(has_long_products, not(has_dsp)))]
pub use portable::upper_product;
#[cfg(not(has_long_products))]
pub use portable::upper_product_of_halves as upper_product;
#[cfg(not(has_dsp))]
pub use portable::{
    blocks_at_most, dot, dot2, gram, halve, reaches, sum_blocks, sum_of_steps, sum_pairs,
};
#[cfg(has_fpu)]
pub use vsqrt::square_root;

/// A sum and the upper half of a product. Wraps.
#[cfg(not(has_dsp))]
#[inline(always)]
pub fn add_upper_product(sum: i32, a: i32, b: i32) -> i32 {
    sum.wrapping_add(upper_product(a, b))
}
