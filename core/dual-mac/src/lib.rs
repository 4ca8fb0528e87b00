//! Inner products of 16-bit samples with 16-bit weights: two products an instruction on a Cortex-M with the
//! DSP extension.
//!
//! Stable Rust emits a multiply-accumulate for one product at a time. It never emits the DSP extension's
//! SMLAD, which does two and so halves what an estimator costs. This crate is the one place with `asm!`, and
//! has the only `unsafe` of the core's arithmetic. Each function has a portable twin in [`portable`], which
//! runs on all other targets and must agree bit for bit: a program on the emulated board compares the two.
//!
//! The same targets have the extension's instructions that add, subtract and compare two samples at once: for
//! sums, sweeps and differences.
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

#[cfg(has_dsp)]
pub use cortex_m::{
    contrasts, dot, dot2, reaches, subtract_slope, subtract_to_12_bits, sum_blocks, sum_of_steps,
    sweep, sweep_wide,
};
#[cfg(not(has_fpu))]
pub use portable::square_root;
#[cfg(not(has_dsp))]
pub use portable::{
    contrasts, dot, dot2, reaches, subtract_slope, subtract_to_12_bits, sum_blocks, sum_of_steps,
    sweep, sweep_wide,
};
#[cfg(has_fpu)]
pub use vsqrt::square_root;

/// The weights of two neighbouring samples. Aligned, so that one instruction loads both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C, align(4))]
pub struct Pair(pub i16, pub i16);

/// The weights of two neighbouring samples in two inner products.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Pairs(pub Pair, pub Pair);

/// Samples in a block of [`sum_blocks`].
pub const BLOCK: usize = 8;
/// Pairs of samples in a part of [`sweep`].
pub const PART: usize = 16;
/// The largest sample. Samples are read as signed 16-bit numbers, so larger ones would be negative.
pub const LARGEST_SAMPLE: u16 = i16::MAX as u16;
/// [`contrasts`] compares a sample with the two samples that are so far to its left and to its right.
pub const BESIDE: usize = 4;
/// The contrast of a sample depends on so many samples to its left, and on as many to its right.
pub const REACH: usize = BESIDE + 1;
/// Places in a part of [`contrasts`].
pub const PLACES_OF_PART: usize = 24;
/// Samples of the places in a part, and those to their sides.
pub const SAMPLES_OF_PART: usize = PLACES_OF_PART + 2 * REACH;
