//! The inner products and the square root in assembly.
//!
//! Both inner products: LDM loads registers in the order of their numbers. So the assembly names r2, r4, r5
//! and r8, and r3 for the counter. LDM also advances its address. The compiler chooses a register for the
//! address, but never a register that is named here. SMLAD multiplies the low halves of two words and their
//! high halves; the first of a pair is the low one, because this core is little-endian. The options: the
//! assembly reads the two slices and nothing else (`readonly`), writes no memory and has no other effect
//! (`pure`), and leaves the stack alone (`nostack`). It changes the flags (SUBS, TST, ANDS, and Q where a sum
//! wraps), so `preserves_flags` is not among the options.

use core::arch::asm;

#[cfg(has_dsp)]
use crate::{BLOCK, PART, Pair, Pairs};

// The layout of the weights that the assembly relies on.
#[cfg(has_dsp)]
const _: () = assert!(size_of::<Pair>() == 4 && align_of::<Pair>() == 4);
#[cfg(has_dsp)]
const _: () = assert!(size_of::<Pairs>() == 8 && align_of::<Pairs>() == 4);

/// Four pairs of samples in one inner product.
#[cfg(has_dsp)]
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
#[cfg(has_dsp)]
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
#[cfg(has_dsp)]
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
#[cfg(has_dsp)]
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

/// A block of eight samples: its bits and its sum.
#[cfg(has_dsp)]
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
#[cfg(has_dsp)]
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
            weights = in(reg) u32::from(weights.0 as u16) | u32::from(weights.1 as u16) << 16,
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
    (bits | bits >> 16) as u16
}

/// The steps of two fours: SSUB16 subtracts both from both, and remembers for SEL which result is positive.
#[cfg(has_dsp)]
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
#[cfg(has_dsp)]
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

/// Two responses of the kernel [1 2 1]: their middles are the second sample of the pair `$before` and the
/// first one of the pair `$here`. Each is subtracted from `below` in two steps.
#[cfg(has_dsp)]
macro_rules! two_responses {
    ($before:literal, $here:literal) => {
        concat!(
            "ldr ",
            $here,
            ", [{sample}], #4\n",
            "smlad {x}, ",
            $before,
            ", {one_two}, {below}\n",
            "smlad {y}, ",
            $before,
            ", {none_one}, {below}\n",
            "smlad {x}, ",
            $here,
            ", {one_none}, {x}\n",
            "smlad {y}, ",
            $here,
            ", {two_one}, {y}\n",
            "orr {signs}, {signs}, {x}\n",
            "orr {signs}, {signs}, {y}",
        )
    };
}

/// See [`crate::portable::reaches`].
#[cfg(has_dsp)]
#[inline(never)]
pub fn reaches(samples: &[u16], least: i32) -> bool {
    const fn negative(even: i16, odd: i16) -> u32 {
        (-even) as u16 as u32 | ((-odd) as u16 as u32) << 16
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
    let last = samples
        .get(samples.len().saturating_sub(3)..)
        .unwrap_or_default();
    (signs as i32) < 0 || !rest.is_empty() && crate::portable::reaches(last, least)
}

/// One pair of each half of a part, side by side: the first half's pair in the low halves of the registers,
/// the second half's in the high ones. `$here` and `$there` hold the two pairs, and then the pairs' sums and
/// their second samples. `$sums` and `$last` hold what these are of the pairs before; `$last` is lost.
/// `$respond` gets the two sums of neighbours that make a response: in {x} the larger of the pair's sum and
/// the one before it, in `$last` the one between them.
#[cfg(has_dsp)]
macro_rules! one_pair {
    ($sample:ident, $respond:ident, $here:literal, $there:literal, $sums:literal, $last:literal, $free:literal) => {
        concat!(
            // The first samples of both pairs into {x}, the second ones into $there.
            "pkhbt {x}, ",
            $here,
            ", ",
            $there,
            ", lsl #16\n",
            "pkhtb ",
            $there,
            ", ",
            $there,
            ", ",
            $here,
            ", asr #16\n",
            $sample!($there),
            "uadd16 ",
            $last,
            ", ",
            $last,
            ", {x}\n",
            "uadd16 ",
            $here,
            ", {x}, ",
            $there,
            "\n",
            larger!("{x}", $sums, $here, "{x}"),
            $respond!($last, $free),
        )
    };
}

/// The larger of `$a` and `$b`, in both halves: USUB16 remembers for SEL where `$a` is. `$lost` gets the
/// difference, which nobody needs.
#[cfg(has_dsp)]
macro_rules! larger {
    ($larger:literal, $a:literal, $b:literal, $lost:literal) => {
        concat!(
            "usub16 ", $lost, ", ", $a, ", ", $b, "\n", "sel ", $larger, ", ", $a, ", ", $b, "\n",
        )
    };
}

/// Two pairs of each half of a part, from `$low` and `$high` on: they leave what is next before in
/// `$next_sums` and `$next_last`. A word gets the sums of two pairs.
#[cfg(has_dsp)]
macro_rules! two_pairs_of_both {
    (
        $sample:ident, $respond:ident, $low:literal, $high:literal, $sum_low:literal, $sum_high:literal,
        $sums:literal, $last:literal, $next_sums:literal, $next_last:literal
    ) => {
        concat!(
            "ldrd {a}, ",
            $next_sums,
            ", [{words}, #",
            $low,
            "]\n",
            "ldrd {b}, ",
            $next_last,
            ", [{words}, #",
            $high,
            "]\n",
            one_pair!($sample, $respond, "{a}", "{b}", $sums, $last, $sums),
            one_pair!(
                $sample, $respond, $next_sums, $next_last, "{a}", "{b}", $sums
            ),
            "pkhbt {x}, {a}, ",
            $next_sums,
            ", lsl #16\n",
            "pkhtb {a}, ",
            $next_sums,
            ", {a}, asr #16\n",
            "str {x}, [{sum}, #",
            $sum_low,
            "]\n",
            "str {a}, [{sum}, #",
            $sum_high,
            "]\n",
        )
    };
}

/// A part of a sweep: its words start with the pair before it, its sums with the sum of that pair, which it
/// leaves alone.
#[cfg(has_dsp)]
macro_rules! part {
    ($words:expr, $sums:expr, $sample:ident, $respond:ident, $($operand:tt)*) => {
        asm!(
            // The pairs before both halves.
            "ldr {a}, [{words}]",
            "ldr {last}, [{words}, #32]",
            "pkhbt {x}, {a}, {last}, lsl #16",
            "pkhtb {last}, {last}, {a}, asr #16",
            $sample!("{last}"),
            "uadd16 {two}, {x}, {last}",
            two_pairs_of_both!(
                $sample, $respond, 4, 36, 2, 18, "{two}", "{last}", "{next_two}", "{next_last}"
            ),
            two_pairs_of_both!(
                $sample, $respond, 12, 44, 6, 22, "{next_two}", "{next_last}", "{two}", "{last}"
            ),
            two_pairs_of_both!(
                $sample, $respond, 20, 52, 10, 26, "{two}", "{last}", "{next_two}", "{next_last}"
            ),
            two_pairs_of_both!(
                $sample, $respond, 28, 60, 14, 30, "{next_two}", "{next_last}", "{two}", "{last}"
            ),
            words = in(reg) $words,
            sum = in(reg) $sums,
            a = out(reg) _,
            b = out(reg) _,
            x = out(reg) _,
            two = out(reg) _,
            last = out(reg) _,
            next_two = out(reg) _,
            next_last = out(reg) _,
            $($operand)*
            options(nostack),
        )
    };
}

/// Words that are samples.
#[cfg(has_dsp)]
macro_rules! as_it_is {
    ($seconds:literal) => {
        ""
    };
}

/// Words that are samples with an exclusive or.
#[cfg(has_dsp)]
macro_rules! inverted {
    ($seconds:literal) => {
        concat!(
            "eor {x}, {x}, {inverted}\n",
            "eor ",
            $seconds,
            ", ",
            $seconds,
            ", {inverted}\n"
        )
    };
}

/// The responses fit 16 bits: their sum, and the highest.
#[cfg(has_dsp)]
macro_rules! narrow {
    ($between:literal, $free:literal) => {
        concat!(
            "uadd16 {x}, {x}, ",
            $between,
            "\n",
            larger!("{highest}", "{x}", "{highest}", $between),
        )
    };
}

/// The responses have 17 bits. The highest half of one, and the highest half of one that is rounded up, make
/// the highest one.
#[cfg(has_dsp)]
macro_rules! wide {
    ($between:literal, $free:literal) => {
        concat!(
            "uhadd16 ",
            $free,
            ", {x}, ",
            $between,
            "\n",
            "uadd16 ",
            $between,
            ", ",
            $between,
            ", {ones}\n",
            "uhadd16 {x}, {x}, ",
            $between,
            "\n",
            larger!("{highest}", $free, "{highest}", $between),
            larger!("{rounded_up}", "{x}", "{rounded_up}", $between),
        )
    };
}

/// How many whole parts a sweep in assembly takes. Writes the sum of the pair before the first, which no part
/// writes.
#[cfg(has_dsp)]
fn whole_parts(words: &[u16], inverted: u16, sums: &mut [u16], parts: &[u32]) -> usize {
    let (Some(&[a, b]), Some((sum, sums))) = (words.first_chunk(), sums.split_first_mut()) else {
        return 0;
    };
    if !words.as_ptr().cast::<u32>().is_aligned() {
        return 0;
    }
    *sum = (a ^ inverted).wrapping_add(b ^ inverted);
    let pairs = (words.len() / 2).saturating_sub(1).min(sums.len());
    (pairs / PART).min(parts.len())
}

/// Where a part of a sweep begins: its words and its sums, each with the pair before it.
#[cfg(has_dsp)]
fn part_at(number: usize, words: &[u16], sums: &mut [u16]) -> (*const u16, *mut u16) {
    let pairs = PART.wrapping_mul(number);
    (
        words.as_ptr().wrapping_add(pairs.wrapping_mul(2)),
        sums.as_mut_ptr().wrapping_add(pairs),
    )
}

/// What is left of a sweep behind so many parts, with the pair before it.
#[cfg(has_dsp)]
fn behind<'a>(
    whole: usize,
    words: &'a [u16],
    sums: &'a mut [u16],
    parts: &'a mut [u32],
) -> (&'a [u16], &'a mut [u16], &'a mut [u32]) {
    let pairs = PART.wrapping_mul(whole);
    (
        words.get(pairs.wrapping_mul(2)..).unwrap_or_default(),
        sums.get_mut(pairs..).unwrap_or_default(),
        parts.get_mut(whole..).unwrap_or_default(),
    )
}

/// The larger one of both halves.
#[cfg(has_dsp)]
fn larger_half(both: u32) -> u32 {
    (both & 0xFFFF).max(both >> 16)
}

/// See [`crate::portable::sweep`]. Four times as fast where the words are aligned to 4 bytes.
#[cfg(has_dsp)]
#[inline(never)]
pub fn sweep(words: &[u16], inverted: u16, sums: &mut [u16], parts: &mut [u32]) {
    let whole = whole_parts(words, inverted, sums, parts);
    for (number, part) in parts.iter_mut().take(whole).enumerate() {
        let mut highest = 0u32;
        let (words, sums) = part_at(number, words, sums);
        // SAFETY: a part reads 68 bytes of the words and writes bytes 2 to 33 of the sums: 34 words and 17
        // sums, which both slices hold from every whole part's begin on. LDRD takes the addresses, which are
        // multiples of 4. LDR and STR take any.
        unsafe {
            if inverted == 0 {
                part!(words, sums, as_it_is, narrow, highest = inout(reg) highest,);
            } else {
                part!(
                    words, sums, inverted, narrow,
                    highest = inout(reg) highest,
                    inverted = in(reg) u32::from(inverted) * 0x0001_0001,
                );
            }
        }
        *part = larger_half(highest);
    }
    let (words, sums, parts) = behind(whole, words, sums, parts);
    crate::portable::sweep(words, inverted, sums, parts);
}

/// See [`crate::portable::sweep_wide`]. Twice as fast where the samples are aligned to 4 bytes.
#[cfg(has_dsp)]
#[inline(never)]
pub fn sweep_wide(samples: &[u16], sums: &mut [u16], parts: &mut [u32]) {
    let whole = whole_parts(samples, 0, sums, parts);
    for (number, part) in parts.iter_mut().take(whole).enumerate() {
        let (mut highest, mut rounded_up) = (0u32, 0u32);
        let (words, sums) = part_at(number, samples, sums);
        // SAFETY: as in `sweep`.
        unsafe {
            part!(
                words, sums, as_it_is, wide,
                highest = inout(reg) highest,
                rounded_up = inout(reg) rounded_up,
                ones = in(reg) 0x0001_0001,
            );
        }
        *part = larger_half(highest).wrapping_add(larger_half(rounded_up));
    }
    let (words, sums, parts) = behind(whole, samples, sums, parts);
    crate::portable::sweep_wide(words, sums, parts);
}

/// Two differences to a slope, whose heights at the two samples PKHTB takes from above the binary points.
#[cfg(has_dsp)]
macro_rules! two_below_a_slope {
    () => {
        "ldr {x}, [{word}], #4
            eor {x}, {x}, {inverted}
            pkhtb {heights}, {odd}, {even}, asr #16
            ssub16 {x}, {x}, {heights}
            add {even}, {even}, {two_steps}
            add {odd}, {odd}, {two_steps}
            str {x}, [{difference}], #4
            ssub16 {heights}, {lowest}, {x}
            sel {lowest}, {x}, {lowest}"
    };
}

/// See [`crate::portable::subtract_slope`].
#[cfg(has_dsp)]
#[inline(never)]
pub fn subtract_slope(
    words: &[u16],
    inverted: u16,
    start: i32,
    step: i32,
    differences: &mut [u16],
) -> i16 {
    let number = words.len().min(differences.len());
    let (Some(words), Some(differences)) = (words.get(..number), differences.get_mut(..number))
    else {
        return i16::MAX;
    };
    let (eights, rest) = words.as_chunks::<8>();
    let (eight_differences, rest_differences) = differences.as_chunks_mut::<8>();
    let (mut height, mut lowest) = (start, 0x7FFF_7FFF_u32);
    if !eights.is_empty() {
        // SAFETY: 16 bytes are read from the words and written to the differences for each eight, and both
        // slices are that long. Addresses are as in `dot`; STR takes any, as LDR does.
        unsafe {
            asm!(
                "2:",
                two_below_a_slope!(),
                two_below_a_slope!(),
                two_below_a_slope!(),
                two_below_a_slope!(),
                "subs {number}, #1",
                "bne 2b",
                number = inout(reg) eights.len() => _,
                word = inout(reg) eights.as_ptr() => _,
                difference = inout(reg) eight_differences.as_mut_ptr() => _,
                inverted = in(reg) u32::from(inverted) * 0x0001_0001,
                two_steps = in(reg) step.wrapping_mul(2),
                even = inout(reg) height,
                odd = inout(reg) start.wrapping_add(step) => _,
                lowest = inout(reg) lowest,
                x = out(reg) _,
                heights = out(reg) _,
                options(nostack),
            );
        }
    }
    let lowest = (lowest as i16).min((lowest >> 16) as i16);
    let last = crate::portable::subtract_slope(rest, inverted, height, step, rest_differences);
    lowest.min(last)
}

/// Four numbers, less another: USAT16 limits two of them to 12 bits.
#[cfg(has_dsp)]
macro_rules! four_to_12_bits {
    () => {
        "ldrd {x}, {y}, [{place}]
        ssub16 {x}, {x}, {subtracted}
        ssub16 {y}, {y}, {subtracted}
        usat16 {x}, #12, {x}
        usat16 {y}, #12, {y}
        strd {x}, {y}, [{place}], #8"
    };
}

/// See [`crate::portable::subtract_to_12_bits`]. Faster where the numbers are aligned to 4 bytes.
#[cfg(has_dsp)]
#[inline(never)]
pub fn subtract_to_12_bits(numbers: &mut [u16], subtracted: i16) {
    if !numbers.as_ptr().cast::<u32>().is_aligned() {
        return crate::portable::subtract_to_12_bits(numbers, subtracted);
    }
    let (eights, rest) = numbers.as_chunks_mut::<8>();
    if !eights.is_empty() {
        // SAFETY: 16 bytes are read and written for each eight. LDRD and STRD take the addresses, which are
        // multiples of 4.
        unsafe {
            asm!(
                "2:",
                four_to_12_bits!(),
                four_to_12_bits!(),
                "subs {number}, #1",
                "bne 2b",
                number = inout(reg) eights.len() => _,
                place = inout(reg) eights.as_mut_ptr() => _,
                subtracted = in(reg) u32::from(subtracted as u16) * 0x0001_0001,
                x = out(reg) _,
                y = out(reg) _,
                options(nostack),
            );
        }
    }
    crate::portable::subtract_to_12_bits(rest, subtracted);
}

/// The square root: VSQRT, which rounds to nearest as IEEE 754 asks. Stable Rust without `std` has no other
/// way to it.
#[cfg(has_fpu)]
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
