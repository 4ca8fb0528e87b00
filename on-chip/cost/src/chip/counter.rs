//! Counting cycles and stack of one call.

use core::arch::{asm, naked_asm};

use cortex_m::peripheral::DWT;

/// What a call takes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cost {
    /// Core cycles from its first instruction to its return.
    pub cycles: u32,
    /// Bytes of stack below the caller's.
    pub stack: u32,
}

/// Prints what several calls take: the median of their cycles, the upper one of two, the most cycles, and the
/// most stack in bytes. `number` is how many items of a kind each of them goes over, or another number of
/// them.
pub fn print<const N: usize>(kind: &str, name: &str, number: (&str, f32), mut costs: [Cost; N]) {
    costs.sort_unstable_by_key(|cost| cost.cycles);
    defmt::println!(
        "{} {} {} {} cycles {} most {} stack {}",
        kind,
        name,
        number.0,
        number.1,
        costs.get(N / 2).map_or(0, |cost| cost.cycles),
        costs.last().map_or(0, |cost| cost.cycles),
        costs.iter().map(|cost| cost.stack).max().unwrap_or(0)
    );
    super::board::let_the_log_out();
}

/// How far below the stack pointer the stack is watched, in words: 48 KB.
const WATCHED: usize = 12 * 1024;

/// What untouched stack holds.
const PATTERN: u32 = 0xA5C3_5A3C;

/// A function that can be counted: it takes all it needs behind one pointer and puts what it finds behind
/// another, so that a call is the same instructions whatever the function.
pub type Counted<I, O> = extern "C" fn(&I, &mut O);

/// Calls `function` and counts. Interrupts must be off.
pub fn count<I, O>(function: Counted<I, O>, input: &I, output: &mut O) -> Cost {
    let (input, output) = (
        core::ptr::from_ref(input).cast(),
        core::ptr::from_mut(output).cast(),
    );
    // SAFETY: `empty` takes two pointers and touches neither; `function` gets what its type says.
    unsafe {
        let (overhead, _) = call(empty as *const (), input, output);
        let (cycles, stack) = call(function as *const (), input, output);
        Cost {
            // `empty` is one instruction itself.
            cycles: cycles.wrapping_sub(overhead).wrapping_add(1),
            stack,
        }
    }
}

/// Returns at once.
#[unsafe(naked)]
extern "C" fn empty(_: *const (), _: *mut ()) {
    naked_asm!("bx lr")
}

/// Calls a function between two looks at the cycle counter. Gives their difference, and the bytes of stack
/// that were written to below this function's own.
///
/// # Safety
/// `function` is an `extern "C"` function of two pointers for which `input` and `output` are good.
#[inline(never)]
unsafe fn call(function: *const (), input: *const (), output: *mut ()) -> (u32, u32) {
    let top: *mut u32;
    // SAFETY: reads the stack pointer.
    unsafe { asm!("mov {}, sp", out(reg) top, options(nomem, nostack, preserves_flags)) };
    for depth in 1..=WATCHED {
        // SAFETY: nobody uses the memory below the stack pointer while interrupts are off and nothing is
        // called. It is stack: RAM has 192 KB, and this program's statics take less than half of that.
        unsafe { top.sub(depth).write_volatile(PATTERN) };
    }
    let (before, after): (u32, u32);
    // SAFETY: the caller's promise; the C calling convention is kept.
    unsafe {
        asm!(
            "ldr r5, [r8]",
            "blx r4",
            "ldr r4, [r8]",
            inout("r4") function => after,
            out("r5") before,
            in("r8") &raw const (*DWT::PTR).cyccnt,
            inout("r0") input => _,
            inout("r1") output => _,
            // What a function need not preserve. (`clobber_abi` lists registers that this core has not.)
            out("r2") _,
            out("r3") _,
            out("r12") _,
            out("lr") _,
            out("d0") _,
            out("d1") _,
            out("d2") _,
            out("d3") _,
            out("d4") _,
            out("d5") _,
            out("d6") _,
            out("d7") _,
        );
    }
    let mut used = WATCHED;
    // SAFETY: as above.
    while used > 0 && unsafe { top.sub(used).read_volatile() } == PATTERN {
        used -= 1;
    }
    (after.wrapping_sub(before), 4 * used as u32)
}

/// Counts functions whose cost is known, on an emulated core where an instruction takes a cycle.
pub fn check() {
    let cost = count(hundred_instructions, &(), &mut ());
    defmt::println!(
        "known hundred-instructions cycles {} stack {}",
        cost.cycles,
        cost.stack
    );
    super::board::let_the_log_out();
}

/// A hundred instructions, its return among them, and eight bytes of stack.
#[unsafe(naked)]
extern "C" fn hundred_instructions(_: &(), _: &mut ()) {
    naked_asm!(
        "push {{r4, lr}}",
        "movs r2, #16",
        "2:",
        "nop",
        "muls r3, r3, r3",
        "nop",
        "nop",
        "subs r2, #1",
        "bne 2b",
        "nop",
        "pop {{r4, pc}}",
    )
}
