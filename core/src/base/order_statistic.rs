//! Finds a value by its rank among others, without sorting them: the library's sorts have a panic, for keys
//! that have no order.

/// Returns the value at place `rank`, from zero, of the keys in ascending order. `None` if there are not so
/// many keys.
///
/// Bisection finds it: each pass halves the range from `low` to `high` in which it lies. It ends early if
/// exactly `rank` or `rank + 1` keys are at or below the middle: the value is then the lowest key above it,
/// or the highest key at or below it.
pub fn ranked(rank: usize, keys: &[u32]) -> Option<u32> {
    if rank >= keys.len() {
        return None;
    }
    let (mut low, mut high) = (u32::MAX, 0);
    for &key in keys {
        low = low.min(key);
        high = high.max(key);
    }
    // At most 32 passes. After each one, `low` and `high` are keys.
    while low < high {
        let between = low.midpoint(high);
        let (mut below, mut highest_below, mut lowest_above) = (0usize, low, high);
        for &key in keys {
            if key <= between {
                // At most as many as there are keys.
                below = below.wrapping_add(1);
                highest_below = highest_below.max(key);
            } else {
                lowest_above = lowest_above.min(key);
            }
        }
        // There are more keys than `rank`.
        if below == rank.wrapping_add(1) {
            return Some(highest_below);
        } else if below == rank {
            return Some(lowest_above);
        } else if below > rank {
            high = highest_below;
        } else {
            low = lowest_above;
        }
    }
    Some(low)
}

/// Maps integers to keys for [`ranked`], in the same order.
pub const fn ordered(value: i32) -> u32 {
    value.cast_unsigned() ^ (1 << 31)
}

/// The integer of a key.
pub const fn from_ordered(key: u32) -> i32 {
    (key ^ (1 << 31)).cast_signed()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_rank_has_the_value_that_sorting_gives_it() {
        assert_eq!(ranked(0, &[]), None);
        assert_eq!(ranked(2, &[1, 2]), None);
        // Bits in any order: keys that spread over all of their range, and keys of which many are equal.
        let cases = [
            (1, 0),
            (2, 0),
            (7, 28),
            (16, 4),
            (33, 0),
            (63, 30),
            (64, 12),
        ];
        for (count, shift) in cases {
            let values = (1..=count).map(|i: i32| i.wrapping_mul(-1_640_531_527) >> shift);
            let values: std::vec::Vec<i32> = values.chain([i32::MIN, i32::MAX]).collect();
            let keys: std::vec::Vec<u32> = values.iter().map(|&value| ordered(value)).collect();
            let mut sorted = values;
            sorted.sort_unstable();
            for (rank, value) in sorted.into_iter().enumerate() {
                assert_eq!(ranked(rank, &keys).map(from_ordered), Some(value));
            }
        }
    }
}
