//! Sums and products that cannot overflow, and integers that fit a smaller type, for a reason that the
//! compiler does not see. The reason stands beside each use, but not for a place on a row or a count of what
//! a row or a frame holds: at most 2^12. The `whole_...` functions cut a float off to an integer: they
//! saturate, and make 0 of NaN, as `as` does.
//!
//! Elsewhere the core uses the plain operators, and the program `panic-free` checks that none of them can
//! overflow: the compiler adds a panic wherever it cannot exclude an overflow, and the program links only if
//! no panic is reachable. These functions have no such panic. With debug assertions, as in all tests and in
//! fuzzing, they panic on an overflow.

/// a + b.
#[inline(always)]
pub(crate) const fn add_u32(a: u32, b: u32) -> u32 {
    debug_assert!(a.checked_add(b).is_some());
    a.wrapping_add(b)
}

/// a + b.
#[inline(always)]
pub(crate) const fn add_u64(a: u64, b: u64) -> u64 {
    debug_assert!(a.checked_add(b).is_some());
    a.wrapping_add(b)
}

/// a - b.
#[inline(always)]
pub(crate) const fn sub_u64(a: u64, b: u64) -> u64 {
    debug_assert!(a.checked_sub(b).is_some());
    a.wrapping_sub(b)
}

/// a * b.
#[inline(always)]
pub(crate) const fn mul_u64(a: u64, b: u64) -> u64 {
    debug_assert!(a.checked_mul(b).is_some());
    a.wrapping_mul(b)
}

/// a + b.
#[inline(always)]
pub(crate) const fn add_i32(a: i32, b: i32) -> i32 {
    debug_assert!(a.checked_add(b).is_some());
    a.wrapping_add(b)
}

/// a - b.
#[inline(always)]
pub(crate) const fn sub_i32(a: i32, b: i32) -> i32 {
    debug_assert!(a.checked_sub(b).is_some());
    a.wrapping_sub(b)
}

/// a * b.
#[inline(always)]
pub(crate) const fn mul_i32(a: i32, b: i32) -> i32 {
    debug_assert!(a.checked_mul(b).is_some());
    a.wrapping_mul(b)
}

/// a + b.
#[inline(always)]
pub(crate) const fn add_i64(a: i64, b: i64) -> i64 {
    debug_assert!(a.checked_add(b).is_some());
    a.wrapping_add(b)
}

/// a - b.
#[inline(always)]
pub(crate) const fn sub_i64(a: i64, b: i64) -> i64 {
    debug_assert!(a.checked_sub(b).is_some());
    a.wrapping_sub(b)
}

/// a * b.
#[inline(always)]
pub(crate) const fn mul_i64(a: i64, b: i64) -> i64 {
    debug_assert!(a.checked_mul(b).is_some());
    a.wrapping_mul(b)
}

/// a + b.
#[inline(always)]
pub(crate) const fn add_usize(a: usize, b: usize) -> usize {
    debug_assert!(a.checked_add(b).is_some());
    a.wrapping_add(b)
}

/// The same number as a u16.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "stands beside each use")]
pub(crate) const fn to_u16(value: usize) -> u16 {
    debug_assert!(value <= u16::MAX as usize);
    value as u16
}

/// The same number as a u32.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "stands beside each use")]
pub(crate) const fn to_u32(value: usize) -> u32 {
    debug_assert!(value as u64 <= u32::MAX as u64);
    value as u32
}

/// The same number as an i32.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "stands beside each use")]
pub(crate) const fn to_i32(value: usize) -> i32 {
    debug_assert!(value <= i32::MAX as usize);
    value as i32
}

/// The same number as an i32.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "stands beside each use")]
pub(crate) const fn i64_to_i32(value: i64) -> i32 {
    debug_assert!(value == value as i32 as i64);
    value as i32
}

/// The same number as a u16.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "stands beside each use")]
pub(crate) const fn i32_to_u16(value: i32) -> u16 {
    debug_assert!(matches!(value, 0..=0xffff));
    value.cast_unsigned() as u16
}

/// The whole part, limited to a usize. Not-a-number becomes 0.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "`as` saturates")]
#[expect(clippy::cast_sign_loss, reason = "`as` makes a negative number 0")]
pub(crate) const fn whole_usize(value: f32) -> usize {
    value as usize
}

/// The whole part, limited to a u32. Not-a-number becomes 0.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "`as` saturates")]
#[expect(clippy::cast_sign_loss, reason = "`as` makes a negative number 0")]
pub(crate) const fn whole_u32(value: f32) -> u32 {
    value as u32
}

/// The whole part, limited to a u16. Not-a-number becomes 0.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "`as` saturates")]
#[expect(clippy::cast_sign_loss, reason = "`as` makes a negative number 0")]
pub(crate) const fn whole_u16(value: f32) -> u16 {
    value as u16
}

/// The whole part, limited to an i32. Not-a-number becomes 0.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "`as` saturates")]
pub(crate) const fn whole_i32(value: f32) -> i32 {
    value as i32
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
