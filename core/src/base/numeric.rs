//! Sums and products that cannot overflow, and integers that fit a smaller type, for a reason that the
//! compiler does not see. The reason stands beside each use, but not for a place on a row or a count of what
//! a row or a frame holds: at most 2^12. The `whole_...` functions cut a float off to an integer: they
//! saturate, and make 0 of NaN, as `as` does.
//!
//! Elsewhere the core uses the plain operators, and the program `panic-free` checks that none of them can
//! overflow: the compiler adds a panic wherever it cannot exclude an overflow, and the program links only if
//! no panic is reachable. These functions have no such panic. With debug assertions, as in all tests and in
//! fuzzing, they panic on an overflow.

#![expect(
    clippy::cast_possible_truncation,
    reason = "`as` saturates, or keeps the number"
)]
#![expect(clippy::cast_sign_loss, reason = "`as` makes a negative float 0")]

macro_rules! exact {
    ($($name:ident: $number:ty, $checked:ident, $wrapping:ident;)*) => {
        $(
            /// The sum, difference or product.
            #[inline(always)]
            pub(crate) const fn $name(a: $number, b: $number) -> $number {
                debug_assert!(a.$checked(b).is_some());
                a.$wrapping(b)
            }
        )*
    };
}

exact! {
    add_u32: u32, checked_add, wrapping_add;
    add_u64: u64, checked_add, wrapping_add;
    sub_u64: u64, checked_sub, wrapping_sub;
    mul_u64: u64, checked_mul, wrapping_mul;
    add_i32: i32, checked_add, wrapping_add;
    sub_i32: i32, checked_sub, wrapping_sub;
    mul_i32: i32, checked_mul, wrapping_mul;
    add_i64: i64, checked_add, wrapping_add;
    sub_i64: i64, checked_sub, wrapping_sub;
    mul_i64: i64, checked_mul, wrapping_mul;
    add_usize: usize, checked_add, wrapping_add;
}

macro_rules! same_number {
    ($($name:ident: $from:ty as $to:ty;)*) => {
        $(
            /// The same number in another type.
            #[inline(always)]
            pub(crate) const fn $name(value: $from) -> $to {
                debug_assert!(value as i64 == value as $to as i64);
                value as $to
            }
        )*
    };
}

same_number! {
    to_u8: usize as u8;
    to_u16: usize as u16;
    to_u32: usize as u32;
    to_i32: usize as i32;
    i64_to_i32: i64 as i32;
    i32_to_u16: i32 as u16;
}

macro_rules! whole_part {
    ($($name:ident: $to:ty;)*) => {
        $(
            /// The whole part, limited to what the type holds. Not-a-number becomes 0.
            #[inline(always)]
            pub(crate) const fn $name(value: f32) -> $to {
                value as $to
            }
        )*
    };
}

whole_part! {
    whole_usize: usize;
    whole_u32: u32;
    whole_u16: u16;
    whole_i32: i32;
}

#[inline(always)]
pub(crate) fn square(value: f32) -> f32 {
    value * value
}

/// The larger of two values; `least` if the value is not a number.
#[inline(always)]
pub(crate) fn at_least(value: f32, least: f32) -> f32 {
    if value > least { value } else { least }
}

/// The smaller of two values; `most` if the value is not a number.
#[inline(always)]
pub(crate) fn at_most(value: f32, most: f32) -> f32 {
    if value < most { value } else { most }
}

/// Counts the values that are true. They are in memory, so a `usize` holds their number. The compiler cannot
/// prove that the sum in the `count` of a filter does not overflow.
#[inline(always)]
pub(crate) fn count(all: impl Iterator<Item = bool>) -> usize {
    all.fold(0, |number, is_so| add_usize(number, usize::from(is_so)))
}

/// Limits a value to `low` and `high`; not-a-number stays not-a-number. `f32::clamp` has a panic on bounds
/// that are not in order, which brings 20 KB of formatting to the chip. `max` and `min` have rules for
/// not-a-number that take ten instructions each.
#[inline(always)]
pub(crate) fn limited(value: f32, low: f32, high: f32) -> f32 {
    if value > high {
        high
    } else if value < low {
        low
    } else {
        value
    }
}
