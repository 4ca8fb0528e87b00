//! The assembly.

use core::arch::{asm, naked_asm};

use crate::{Pair, Pairs};

/// See [`crate::portable::dot`].
pub fn dot(samples: &[u16], weights: &[Pair]) -> i32 {
    let pairs = (samples.len() / 2).min(weights.len());
    let (fours, ones) = (pairs / 4, pairs % 4);
    let mut sum = 0i32;
    // SAFETY: 4 bytes are read `pairs` times from each slice, which both are long enough for. LDR takes any address;
    // LDRD takes a multiple of 4, which `Pair` is aligned to. Nothing is written.
    unsafe {
        asm!(
            "cbz r2, 3f",
            "2:",
            "ldrd {w0}, {w1}, [{weight}], #8",
            "ldr {x0}, [{sample}], #4",
            "ldr {x1}, [{sample}], #4",
            "smlad {sum}, {x0}, {w0}, {sum}",
            "smlad {sum}, {x1}, {w1}, {sum}",
            "ldrd {w0}, {w1}, [{weight}], #8",
            "ldr {x0}, [{sample}], #4",
            "ldr {x1}, [{sample}], #4",
            "smlad {sum}, {x0}, {w0}, {sum}",
            "smlad {sum}, {x1}, {w1}, {sum}",
            "subs r2, #1",
            "bne 2b",
            "3:",
            "cbz r3, 5f",
            "4:",
            "ldr {w0}, [{weight}], #4",
            "ldr {x0}, [{sample}], #4",
            "smlad {sum}, {x0}, {w0}, {sum}",
            "subs r3, #1",
            "bne 4b",
            "5:",
            // CBZ takes r0 to r7 only.
            inout("r2") fours => _,
            inout("r3") ones => _,
            sample = inout(reg) samples.as_ptr() => _,
            weight = inout(reg) weights.as_ptr() => _,
            sum = inout(reg) sum,
            x0 = out(reg) _,
            x1 = out(reg) _,
            w0 = out(reg) _,
            w1 = out(reg) _,
            options(readonly, nostack),
        );
    }
    sum
}

/// See [`crate::portable::dot2`].
pub fn dot2(samples: &[u16], weights: &[Pairs]) -> (i32, i32) {
    let pairs = (samples.len() / 2).min(weights.len());
    let (fours, ones) = (pairs / 4, pairs % 4);
    let (mut first, mut second) = (0i32, 0i32);
    // SAFETY: `pairs` times 4 bytes are read from the samples and 8 from the weights, which both are long enough for.
    // LDR takes any address; LDRD takes a multiple of 4, which `Pairs` is aligned to. Nothing is written.
    unsafe {
        asm!(
            "cbz r2, 3f",
            "2:",
            "ldr {x}, [{sample}], #4",
            "ldrd {v}, {w}, [{weight}], #8",
            "smlad {first}, {x}, {v}, {first}",
            "smlad {second}, {x}, {w}, {second}",
            "ldr {x}, [{sample}], #4",
            "ldrd {v}, {w}, [{weight}], #8",
            "smlad {first}, {x}, {v}, {first}",
            "smlad {second}, {x}, {w}, {second}",
            "ldr {x}, [{sample}], #4",
            "ldrd {v}, {w}, [{weight}], #8",
            "smlad {first}, {x}, {v}, {first}",
            "smlad {second}, {x}, {w}, {second}",
            "ldr {x}, [{sample}], #4",
            "ldrd {v}, {w}, [{weight}], #8",
            "smlad {first}, {x}, {v}, {first}",
            "smlad {second}, {x}, {w}, {second}",
            "subs r2, #1",
            "bne 2b",
            "3:",
            "cbz r3, 5f",
            "4:",
            "ldr {x}, [{sample}], #4",
            "ldrd {v}, {w}, [{weight}], #8",
            "smlad {first}, {x}, {v}, {first}",
            "smlad {second}, {x}, {w}, {second}",
            "subs r3, #1",
            "bne 4b",
            "5:",
            // CBZ takes r0 to r7 only.
            inout("r2") fours => _,
            inout("r3") ones => _,
            sample = inout(reg) samples.as_ptr() => _,
            weight = inout(reg) weights.as_ptr() => _,
            first = inout(reg) first,
            second = inout(reg) second,
            x = out(reg) _,
            v = out(reg) _,
            w = out(reg) _,
            options(readonly, nostack),
        );
    }
    (first, second)
}

/// The square root: VSQRT, which rounds to nearest as IEEE 754 asks. Stable Rust without `std` has no other way to it.
pub fn square_root(value: f32) -> f32 {
    vsqrt(value)
}

/// In the hard-float ABI the argument and the result are in s0.
#[unsafe(naked)]
extern "C" fn vsqrt(value: f32) -> f32 {
    // Rust does not tell the assembler of this target's floating-point unit.
    naked_asm!(".fpu fpv4-sp-d16", "vsqrt.f32 s0, s0", "bx lr")
}
