//! The square root in assembly.

use core::arch::asm;

/// The square root: VSQRT, which rounds to nearest as IEEE 754 asks. Stable Rust without `std` has no other
/// way to it.
#[inline]
pub fn square_root(value: f32) -> f32 {
    let mut bits = value.to_bits();
    // SAFETY: works on registers only. Rust knows neither this target's floating-point unit nor its registers
    // by class, but takes one of them as clobbered. No `preserves_flags`: VSQRT sets FPSCR's exception flags,
    // inexact above all.
    unsafe {
        asm!(
            ".fpu fpv4-sp-d16",
            "vmov s0, {bits}",
            "vsqrt.f32 s0, s0",
            "vmov {bits}, s0",
            bits = inout(reg) bits,
            out("s0") _,
            options(pure, nomem, nostack),
        );
    }
    f32::from_bits(bits)
}
