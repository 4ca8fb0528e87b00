//! Inner products of 16-bit samples with 16-bit weights, two products an instruction on a Cortex-M4.
//!
//! Stable Rust emits a multiply-accumulate for one product at a time and never the DSP extension's SMLAD, which does
//! two; that halves what an estimator costs. This crate is the one place with `asm!` and the only `unsafe` of the core's
//! arithmetic. Each function has a portable twin in [`portable`], which is what runs elsewhere and must agree bit for bit:
//! a program on the emulated board compares them.
//!
//! Sums wrap in both, as SMLAD does. Who must not wrap proves it of the weights: sum |weight| * largest sample < 2^31.
#![no_std]

#[cfg(not(target_os = "none"))]
extern crate std;

pub mod portable;

#[cfg(all(target_arch = "arm", target_os = "none", target_abi = "eabihf"))]
mod cortex_m4;

#[cfg(all(target_arch = "arm", target_os = "none", target_abi = "eabihf"))]
pub use cortex_m4::{dot, dot2, square_root};
#[cfg(not(all(target_arch = "arm", target_os = "none", target_abi = "eabihf")))]
pub use portable::{dot, dot2, square_root};

/// The weights of two neighbouring samples. Aligned, so that one instruction loads both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C, align(4))]
pub struct Pair(pub i16, pub i16);

/// The weights of two neighbouring samples in two inner products.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Pairs(pub Pair, pub Pair);

/// Samples are taken as signed 16-bit numbers: counts up to this are what they are.
pub const LARGEST_SAMPLE: u16 = i16::MAX as u16;
