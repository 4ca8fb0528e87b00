//! Sums and products that cannot overflow, for a reason that the compiler does not see. The reason stands
//! beside each use.
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
