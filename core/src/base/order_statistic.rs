//! Finds a value by its rank among others, without sorting all of them: the library's sorts have a panic, for
//! keys that have no order.

use core::cell::Cell;

use heapless::Vec;

/// The most keys that are kept.
const MOST: usize = 65;

/// Returns the value at place `rank`, from zero, of the keys in ascending order. `None` if there are not so
/// many keys, or the rank is 65 or more.
///
/// Keeps the lowest keys so far, `rank + 1` of them, in order. A median of n keys takes about n^2 / 8 steps,
/// and at most three times as many.
pub fn ranked(rank: usize, keys: &[u32]) -> Option<u32> {
    let mut lowest: Vec<u32, MOST> = Vec::new();
    for &key in keys {
        if lowest.len() <= rank {
            lowest.push(key).ok()?;
        } else {
            let last = lowest.last_mut().filter(|last| key < **last);
            let Some(last) = last else { continue };
            *last = key;
        }
        let cells = Cell::from_mut(lowest.as_mut_slice()).as_slice_of_cells();
        for [before, at] in cells.array_windows().rev() {
            let higher = before.get();
            if higher <= key {
                break;
            }
            at.set(higher);
            before.set(key);
        }
    }
    lowest.get(rank).copied()
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
            (62, 12),
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
