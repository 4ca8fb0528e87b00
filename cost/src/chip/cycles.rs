//! An estimate of the cycles that a call takes on a Cortex-M4, from the instructions that it executed.
//!
//! The timings are those of the *Cortex-M4 Technical Reference Manual* (ARM DDI 0439, table 3-1 and section 3.3.3, and
//! table 7-1 for the floating-point unit):
//!
//! | instruction | cycles |
//! |---|---|
//! | arithmetic, multiply, multiply-accumulate, SMLAD, long multiply | 1 |
//! | branch, taken | 3 (1 to refill the pipeline at least, 3 at most: 2 are taken) |
//! | branch, not taken | 1 |
//! | load of one register | 2, or 1 right after another load whose result is not its address |
//! | store of one register | 1 |
//! | load or store of n registers, PUSH, POP | 1 + n, and 2 more where the program counter is among them |
//! | SDIV, UDIV | 2 to 12: 8 are taken |
//! | VADD, VMUL, VMOV, VCVT, VCMP | 1 |
//! | VMLA, VFMA | 3 |
//! | VDIV, VSQRT | 14 |
//! | VLDR, VSTR | 2 |
//!
//! Not modelled: flash wait states that the chip's caches do not hide, waits for the bus, a cycle or two for loads of words at
//! odd addresses, a cycle more for using a floating-point result at once, IT instructions that fold into others.

use virtual_board::trace::Call;

use super::program::{Instruction, Program};

/// To refill the pipeline.
const REFILL: u64 = 2;

/// What a program's instructions take.
#[derive(Debug)]
pub struct Model<'a> {
    program: &'a Program,
}

impl<'a> Model<'a> {
    /// The model for a program.
    pub fn of(program: &'a Program) -> Self {
        Self { program }
    }

    /// Estimated cycles of a call.
    pub fn cycles(&self, call: &Call) -> u64 {
        let mut total = 0;
        for (&(from, to), &times) in &call.steps {
            let (Some(instruction), next) =
                (self.program.instruction(from), self.program.instruction(to))
            else {
                // Code that the disassembler took for data. One cycle at least.
                total += times;
                continue;
            };
            let taken = to != from + instruction.bytes;
            let saved = next.is_some_and(|next| !taken && pipelined(instruction, next));
            total += times * (cycles(instruction, taken) - u64::from(saved));
        }
        total
    }
}

/// The cycles of one instruction. `taken`: it is not followed by the one behind it in memory.
fn cycles(instruction: &Instruction, taken: bool) -> u64 {
    let refill = if taken { REFILL } else { 0 };
    let name = instruction.mnemonic.split('.').next().unwrap_or_default();
    let base = if let Some(registers) = registers_moved(instruction) {
        1 + registers
    } else if is_load(instruction)
        || name.starts_with("tb")
        || name.starts_with("vldr")
        || name.starts_with("vstr")
    {
        2
    } else if name.starts_with("sdiv") || name.starts_with("udiv") {
        8
    } else if name.starts_with("vdiv") || name.starts_with("vsqrt") {
        14
    } else if [
        "vmla", "vmls", "vnmla", "vnmls", "vfma", "vfms", "vfnma", "vfnms",
    ]
    .iter()
    .any(|accumulate| name.starts_with(accumulate))
    {
        3
    } else {
        1
    };
    base + refill
}

/// The registers of an instruction that moves several; of VLDM and the like the words, which a double register has two of.
fn registers_moved(instruction: &Instruction) -> Option<u64> {
    let name = instruction.mnemonic.split('.').next().unwrap_or_default();
    if name.starts_with("ldrd") || name.starts_with("strd") {
        return Some(2);
    }
    let several = ["push", "pop", "ldm", "stm", "vpush", "vpop", "vldm", "vstm"];
    if !several.iter().any(|form| name.starts_with(form)) {
        return None;
    }
    let list = instruction
        .operands
        .split('{')
        .nth(1)?
        .trim_end_matches('}');
    let words = |register: &str| if register.starts_with('d') { 2 } else { 1 };
    Some(
        list.split(", ")
            .map(|register| words(register.trim()))
            .sum(),
    )
}

/// LDR of one register, in all its widths.
fn is_load(instruction: &Instruction) -> bool {
    instruction.mnemonic.starts_with("ldr") && !instruction.mnemonic.starts_with("ldrd")
}

/// STR of one register, in all its widths.
fn is_store(instruction: &Instruction) -> bool {
    instruction.mnemonic.starts_with("str") && !instruction.mnemonic.starts_with("strd")
}

/// Whether a load's second cycle is the first one of the load or store behind it.
fn pipelined(instruction: &Instruction, next: &Instruction) -> bool {
    if !(is_load(instruction) && (is_load(next) || is_store(next))) {
        return false;
    }
    let loaded = instruction
        .operands
        .split(',')
        .next()
        .unwrap_or_default()
        .trim();
    let address = next.operands.split('[').nth(1).unwrap_or_default();
    !address
        .split([',', ']', ' '])
        .any(|register| register == loaded)
}
