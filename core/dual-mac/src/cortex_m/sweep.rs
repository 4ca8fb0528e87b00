//! Sweeps over samples, two at a time. The low halves of the registers hold the first half of a part, the
//! high halves its second half. So each half of a register needs only what comes before it in the same half.
//!
//! PKHBT and PKHTB put halves of two words together. UADD16 adds both halves. UHADD16 halves these sums of 17
//! bits, rounded down. USUB16 remembers for SEL where a difference is not negative.

use core::arch::asm;

use crate::portable::PART;

/// One pair of each half of a part. `$here` and `$there` hold the words of the two pairs, and then the pairs'
/// sums and their second samples. `$two` and `$last` hold what these are of the pairs before. `$respond`
/// makes responses of {x} and `$last`; `$free` is one more register for that.
macro_rules! one_pair_of_both {
    (
        $sample:ident, $respond:ident, $here:literal, $there:literal, $two:literal, $last:literal,
        $free:literal
    ) => {
        concat!(
            // The first samples, and the second ones.
            lines! {
                ["pkhbt {x}, " $here ", " $there ", lsl #16"]
                ["pkhtb " $there ", " $there ", " $here ", asr #16"]
            },
            $sample!($there),
            // The sums of the samples before and the first ones, and those of the pairs.
            lines! {
                ["uadd16 " $last ", " $last ", {x}"]
                ["uadd16 " $here ", {x}, " $there]
            },
            // A response is the former and the sum of the pair before, or of this one: the larger counts.
            larger!("{x}", $two, $here, "{x}"),
            $respond!($last, $free),
        )
    };
}

/// The larger of `$a` and `$b`, in each half. `$lost` gets the difference.
macro_rules! larger {
    ($larger:literal, $a:literal, $b:literal, $lost:literal) => {
        lines! {
            ["usub16 " $lost ", " $a ", " $b]
            ["sel " $larger ", " $a ", " $b]
        }
    };
}

/// Two pairs of each half of a part: those at byte `$low`, and those half a part further, at `$high`. Writes
/// their sums, two in a word. Leaves what comes before the next pairs in `$next_two` and `$next_last`.
macro_rules! two_pairs_of_both {
    (
        $sample:ident, $respond:ident, $low:literal, $high:literal, $low_sum:literal, $high_sum:literal,
        $two:literal, $last:literal, $next_two:literal, $next_last:literal
    ) => {
        concat!(
            lines! {
                ["ldrd {a}, " $next_two ", [{words}, #" $low "]"]
                ["ldrd {b}, " $next_last ", [{words}, #" $high "]"]
            },
            one_pair_of_both!($sample, $respond, "{a}", "{b}", $two, $last, $two),
            one_pair_of_both!($sample, $respond, $next_two, $next_last, "{a}", "{b}", $two),
            lines! {
                ["pkhbt {x}, {a}, " $next_two ", lsl #16"]
                ["pkhtb {a}, " $next_two ", {a}, asr #16"]
                ["str {x}, [{sums}, #" $low_sum "]"]
                ["str {a}, [{sums}, #" $high_sum "]"]
            },
        )
    };
}

/// Sweeps a part. `$words` points to the pair before the part, and `$sums` to the sum of that pair. That sum
/// is already written.
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
            sums = in(reg) $sums,
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

/// Words that are samples. The first ones are in {x}.
macro_rules! as_it_is {
    ($seconds:literal) => {
        ""
    };
}

/// Words that are samples with an exclusive or.
macro_rules! inverted {
    ($seconds:literal) => {
        lines! {
            ["eor {x}, {x}, {inverted}"]
            ["eor " $seconds ", " $seconds ", {inverted}"]
        }
    };
}

/// Responses of 16 bits: {x} + `$between`.
macro_rules! narrow {
    ($between:literal, $free:literal) => {
        concat!(
            lines! { ["uadd16 {x}, {x}, " $between] },
            larger!("{highest}", "{x}", "{highest}", $between),
        )
    };
}

/// Responses of 17 bits. The highest of their halves rounded down, and the highest of those rounded up, are
/// together the highest response.
macro_rules! wide {
    ($between:literal, $free:literal) => {
        concat!(
            lines! {
                ["uhadd16 " $free ", {x}, " $between]
                ["uadd16 " $between ", " $between ", {ones}"]
                ["uhadd16 {x}, {x}, " $between]
            },
            larger!("{rounded_down}", $free, "{rounded_down}", $between),
            larger!("{rounded_up}", "{x}", "{rounded_up}", $between),
        )
    };
}

/// How many whole parts a sweep in assembly takes. Writes the sum of the pair before the first, which no part
/// writes.
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
fn part_at(number: usize, words: &[u16], sums: &mut [u16]) -> (*const u16, *mut u16) {
    let pairs = PART.wrapping_mul(number);
    (
        words.as_ptr().wrapping_add(pairs.wrapping_mul(2)),
        sums.as_mut_ptr().wrapping_add(pairs),
    )
}

/// Returns the words, the sums and the parts that come behind the whole parts. The words and the sums start
/// with the pair before.
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

fn larger_half(both: u32) -> u32 {
    (both & 0xFFFF).max(both >> 16)
}

/// See [`crate::portable::sweep`]. Three times as fast where the words are aligned to 4 bytes.
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
#[inline(never)]
pub fn sweep_wide(samples: &[u16], sums: &mut [u16], parts: &mut [u32]) {
    let whole = whole_parts(samples, 0, sums, parts);
    for (number, part) in parts.iter_mut().take(whole).enumerate() {
        let (mut rounded_down, mut rounded_up) = (0u32, 0u32);
        let (words, sums) = part_at(number, samples, sums);
        // SAFETY: as in `sweep`.
        unsafe {
            part!(
                words, sums, as_it_is, wide,
                rounded_down = inout(reg) rounded_down,
                rounded_up = inout(reg) rounded_up,
                ones = in(reg) 0x0001_0001,
            );
        }
        *part = larger_half(rounded_down).wrapping_add(larger_half(rounded_up));
    }
    let (words, sums, parts) = behind(whole, samples, sums, parts);
    crate::portable::sweep_wide(words, sums, parts);
}
