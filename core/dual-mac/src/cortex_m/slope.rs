//! Subtracts a slope from samples, two at a time. SSUB16 subtracts both halves of a word, and remembers for
//! SEL which results are not negative.

use core::arch::asm;

/// Two differences to a slope, whose heights at the two samples PKHTB takes from above the binary points.
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
    let (many, rest) = words.as_chunks::<16>();
    let (many_differences, rest_differences) = differences.as_chunks_mut::<16>();
    let (mut height, mut lowest) = (start, 0x7FFF_7FFF_u32);
    if !many.is_empty() {
        // SAFETY: 32 bytes are read from the words and written to the differences for each sixteen, and both
        // slices are that long. Addresses are as in `dot`; STR takes any, as LDR does.
        unsafe {
            asm!(
                "2:",
                two_below_a_slope!(),
                two_below_a_slope!(),
                two_below_a_slope!(),
                two_below_a_slope!(),
                two_below_a_slope!(),
                two_below_a_slope!(),
                two_below_a_slope!(),
                two_below_a_slope!(),
                "subs {number}, #1",
                "bne 2b",
                number = inout(reg) many.len() => _,
                word = inout(reg) many.as_ptr() => _,
                difference = inout(reg) many_differences.as_mut_ptr() => _,
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
    let lowest = ((lowest & 0xffff) as i16).min((lowest >> 16) as i16);
    let last = crate::portable::subtract_slope(rest, inverted, height, step, rest_differences);
    lowest.min(last)
}

/// Eight numbers, less another: USAT16 limits two of them to 12 bits.
macro_rules! eight_to_12_bits {
    () => {
        "ldm {number}, {{r2, r4, r5, r8}}
        ssub16 r2, r2, {subtracted}
        ssub16 r4, r4, {subtracted}
        ssub16 r5, r5, {subtracted}
        ssub16 r8, r8, {subtracted}
        usat16 r2, #12, r2
        usat16 r4, #12, r4
        usat16 r5, #12, r5
        usat16 r8, #12, r8
        stm {number}!, {{r2, r4, r5, r8}}"
    };
}

/// See [`crate::portable::subtract_to_12_bits`]. Faster where the numbers are aligned to 4 bytes.
#[inline(never)]
pub fn subtract_to_12_bits(numbers: &mut [u16], subtracted: i16) {
    if !numbers.as_ptr().cast::<u32>().is_aligned() {
        return crate::portable::subtract_to_12_bits(numbers, subtracted);
    }
    let (many, rest) = numbers.as_chunks_mut::<16>();
    if !many.is_empty() {
        // SAFETY: 32 bytes are read and written for each sixteen. LDM and STM take the addresses, which are
        // multiples of 4.
        unsafe {
            asm!(
                "2:",
                eight_to_12_bits!(),
                eight_to_12_bits!(),
                "subs r3, #1",
                "bne 2b",
                inout("r3") many.len() => _,
                number = inout(reg) many.as_mut_ptr() => _,
                subtracted = in(reg) u32::from(subtracted.cast_unsigned()) * 0x0001_0001,
                out("r2") _,
                out("r4") _,
                out("r5") _,
                out("r8") _,
                options(nostack),
            );
        }
    }
    crate::portable::subtract_to_12_bits(rest, subtracted);
}
