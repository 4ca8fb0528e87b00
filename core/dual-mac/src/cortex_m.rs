//! Inner products, sums and responses in assembly.
//!
//! Both inner products: LDM loads registers in the order of their numbers. So the assembly names r2, r4, r5
//! and r8, and r3 for the counter. LDM also advances its address. The compiler chooses a register for the
//! address, but never a register that is named here. SMLAD multiplies the low halves of two words and their
//! high halves; the first of a pair is the low one, because this core is little-endian. The options: the
//! assembly reads its slices and nothing else (`readonly`), writes no memory and has no other effect
//! (`pure`), and leaves the stack alone (`nostack`). It changes the flags (SUBS, TST, ANDS, and Q where a sum
//! wraps), so `preserves_flags` is not among the options.

use core::arch::asm;

use crate::portable::{BLOCK, Pair, Pairs, SixPairs};

// The layout of the weights that the assembly relies on.
const _: () = assert!(size_of::<Pair>() == 4 && align_of::<Pair>() == 4);
const _: () = assert!(size_of::<Pairs>() == 8 && align_of::<Pairs>() == 4);

/// Four pairs of samples in one inner product.
macro_rules! four_pairs {
    () => {
        "ldm {weight}!, {{r2, r4, r5, r8}}
        ldr {x}, [{sample}], #4
        ldr {y}, [{sample}], #4
        smlad {sum}, {x}, r2, {sum}
        smlad {sum}, {y}, r4, {sum}
        ldr {x}, [{sample}], #4
        ldr {y}, [{sample}], #4
        smlad {sum}, {x}, r5, {sum}
        smlad {sum}, {y}, r8, {sum}"
    };
}

/// Two pairs of samples in two inner products.
macro_rules! two_pairs {
    () => {
        "ldm {weight}!, {{r2, r4, r5, r8}}
        ldr {x}, [{sample}], #4
        ldr {y}, [{sample}], #4
        smlad {first}, {x}, r2, {first}
        smlad {second}, {x}, r4, {second}
        smlad {first}, {y}, r5, {first}
        smlad {second}, {y}, r8, {second}"
    };
}

/// See [`crate::portable::dot`].
#[inline(always)]
pub fn dot(samples: &[u16], weights: &[Pair]) -> i32 {
    let pairs = (samples.len() / 2).min(weights.len());
    let sum: i32;
    // SAFETY: 4 bytes are read `pairs` times from each slice, and both slices are that long; nothing is read
    // if `pairs` is 0. LDR takes any address of normal memory, as long as CCR.UNALIGN_TRP is clear, as it is
    // from reset; samples are aligned to 2 bytes. LDM takes a multiple of 4, which `Pair` is aligned to.
    // Nothing is written.
    unsafe {
        asm!(
            // Eight pairs at a time, then four, then the rest.
            "movs {sum}, #0",
            "subs r3, #8",
            "blo 3f",
            "2:",
            four_pairs!(),
            four_pairs!(),
            "subs r3, #8",
            "bhs 2b",
            "3:",
            // r3 is eight less than the number of pairs left. The three low bits of both are the same.
            "tst r3, #4",
            "beq 4f",
            four_pairs!(),
            "4:",
            "ands r3, #3",
            "beq 6f",
            "5:",
            "ldr r2, [{weight}], #4",
            "ldr {x}, [{sample}], #4",
            "smlad {sum}, {x}, r2, {sum}",
            "subs r3, #1",
            "bne 5b",
            "6:",
            inout("r3") pairs => _,
            sample = inout(reg) samples.as_ptr() => _,
            weight = inout(reg) weights.as_ptr() => _,
            sum = out(reg) sum,
            x = out(reg) _,
            y = out(reg) _,
            out("r2") _,
            out("r4") _,
            out("r5") _,
            out("r8") _,
            options(readonly, nostack, pure),
        );
    }
    sum
}

/// See [`crate::portable::dot2`].
#[inline(always)]
pub fn dot2(samples: &[u16], weights: &[Pairs]) -> (i32, i32) {
    let pairs = (samples.len() / 2).min(weights.len());
    let (first, second): (i32, i32);
    // SAFETY: `pairs` times 4 bytes are read from the samples and 8 from the weights, and both slices are
    // that long. Addresses are as in `dot`, and `Pairs` is aligned to 4 bytes. Nothing is written.
    unsafe {
        asm!(
            // Eight pairs at a time, then four, then the rest.
            "movs {first}, #0",
            "movs {second}, #0",
            "subs r3, #8",
            "blo 3f",
            "2:",
            two_pairs!(),
            two_pairs!(),
            two_pairs!(),
            two_pairs!(),
            "subs r3, #8",
            "bhs 2b",
            "3:",
            // r3 is eight less than the number of pairs left. The three low bits of both are the same.
            "tst r3, #4",
            "beq 4f",
            two_pairs!(),
            two_pairs!(),
            "4:",
            "ands r3, #3",
            "beq 6f",
            "5:",
            "ldm {weight}!, {{r2, r4}}",
            "ldr {x}, [{sample}], #4",
            "smlad {first}, {x}, r2, {first}",
            "smlad {second}, {x}, r4, {second}",
            "subs r3, #1",
            "bne 5b",
            "6:",
            inout("r3") pairs => _,
            sample = inout(reg) samples.as_ptr() => _,
            weight = inout(reg) weights.as_ptr() => _,
            first = out(reg) first,
            second = out(reg) second,
            x = out(reg) _,
            y = out(reg) _,
            out("r2") _,
            out("r4") _,
            out("r5") _,
            out("r8") _,
            options(readonly, nostack, pure),
        );
    }
    (first, second)
}

/// See [`crate::portable::upper_product`]. The compiler knows this instruction, but turns the shift to the
/// left that mostly follows it into four instructions.
#[inline(always)]
pub fn upper_product(a: i32, b: i32) -> i32 {
    let product: i32;
    // SAFETY: the instruction reads and writes registers.
    unsafe {
        asm!(
            "smmul {product}, {a}, {b}",
            product = lateout(reg) product,
            a = in(reg) a,
            b = in(reg) b,
            options(pure, nomem, nostack, preserves_flags),
        );
    }
    product
}

/// A sum and the upper half of a product. Wraps.
#[inline(always)]
pub fn add_upper_product(sum: i32, a: i32, b: i32) -> i32 {
    let more: i32;
    // SAFETY: the instruction reads and writes registers.
    unsafe {
        asm!(
            "smmla {more}, {a}, {b}, {sum}",
            more = lateout(reg) more,
            sum = in(reg) sum,
            a = in(reg) a,
            b = in(reg) b,
            options(pure, nomem, nostack, preserves_flags),
        );
    }
    more
}

/// The products of three columns with each other and with themselves.
macro_rules! triangle {
    () => {
        "smlad {a}, r4, r4, {a}
        smlad {b}, r4, r5, {b}
        smlad {c}, r5, r5, {c}
        smlad {d}, r4, r2, {d}
        smlad {e}, r5, r2, {e}
        smlad {f}, r2, r2, {f}"
    };
}

/// Runs over the rows of [`gram`]: adds products of some columns to as many sums.
macro_rules! products {
    ($rows:expr, $code:expr, $($sum:ident)*) => {{
        $(let mut $sum = 0i32;)*
        if !$rows.is_empty() {
            // SAFETY: each turn reads four bytes from some of the six columns of a row, and there are as many
            // turns as rows. LDRD takes a multiple of 4, which they are aligned to. Nothing is written.
            unsafe {
                asm!(
                    "2:",
                    $code,
                    "subs r3, #1",
                    "bne 2b",
                    inout("r3") $rows.len() => _,
                    row = inout(reg) $rows.as_ptr() => _,
                    $($sum = inout(reg) $sum,)*
                    out("r4") _,
                    out("r5") _,
                    out("r2") _,
                    options(readonly, nostack, pure),
                );
            }
        }
        [$($sum),*]
    }};
}

/// See [`crate::portable::gram`].
#[inline(never)]
pub fn gram(rows: &[SixPairs]) -> [i32; 21] {
    const { assert!(size_of::<SixPairs>() == 24 && align_of::<SixPairs>() == 4) };
    let [s00, s10, s11, s20, s21, s22] = products!(
        rows,
        concat!("ldr r2, [{row}, #8]\n", "ldrd r4, r5, [{row}], #24\n", triangle!()),
        a b c d e f
    );
    let [s33, s43, s44, s53, s54, s55] = products!(
        rows,
        concat!(
            "ldr r2, [{row}, #20]\n",
            "ldrd r4, r5, [{row}, #12]\n",
            "add {row}, #24\n",
            triangle!()
        ),
        a b c d e f
    );
    let [s30, s31, s40, s41, s50, s51] = products!(
        rows,
        "ldrd r4, r5, [{row}]
        ldr r2, [{row}, #12]
        smlad {a}, r4, r2, {a}
        smlad {b}, r5, r2, {b}
        ldr r2, [{row}, #16]
        smlad {c}, r4, r2, {c}
        smlad {d}, r5, r2, {d}
        ldr r2, [{row}, #20]
        add {row}, #24
        smlad {e}, r4, r2, {e}
        smlad {f}, r5, r2, {f}",
        a b c d e f
    );
    let [s32, s42, s52] = products!(
        rows,
        "ldrd r4, r5, [{row}, #8]
        smlad {a}, r4, r5, {a}
        ldrd r5, r2, [{row}, #16]
        add {row}, #24
        smlad {b}, r4, r5, {b}
        smlad {c}, r4, r2, {c}",
        a b c
    );
    [
        s00, s10, s11, s20, s21, s22, s30, s31, s32, s33, s40, s41, s42, s43, s44, s50, s51, s52,
        s53, s54, s55,
    ]
}

/// A block of eight samples: its bits and its sum.
macro_rules! one_block {
    () => {
        "ldm {sample}!, {{r2, r4, r5, r8}}
        orr {bits}, {bits}, r2
        add {x}, r2, r4
        orr {bits}, {bits}, r4
        orr {bits}, {bits}, r5
        add {x}, {x}, r5
        orr {bits}, {bits}, r8
        add {x}, {x}, r8
        smlad {x}, {x}, {weights}, {constant}
        strh {x}, [{sum}], #2"
    };
}

/// See [`crate::portable::sum_blocks`]. Twice as fast where the samples are aligned to 4 bytes.
#[inline(never)]
pub fn sum_blocks(blocks: &[[u16; BLOCK]], weights: Pair, constant: u16, sums: &mut [u16]) -> u16 {
    let number = blocks.len().min(sums.len());
    if !blocks.as_ptr().cast::<u32>().is_aligned() {
        return crate::portable::sum_blocks(blocks, weights, constant, sums);
    }
    let bits: u32;
    // SAFETY: 16 bytes are read `number` times from the blocks, and 2 are written to the sums; both slices
    // are that long, and do not overlap. LDM takes the address, which is a multiple of 4.
    unsafe {
        asm!(
            // Four blocks at a time, then the rest.
            "movs {bits}, #0",
            "subs r3, #4",
            "blo 3f",
            "2:",
            one_block!(),
            one_block!(),
            one_block!(),
            one_block!(),
            "subs r3, #4",
            "bhs 2b",
            "3:",
            // r3 is four less than the number of blocks left. The two low bits of both are the same.
            "ands r3, #3",
            "beq 5f",
            "4:",
            one_block!(),
            "subs r3, #1",
            "bne 4b",
            "5:",
            inout("r3") number => _,
            sample = inout(reg) blocks.as_ptr() => _,
            sum = inout(reg) sums.as_mut_ptr() => _,
            weights = in(reg) u32::from(weights.0.cast_unsigned())
                | u32::from(weights.1.cast_unsigned()) << 16,
            constant = in(reg) u32::from(constant),
            bits = out(reg) bits,
            x = out(reg) _,
            out("r2") _,
            out("r4") _,
            out("r5") _,
            out("r8") _,
            options(nostack),
        );
    }
    ((bits | bits >> 16) & 0xffff) as u16
}

/// The steps of two fours: SSUB16 subtracts both from both, and remembers for SEL which result is positive.
macro_rules! two_steps {
    () => {
        "ldr {x}, [{sample}], #8
        ldr {y}, [{sample}], #8
        pkhbt {firsts}, {x}, {y}, lsl #16
        pkhtb {seconds}, {y}, {x}, asr #16
        ssub16 {x}, {firsts}, {seconds}
        ssub16 {y}, {seconds}, {firsts}
        sel {x}, {y}, {x}
        smlad {sum}, {x}, {ones}, {sum}"
    };
}

/// See [`crate::portable::sum_of_steps`].
#[inline(always)]
pub fn sum_of_steps(fours: &[[u16; 4]]) -> u32 {
    let (many, rest) = fours.as_chunks::<4>();
    if many.is_empty() {
        return crate::portable::sum_of_steps(rest);
    }
    let sum: u32;
    // SAFETY: 32 bytes are read for each four of fours. Addresses are as in `dot`. Nothing is written.
    unsafe {
        asm!(
            "movs {sum}, #0",
            "2:",
            two_steps!(),
            two_steps!(),
            "subs r3, #1",
            "bne 2b",
            inout("r3") many.len() => _,
            sample = inout(reg) many.as_ptr() => _,
            ones = in(reg) 0x0001_0001,
            sum = out(reg) sum,
            x = out(reg) _,
            y = out(reg) _,
            firsts = out(reg) _,
            seconds = out(reg) _,
            options(readonly, nostack, pure),
        );
    }
    sum.wrapping_add(crate::portable::sum_of_steps(rest))
}

/// See [`crate::portable::blocks_at_most`].
#[inline(never)]
pub fn blocks_at_most(blocks: &[[u16; BLOCK]], limit: u16) -> usize {
    if blocks.is_empty() {
        return 0;
    }
    let left: usize;
    // SAFETY: 16 bytes are read at most `blocks.len()` times. Addresses are as in `dot`. Nothing is written.
    unsafe {
        asm!(
            // UQSUB16 leaves zero of a sample at or below the limit.
            "2:",
            "ldr r2, [{sample}], #4",
            "ldr r4, [{sample}], #4",
            "ldr {x}, [{sample}], #4",
            "ldr {y}, [{sample}], #4",
            "uqsub16 r2, r2, {limit}",
            "uqsub16 r4, r4, {limit}",
            "uqsub16 {x}, {x}, {limit}",
            "uqsub16 {y}, {y}, {limit}",
            "orr r2, r2, r4",
            "orr {x}, {x}, {y}",
            "orrs r2, r2, {x}",
            "bne 3f",
            "subs r3, #1",
            "bne 2b",
            "3:",
            inout("r3") blocks.len() => left,
            sample = inout(reg) blocks.as_ptr() => _,
            limit = in(reg) u32::from(limit) | u32::from(limit) << 16,
            x = out(reg) _,
            y = out(reg) _,
            out("r2") _,
            out("r4") _,
            options(readonly, nostack, pure),
        );
    }
    blocks.len().wrapping_sub(left)
}

/// The results of an instruction for the pairs in eight samples.
macro_rules! four_results {
    ($instruction:literal) => {
        concat! {
            "ldr r2, [{sample}], #4\n",
            "ldr r4, [{sample}], #4\n",
            "pkhbt {x}, r2, r4, lsl #16\n",
            "pkhtb {y}, r4, r2, asr #16\n",
            $instruction, " {x}, {x}, {y}\n",
            "ldr r2, [{sample}], #4\n",
            "ldr r4, [{sample}], #4\n",
            "str {x}, [{result}], #4\n",
            "pkhbt {x}, r2, r4, lsl #16\n",
            "pkhtb {y}, r4, r2, asr #16\n",
            $instruction, " {x}, {x}, {y}\n",
            "str {x}, [{result}], #4\n",
            "subs r3, #1",
        }
    };
}

/// See [`crate::portable::sum_pairs`].
#[inline(never)]
pub fn sum_pairs(samples: &[u16], sums: &mut [u16]) {
    let eights = (samples.len() / 8).min(sums.len() / 4);
    if eights > 0 {
        // SAFETY: 16 bytes are read `eights` times from the samples, and 8 are written to the sums; both
        // slices are that long, and do not overlap. Addresses are as in `dot`.
        unsafe {
            asm!(
                "2:",
                four_results!("uadd16"),
                "bne 2b",
                inout("r3") eights => _,
                sample = inout(reg) samples.as_ptr() => _,
                result = inout(reg) sums.as_mut_ptr() => _,
                x = out(reg) _,
                y = out(reg) _,
                out("r2") _,
                out("r4") _,
                options(nostack),
            );
        }
    }
    let samples = samples.get(8 * eights..).unwrap_or_default();
    crate::portable::sum_pairs(samples, sums.get_mut(4 * eights..).unwrap_or_default());
}

/// See [`crate::portable::halve`].
#[inline(never)]
pub fn halve(samples: &mut [u16]) -> usize {
    let eights = samples.len() / 8;
    if eights > 0 {
        let start = samples.as_mut_ptr();
        // SAFETY: 16 bytes are read `eights` times from the samples, which are that long, and 8 are written
        // to places that were read before. Addresses are as in `dot`.
        unsafe {
            asm!(
                "2:",
                four_results!("uhadd16"),
                "bne 2b",
                inout("r3") eights => _,
                sample = inout(reg) start => _,
                result = inout(reg) start => _,
                x = out(reg) _,
                y = out(reg) _,
                out("r2") _,
                out("r4") _,
                options(nostack),
            );
        }
    }
    crate::portable::halve_from(samples, 4 * eights)
}

/// Two responses of the kernel [1 2 1]: their middles are the second sample of the pair `$before` and the
/// first one of the pair `$here`. Each is subtracted from `below` in two steps.
macro_rules! two_responses {
    ($before:literal, $here:literal) => {
        concat! {
            "ldr ", $here, ", [{sample}], #4\n",
            "smlad {x}, ", $before, ", {one_two}, {below}\n",
            "smlad {y}, ", $before, ", {none_one}, {below}\n",
            "smlad {x}, ", $here, ", {one_none}, {x}\n",
            "smlad {y}, ", $here, ", {two_one}, {y}\n",
            "orr {signs}, {signs}, {x}\n",
            "orr {signs}, {signs}, {y}",
        }
    };
}

/// See [`crate::portable::reaches`].
#[inline(never)]
pub fn reaches(samples: &[u16], least: i32) -> bool {
    const fn negative(even: i16, odd: i16) -> u32 {
        (-even).cast_unsigned() as u32 | ((-odd).cast_unsigned() as u32) << 16
    }
    let (pairs, rest) = samples.as_chunks::<2>();
    let Some(steps) = pairs.len().checked_sub(1) else {
        return false;
    };
    let signs: u32;
    // SAFETY: 4 bytes are read once and then `steps` times: the pairs are as many. Addresses are as in `dot`.
    // Nothing is written.
    unsafe {
        asm!(
            // Two pairs at a time, then the last one.
            "movs {signs}, #0",
            "ldr r2, [{sample}], #4",
            "subs r3, #2",
            "blo 3f",
            "2:",
            two_responses!("r2", "r4"),
            two_responses!("r4", "r2"),
            "subs r3, #2",
            "bhs 2b",
            "3:",
            // r3 is two less than the number of pairs left. The lowest bit of both is the same.
            "tst r3, #1",
            "beq 4f",
            two_responses!("r2", "r4"),
            "4:",
            inout("r3") steps => _,
            sample = inout(reg) samples.as_ptr() => _,
            below = in(reg) least.wrapping_sub(1),
            one_two = in(reg) negative(1, 2),
            none_one = in(reg) negative(0, 1),
            one_none = in(reg) negative(1, 0),
            two_one = in(reg) negative(2, 1),
            signs = out(reg) signs,
            x = out(reg) _,
            y = out(reg) _,
            out("r2") _,
            out("r4") _,
            options(readonly, nostack, pure),
        );
    }
    let last = (samples.get(samples.len().saturating_sub(3)..)).unwrap_or_default();
    (signs as i32) < 0 || !rest.is_empty() && crate::portable::reaches(last, least)
}
