//! Where an instruction loads from: decoded from its machine code (ARM DDI 0403, the encodings of ARMv7-M).
//!
//! Only loads that can reach flash are decoded. A load with the stack pointer as its base reaches RAM.

/// The stack pointer's number.
const SP: usize = 13;
/// The program counter's number.
const PC: usize = 15;

/// The first address that the instruction at `pc` loads from; `None` if it loads nothing, or by the stack
/// pointer. `halfwords` are the instruction's first two, and `register` gives the value of a register before
/// the instruction.
pub(crate) fn address(
    halfwords: [u16; 2],
    pc: u32,
    register: impl Fn(usize) -> u32,
) -> Option<u32> {
    let [first, second] = halfwords.map(u32::from);
    let load = match first >> 11 {
        0b11101..=0b11111 => wide(first, second),
        _ => narrow(first),
    }?;
    let base = match load.base {
        SP => return None,
        // Word-aligned, four bytes ahead.
        PC => (pc + 4) & !3,
        number => register(number),
    };
    let index = load
        .index
        .map_or(0, |(number, shift)| register(number) << shift);
    Some(base.wrapping_add(index).wrapping_add_signed(load.offset))
}

/// An address: a base register, an index register with its shift, and an offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Load {
    base: usize,
    index: Option<(usize, u32)>,
    offset: i32,
}

impl Load {
    fn at(base: u32, offset: i32) -> Option<Self> {
        Some(Self {
            base: base as usize,
            index: None,
            offset,
        })
    }

    fn indexed(base: u32, index: u32, shift: u32) -> Option<Self> {
        Some(Self {
            base: base as usize,
            index: Some((index as usize, shift)),
            offset: 0,
        })
    }
}

/// Bits of a halfword from `from`, `count` of them.
fn bits(halfword: u32, from: u32, count: u32) -> u32 {
    halfword >> from & ((1 << count) - 1)
}

/// An instruction of 16 bits.
fn narrow(code: u32) -> Option<Load> {
    let (base, five) = (bits(code, 3, 3), bits(code, 6, 5) as i32);
    match code >> 11 {
        // LDR, literal.
        0b01001 => Load::at(PC as u32, 4 * bits(code, 0, 8) as i32),
        // LDRSB, LDR, LDRH, LDRB, LDRSH with an index. The three codes below are stores.
        0b01010 | 0b01011 if bits(code, 9, 3) >= 3 => Load::indexed(base, bits(code, 6, 3), 0),
        // LDR, LDRB, LDRH.
        0b01101 => Load::at(base, 4 * five),
        0b01111 => Load::at(base, five),
        0b10001 => Load::at(base, 2 * five),
        // LDM.
        0b11001 => Load::at(bits(code, 8, 3), 0),
        _ => None,
    }
}

/// An instruction of 32 bits.
fn wide(first: u32, second: u32) -> Option<Load> {
    let (base, adds) = (bits(first, 0, 4), bits(first, 7, 1) == 1);
    let signed = |size: u32| {
        let size = size as i32;
        if adds { size } else { -size }
    };
    let before = bits(first, 8, 1) == 1;
    let loads = bits(first, 4, 1) == 1;
    if !loads {
        return None;
    }
    match first >> 9 {
        // LDM, LDMDB.
        0b111_0100 if bits(first, 6, 1) == 0 => {
            let down = -4 * second.count_ones() as i32;
            Load::at(base, if before { down } else { 0 })
        }
        // TBB, TBH.
        0b111_0100 if bits(first, 5, 4) == 0b0110 && second >> 4 == 0xF00 => {
            Load::indexed(base, bits(second, 0, 4), 0)
        }
        0b111_0100 if bits(first, 5, 4) == 0b0110 && second >> 4 == 0xF01 => {
            Load::indexed(base, bits(second, 0, 4), 1)
        }
        // LDRD. Without an offset before and without write-back it is an exclusive load, of RAM.
        0b111_0100 if before || bits(first, 5, 1) == 1 => {
            let offset = signed(4 * bits(second, 0, 8));
            Load::at(base, if before { offset } else { 0 })
        }
        // VLDR, and VLDM, which counts down only with write-back.
        0b111_0110 if bits(second, 9, 3) == 0b101 => {
            let offset = signed(4 * bits(second, 0, 8));
            let is_down = !adds && bits(first, 5, 1) == 1;
            let is_single = before && bits(first, 5, 1) == 0;
            Load::at(base, if is_single || is_down { offset } else { 0 })
        }
        // LDR, LDRB, LDRH and their signed forms.
        0b111_1100 => {
            if base as usize == PC {
                return Load::at(base, signed(bits(second, 0, 12)));
            }
            if adds {
                return Load::at(base, bits(second, 0, 12) as i32);
            }
            if bits(second, 6, 6) == 0 {
                return Load::indexed(base, bits(second, 0, 4), bits(second, 4, 2));
            }
            let size = bits(second, 0, 8) as i32;
            match (bits(second, 11, 1), bits(second, 10, 1), bits(second, 9, 1)) {
                (1, 1, 1) => Load::at(base, size),
                (1, 1, 0) => Load::at(base, -size),
                (1, 0, _) => Load::at(base, 0),
                _ => None,
            }
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Registers whose value is 0x1000 times their number.
    fn loads_from(halfwords: [u16; 2]) -> Option<u32> {
        address(halfwords, 0x0800_0102, |number| 0x1000 * number as u32)
    }

    /// The codes are those that the assembler of LLVM makes.
    #[test]
    fn loads_are_decoded() {
        for (halfwords, expected, text) in [
            ([0x4A02, 0], 0x0800_010C, "ldr r2, [pc, #8]"),
            ([0x5888, 0], 0x3000, "ldr r0, [r1, r2]"),
            ([0x5E88, 0], 0x3000, "ldrsh r0, [r1, r2]"),
            ([0x6888, 0], 0x1008, "ldr r0, [r1, #8]"),
            ([0x7888, 0], 0x1002, "ldrb r0, [r1, #2]"),
            ([0x8888, 0], 0x1004, "ldrh r0, [r1, #4]"),
            ([0xC90C, 0], 0x1000, "ldm r1!, {r2, r3}"),
            ([0xE8F1, 0x2302], 0x1000, "ldrd r2, r3, [r1], #8"),
            ([0xE9D1, 0x2302], 0x1008, "ldrd r2, r3, [r1, #8]"),
            ([0xE951, 0x2302], 0x0FF8, "ldrd r2, r3, [r1, #-8]"),
            ([0xF850, 0x4B04], 0x0000, "ldr r4, [r0], #4"),
            ([0xF8D1, 0x0010], 0x1010, "ldr.w r0, [r1, #16]"),
            ([0xF851, 0x0C04], 0x0FFC, "ldr r0, [r1, #-4]"),
            ([0xF851, 0x0F04], 0x1004, "ldr r0, [r1, #4]!"),
            ([0xF851, 0x0022], 0x9000, "ldr.w r0, [r1, r2, lsl #2]"),
            ([0xF9B1, 0x0002], 0x1002, "ldrsh.w r0, [r1, #2]"),
            ([0xF8DF, 0x0008], 0x0800_010C, "ldr.w r0, [pc, #8]"),
            ([0xED91, 0x0A02], 0x1008, "vldr s0, [r1, #8]"),
            ([0xED11, 0x0A02], 0x0FF8, "vldr s0, [r1, #-8]"),
            ([0xECB1, 0x0A02], 0x1000, "vldmia r1!, {s0, s1}"),
            ([0xE8DF, 0xF001], 0x0800_0104 + 0x1000, "tbb [pc, r1]"),
            (
                [0xE8DF, 0xF011],
                0x0800_0104 + 0x2000,
                "tbh [pc, r1, lsl #1]",
            ),
            ([0xE891, 0x000C], 0x1000, "ldm.w r1, {r2, r3}"),
        ] {
            assert_eq!(loads_from(halfwords), Some(expected), "{text}");
        }
        for (halfwords, text) in [
            ([0x9801, 0], "ldr r0, [sp, #4]"),
            ([0xF8DD, 0x0004], "ldr.w r0, [sp, #4]"),
            ([0xBD70, 0], "pop {r4, r5, r6, pc}"),
            ([0xE8BD, 0x87F0], "pop.w {r4-r10, pc}"),
            ([0x6088, 0], "str r0, [r1, #8]"),
            ([0x5088, 0], "str r0, [r1, r2]"),
            ([0xF8C1, 0x0010], "str.w r0, [r1, #16]"),
            ([0xE9C1, 0x2302], "strd r2, r3, [r1, #8]"),
            ([0xED81, 0x0A02], "vstr s0, [r1, #8]"),
            ([0xFB24, 0x6602], "smlad r6, r4, r2, r6"),
            ([0xF7FF, 0xFFFE], "bl"),
            ([0x1840, 0], "adds r0, r0, r1"),
        ] {
            assert_eq!(loads_from(halfwords), None, "{text}");
        }
    }
}
