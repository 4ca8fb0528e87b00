//! Sums and products that cannot overflow for a reason that the compiler does not see. The reason stands
//! beside each use.
//!
//! Elsewhere the core uses the plain operators, and the program `panic-free` checks that none of them can
//! overflow: it has the compiler put a panic wherever it cannot exclude it, and links only if none is
//! reachable. These functions have no such panic. Where debug assertions are on, as in all tests and in
//! fuzzing, a reason that does not hold is one.

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

/// How many are true: of what is in memory, no more than a `usize` holds. A filter's `count` is a sum that
/// the compiler cannot prove.
#[inline(always)]
pub(crate) fn count(all: impl Iterator<Item = bool>) -> usize {
    all.fold(0, |number, is_so| add_usize(number, usize::from(is_so)))
}

/// `f32::clamp` without its panic on bounds that are not in order, which brings 20 KB of formatting to the
/// chip, and without `max` and `min`, whose rules for not-a-number take ten instructions each. Not-a-number
/// stays what it is.
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
