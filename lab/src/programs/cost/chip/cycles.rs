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
//! [`Model::range`] follows the instructions in their order, with a model of the flash and its caches
//! ([`flash`]). It gives three figures:
//!
//! | | instructions | flash |
//! |---|---|---|
//! | low | branch taken 2, division 2, no IT, pairs of loads overlap | no wait |
//! | likely | the table above; unaligned loads take 1 or 2 more, an interrupt 24 | as its manual says |
//! | high | branch taken 4, division 12, floats 1 more, no overlap, an interrupt 53 | prefetch never helps |
//!
//! No silicon should take more than the high figure, because it takes the longest wait for each line that no
//! cache holds. One wait is left out: that for RAM while DMA uses it. A row's DMA makes one
//! access in 256 cycles. A silicon's figure outside low and high shows that the model is wrong.

mod flash;

use serde::Serialize;
use virtual_board::trace::Executed;

use flash::{Accelerator, Assumption};

use super::program::{Instruction, Program};

/// To refill the pipeline.
const REFILL: u64 = 2;

/// An exception's entry and return: 12 cycles each (ARM DDI 0439, section 3.9.2).
const EXCEPTION: u64 = 24;

/// The most: 17 registers of the floating-point unit more each way, less what overlaps.
const LONGEST_EXCEPTION: u64 = 53;

/// Estimated cycles with the waits for flash.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Range {
    /// No fewer.
    pub low: u64,
    /// By the flash's manual.
    pub likely: u64,
    /// No more.
    pub high: u64,
}

/// Which of the three figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Figure {
    Low,
    Likely,
    High,
}

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
}

impl Model<'_> {
    /// Estimated cycles of the instructions that a call executed, with the waits for flash.
    pub fn range(&self, path: &[Executed]) -> Range {
        let likely = self.follow(path, Figure::Likely, Assumption::Likely);
        let high = self.follow(path, Figure::High, Assumption::Worst);
        Range {
            low: self.without_flash(path, Figure::Low),
            likely: likely.cycles(),
            high: high.cycles(),
        }
    }

    fn follow(&self, path: &[Executed], figure: Figure, assumption: Assumption) -> Accelerator {
        let mut accelerator = Accelerator::new(assumption);
        for (place, executed) in path.iter().enumerate() {
            let instruction = self.program.instruction(executed.address.into());
            let bytes = instruction.map_or(2, |instruction| instruction.bytes as u32);
            accelerator.fetch(executed.address, bytes);
            accelerator.work(self.work(executed, path.get(place + 1), figure));
            if executed.loads != 0
                && let Some(instruction) = instruction
            {
                accelerator.load(executed.loads, bytes_loaded(instruction));
            }
        }
        accelerator
    }

    fn without_flash(&self, path: &[Executed], figure: Figure) -> u64 {
        let nexts = path.iter().skip(1).map(Some).chain([None]);
        let work = path
            .iter()
            .zip(nexts)
            .map(|(executed, next)| self.work(executed, next, figure));
        work.sum()
    }

    /// The cycles of one instruction without a wait for flash. `next` is executed after it; the last
    /// instruction of a call returns.
    fn work(&self, executed: &Executed, next: Option<&Executed>, figure: Figure) -> u64 {
        let Some(instruction) = self.program.instruction(executed.address.into()) else {
            return 1;
        };
        let behind = u64::from(executed.address) + instruction.bytes;
        let is_elsewhere = next.is_none_or(|next| u64::from(next.address) != behind);
        let jumps = is_elsewhere && may_jump(instruction);
        let name = instruction.mnemonic.split('.').next().unwrap_or_default();
        let following = next.and_then(|next| self.program.instruction(next.address.into()));
        let overlaps = !is_elsewhere && following.is_some_and(|next| pipelined(instruction, next));
        let is_division = name.starts_with("sdiv") || name.starts_with("udiv");
        let base = cycles(instruction, false);
        let core = match figure {
            _ if is_division && figure == Figure::Low => 2,
            _ if is_division && figure == Figure::High => 12,
            // An IT instruction may fold into the one before.
            Figure::Low if name.starts_with("it") => 0,
            Figure::High if name.starts_with('v') => base + 1,
            Figure::High => base,
            Figure::Low | Figure::Likely => base - u64::from(overlaps),
        };
        let refill = match figure {
            _ if !jumps => 0,
            Figure::Low => 1,
            Figure::Likely => REFILL,
            Figure::High => 3,
        };
        // Something else is next, and the instruction cannot jump: an interrupt.
        let exception = match figure {
            _ if !is_elsewhere || jumps || next.is_none() => 0,
            Figure::Low | Figure::Likely => EXCEPTION,
            Figure::High => LONGEST_EXCEPTION,
        };
        core + refill + exception + unaligned(instruction, executed.loads)
    }
}

/// Bytes that a load takes from its address on.
fn bytes_loaded(instruction: &Instruction) -> u32 {
    let name = instruction.mnemonic.split('.').next().unwrap_or_default();
    if let Some(registers) = registers_moved(instruction) {
        return 4 * registers as u32;
    }
    match name {
        "ldrb" | "ldrsb" | "tbb" => 1,
        "ldrh" | "ldrsh" | "tbh" => 2,
        "vldr" if instruction.operands.starts_with('d') => 8,
        _ => 4,
    }
}

/// The cycles more of a load whose address is not a multiple of its size: one for two parts, two for three
/// (ARM DDI 0439, section 3.3.3).
fn unaligned(instruction: &Instruction, address: u32) -> u64 {
    if address == 0 || !is_load(instruction) {
        return 0;
    }
    match (bytes_loaded(instruction), address % 4) {
        (4, 2) | (2, 1 | 3) => 1,
        (4, 1 | 3) => 2,
        _ => 0,
    }
}

/// Whether an instruction may go elsewhere than to the one behind it.
fn may_jump(instruction: &Instruction) -> bool {
    let name = instruction.mnemonic.split('.').next().unwrap_or_default();
    let writes_pc = instruction.operands.starts_with("pc")
        || (registers_moved(instruction).is_some() && instruction.operands.contains("pc}"));
    instruction.is_branch()
        || name.starts_with("cb")
        || name.starts_with("tb")
        || name == "svc"
        || writes_pc
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
    use super::*;

    /// The instructions at these addresses in RAM, one after the other.
    fn path(addresses: &[u32]) -> Vec<Executed> {
        let executed = |&address| Executed { address, loads: 0 };
        addresses.iter().map(executed).collect()
    }

    /// A loop like that of the inner product runs four times. The expected cycles are those of the manual,
    /// for 10 instructions.
    #[test]
    fn a_loop_takes_the_cycles_of_the_manual() {
        let program = Program::of_lines(
            "20000100: e8f1 2302 	ldrd	r2, r3, [r1], #8
             20000104: f850 4b04 	ldr	r4, [r0], #4
             20000108: f850 5b04 	ldr	r5, [r0], #4
             2000010c: fb24 6602 	smlad	r6, r4, r2, r6
             20000110: fb25 6603 	smlad	r6, r5, r3, r6
             20000114: 3f01      	subs	r7, #1
             20000116: d1f3      	bne	0x20000100 <dot>
             20000118: eeb1 0ac0 	vsqrt.f32	s0, s0
             2000011c: bd70      	pop	{r4, r5, r6, pc}",
        );
        let turn = [0x100, 0x104, 0x108, 0x10c, 0x110, 0x114, 0x116];
        let all = [&turn[..], &turn, &turn, &turn, &[0x118, 0x11c]].concat();
        let all: Vec<u32> = all.into_iter().map(|at| 0x2000_0000 + at).collect();
        // LDRD 3, LDR 2 less 1 for the LDR behind it, which has 2, SMLAD, SMLAD, SUBS, BNE 1 and 3 times 2
        // more; VSQRT; POP.
        let expected = 4 * (3 + 1 + 2 + 1 + 1 + 1 + 1) + 3 * 2 + 14 + (1 + 4 + 2);
        assert_eq!(Model::of(&program).range(&path(&all)).likely, expected);
    }

    #[test]
    fn a_load_waits_for_its_address() {
        let program = Program::of_lines(
            "20000100: 6808 	ldr	r0, [r1]
             20000102: 6843 	ldr	r3, [r0, #4]
             20000104: 6053 	str	r3, [r2, #4]
             20000106: 4770 	bx	lr",
        );
        let model = Model::of(&program);
        let from = |first: usize| {
            let all = [0x2000_0100, 0x2000_0102, 0x2000_0104, 0x2000_0106];
            model.range(&path(&all[first..])).likely
        };
        // A load that the next one waits for, one that a store does not wait for, and a store.
        assert_eq!(
            [0, 1, 2].map(|first| from(first) - from(first + 1)),
            [2, 1, 1]
        );
    }

    #[test]
    fn the_range_holds_the_manual_s_cycles() {
        let program = Program::of_lines(
            "20000000: 6808 	ldr	r0, [r1]
             20000002: 6843 	ldr	r3, [r4, #4]
             20000004: fb90 f0f1 	sdiv	r0, r0, r1
             20000008: eeb1 0ac0 	vsqrt.f32	s0, s0
             2000000c: d1f3      	bne	0x20000000 <x>",
        );
        let model = Model::of(&program);
        let turn = [
            0x2000_0000,
            0x2000_0002,
            0x2000_0004,
            0x2000_0008,
            0x2000_000c,
        ];
        let range = model.range(&path(&turn));
        // In RAM, so flash does not wait. Two loads, SDIV, VSQRT, and a branch back.
        assert_eq!(
            range,
            Range {
                low: 1 + 2 + 2 + 14 + 2,
                likely: 1 + 2 + 8 + 14 + 3,
                high: 2 + 2 + 12 + 15 + 4,
            }
        );
        // An interrupt after the first load, at the second load's cost.
        let mut interrupted = turn.to_vec();
        interrupted.insert(1, 0x2000_1000);
        let with = model.range(&path(&interrupted));
        // The loads overlap no more, and the handler's instruction takes one.
        assert_eq!(with.likely, range.likely + 1 + EXCEPTION + 1);
        assert_eq!(with.high, range.high + LONGEST_EXCEPTION + 1);
    }

    #[test]
    fn words_at_odd_addresses_take_longer() {
        let program = Program::of_lines("20000000: 6808 	ldr	r0, [r1]");
        let model = Model::of(&program);
        let cycles = |loads| {
            let address = 0x2000_0000;
            model.range(&[Executed { address, loads }]).likely
        };
        assert_eq!(
            [0x2000_1000, 0x2000_1002, 0x2000_1001].map(cycles),
            [2, 3, 4]
        );
        // From flash, with five wait states.
        assert_eq!(cycles(0x0800_1000), 7);
    }
}
