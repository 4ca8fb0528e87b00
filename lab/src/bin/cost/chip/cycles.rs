//! An estimate of the cycles that a call takes on a Cortex-M4, from the instructions that it executed.
//!
//! The timings are those of the *Cortex-M4 Technical Reference Manual* (ARM DDI 0439, table 3-1 and section
//! 3.3.3, and table 7-1 for the floating-point unit):
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
//! Not modelled: flash wait states that the chip's caches do not hide, waits for the bus, a cycle or two for
//! loads of words at odd addresses, a cycle more for using a floating-point result at once, IT instructions
//! that fold into others.

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

/// The registers of an instruction that moves several; of VLDM and the like the words, which a double
/// register has two of.
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    /// A loop like that of the inner product runs four times. The expected cycles are those of the manual,
    /// for 10 instructions.
    #[test]
    fn a_loop_takes_the_cycles_of_the_manual() {
        let program = Program::of_lines(
            "100: e8f1 2302 	ldrd	r2, r3, [r1], #8
             104: f850 4b04 	ldr	r4, [r0], #4
             108: f850 5b04 	ldr	r5, [r0], #4
             10c: fb24 6602 	smlad	r6, r4, r2, r6
             110: fb25 6603 	smlad	r6, r5, r3, r6
             114: 3f01      	subs	r7, #1
             116: d1f3      	bne	0x100 <dot>
             118: eeb1 0ac0 	vsqrt.f32	s0, s0
             11c: bd70      	pop	{r4, r5, r6, pc}",
        );
        let addresses = [0x100, 0x104, 0x108, 0x10c, 0x110, 0x114, 0x116];
        let mut steps = BTreeMap::new();
        for (from, to) in addresses.into_iter().zip(addresses.into_iter().skip(1)) {
            steps.insert((from, to), 4);
        }
        steps.insert((0x116, 0x100), 3);
        steps.insert((0x116, 0x118), 1);
        steps.insert((0x118, 0x11c), 1);
        steps.insert((0x11c, 0x40), 1);
        let call = Call {
            function: 0x100,
            steps,
            ..Call::default()
        };
        // LDRD 3, LDR 2 less 1 for the LDR behind it, which has 2, SMLAD, SMLAD, SUBS, BNE 1 and 3 times 2
        // more; VSQRT; POP.
        let expected = 4 * (3 + 1 + 2 + 1 + 1 + 1 + 1) + 3 * 2 + 14 + (1 + 4 + 2);
        assert_eq!(Model::of(&program).cycles(&call), expected);
        assert_eq!(call.instructions(), 4 * 7 + 2);
    }

    #[test]
    fn a_load_waits_for_its_address() {
        let program = Program::of_lines(
            "100: 6808 	ldr	r0, [r1]
             102: 6843 	ldr	r3, [r0, #4]
             104: 6053 	str	r3, [r2, #4]
             106: ed90 0a00 	vldr	s0, [r0]
             10a: fb90 f0f1 	sdiv	r0, r0, r1",
        );
        let model = Model::of(&program);
        let cycles = |addresses: &[u64]| {
            let pairs = addresses.windows(2).map(|pair| ((pair[0], pair[1]), 1));
            let call = Call {
                function: addresses[0],
                steps: pairs.collect(),
                ..Call::default()
            };
            model.cycles(&call)
        };
        assert_eq!(cycles(&[0x100, 0x102]), 2);
        assert_eq!(cycles(&[0x102, 0x104]), 1);
        assert_eq!(cycles(&[0x104, 0x106, 0x10a, 0x10e]), 1 + 2 + 8);
    }
}
