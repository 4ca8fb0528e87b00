//! A flipped bit anywhere in the two sectors: the store reads the last configuration, reads the one before
//! and says so, or says that the flash is unusable.

use super::flash::{BYTES, Flash, SECTOR};
use super::samples::{HEADER, Size, item_bytes, read, sample, save_and_check, saves};
use crate::support::*;

#[derive(Debug, Default, PartialEq, Eq)]
struct Count {
    newest: usize,
    /// The newest configuration, but reported as an older one.
    doubted: usize,
    before: usize,
    unusable: usize,
}

fn flip(
    what: &str,
    flash: &Flash,
    saved: &[Configuration],
    bits: impl Iterator<Item = usize>,
) -> Count {
    let mut count = Count::default();
    let next = sample(Size::Middle, 999_999);
    let mut flash = flash.clone();
    let turn = |flash: &mut Flash, bit: usize| flash.bytes[bit / 8] ^= 1 << (bit % 8);
    for bit in bits {
        turn(&mut flash, bit);
        match read(&mut flash) {
            Stored::Nothing => panic!("{what}, bit {bit}: as if nothing had ever been saved"),
            Stored::Unusable => count.unusable += 1,
            stored => {
                match (saved.iter().rev()).position(|it| Some(it) == stored.configuration()) {
                    Some(0) if matches!(stored, Stored::Newest(_)) => count.newest += 1,
                    // Damage elsewhere looks like a newer save.
                    Some(0) => count.doubted += 1,
                    Some(1) if matches!(stored, Stored::Older(_)) => count.before += 1,
                    Some(by) => panic!("{what}, bit {bit}: the configuration of {by} saves before"),
                    None => panic!("{what}, bit {bit}: {stored:?} was never saved"),
                }
            }
        }
        if marks(bit) || bit % 251 == 0 {
            save_and_check(&mut flash.clone(), &next);
        }
        turn(&mut flash, bit);
    }
    println!("{what}: {count:?}");
    count
}

/// Whether a bit belongs to the words that mark a sector as used or full, or to the first item's header.
fn marks(bit: usize) -> bool {
    let byte = bit / 8 % SECTOR;
    !(12..SECTOR - 4).contains(&byte)
}

fn all() -> impl Iterator<Item = usize> {
    0..8 * BYTES
}

/// One bit of each byte in use, one of every eighth byte of the erased rest, and all bits of the marks.
fn one_of_each_byte(flash: &Flash) -> impl Iterator<Item = usize> + use<> {
    let mut random = random(6);
    let last = [0, SECTOR].map(|start| {
        let sector = &flash.bytes[start..start + SECTOR - 4];
        let used = sector.iter().rposition(|&byte| byte != 0xff);
        start + used.unwrap_or_default()
    });
    let bytes = (0..BYTES)
        .filter(move |&byte| byte <= last[byte / SECTOR] || byte % 8 == 0 || marks(8 * byte));
    bytes.flat_map(move |byte| {
        let one = 8 * byte + random.random_range(0..8);
        (8 * byte..8 * byte + 8).filter(move |&bit| bit == one || marks(bit))
    })
}

#[test]
fn a_flipped_bit_in_erased_flash() {
    let count = flip("erased", &Flash::erased(), &[], all());
    assert_eq!(count.unusable, 8 * BYTES);
}

#[test]
fn a_flipped_bit_after_saves() {
    use Size::{Middle, Most};
    for (size, number) in [(Middle, 1), (Most, 1), (Middle, 4), (Most, 3)] {
        let (flash, saved) = saves(&vec![size; number]);
        let what = format!("{number} {size:?}");
        let count = flip(&what, &flash, &saved, one_of_each_byte(&flash));
        let bytes = item_bytes(size);
        let expected = match number {
            1 => (bytes + 7 * HEADER, 0),
            _ => (0, bytes),
        };
        assert_eq!((count.unusable, count.before), expected, "{what}");
    }
}

#[test]
#[ignore = "every bit; takes 17 CPU s; run by .ci/run"]
fn every_flipped_bit_after_saves() {
    let bits = 8 * item_bytes(Size::Middle);
    for (number, expected) in [(1, (bits, 0)), (4, (0, bits))] {
        let (flash, saved) = saves(&vec![Size::Middle; number]);
        let what = number.to_string();
        let count = flip(&what, &flash, &saved, all());
        assert_eq!((count.unusable, count.before), expected, "{what} saves");
    }
}

/// Seven of the largest: the last one is the first in its sector.
fn flip_after_a_change_of_sectors(step: usize) -> Count {
    let (flash, saved) = saves(&[Size::Most; 7]);
    assert_eq!(flash.erases, [1, 1]);
    let bits = one_of_each_byte(&flash).step_by(step);
    flip("seven of the largest", &flash, &saved, bits)
}

#[test]
fn a_flipped_bit_after_a_change_of_sectors() {
    let count = flip_after_a_change_of_sectors(16);
    assert!(count.unusable == 0 && count.before > 0, "{count:?}");
}

#[test]
#[ignore = "every byte; takes 9 CPU s; run by .ci/run"]
fn a_flipped_bit_of_every_byte_after_a_change_of_sectors() {
    let count = flip_after_a_change_of_sectors(1);
    let bytes = item_bytes(Size::Most) + 7 * HEADER;
    assert_eq!((count.unusable, count.before), (0, bytes));
}
