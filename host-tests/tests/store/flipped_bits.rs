//! A flipped bit anywhere in the two sectors: the store reads the last configuration, reads the one before
//! and says so, or says that the flash is unusable.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use slitrange::store::Stored;
use slitrange::store::configuration::Configuration;

use crate::flash::{BYTES, Flash, SECTOR};
use crate::samples::{HEADER, Size, item_bytes, read, sample, save_and_check};

/// How often each result was read.
#[derive(Debug, Default, PartialEq, Eq)]
struct Count {
    newest: usize,
    /// The newest configuration, but reported as an older one.
    doubted: usize,
    before: usize,
    unusable: usize,
}

/// Flips bits, one at a time, reads, and now and then saves.
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
            stored => match saved
                .iter()
                .rev()
                .position(|saved| Some(saved) == stored.configuration())
            {
                Some(0) if matches!(stored, Stored::Newest(_)) => count.newest += 1,
                // Damage elsewhere looks like a newer save.
                Some(0) => count.doubted += 1,
                Some(1) if matches!(stored, Stored::Older(_)) => count.before += 1,
                Some(by) => panic!("{what}, bit {bit}: the configuration of {by} saves before"),
                None => panic!("{what}, bit {bit}: {stored:?} was never saved"),
            },
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

/// One bit of each byte, and all bits of the marks.
fn one_of_each_byte() -> impl Iterator<Item = usize> {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    (0..BYTES).flat_map(move |byte| {
        let one = 8 * byte + random.random_range(0..8);
        (8 * byte..8 * byte + 8).filter(move |&bit| bit == one || marks(bit))
    })
}

/// An erased flash after a number of saves of a size, with what was saved.
fn saves(size: Size, count: u32) -> (Flash, Vec<Configuration>) {
    let mut flash = Flash::erased();
    let saved: Vec<Configuration> = (0..count).map(|i| sample(size, i)).collect();
    for saved in &saved {
        save_and_check(&mut flash, saved);
    }
    (flash, saved)
}

#[test]
fn in_erased_flash() {
    let count = flip("erased", &Flash::erased(), &[], all());
    assert_eq!(count.unusable, 8 * BYTES);
}

#[test]
fn after_a_single_save() {
    let (flash, saved) = saves(Size::Middle, 1);
    let count = flip("one", &flash, &saved, all());
    assert_eq!(
        (count.unusable, count.before),
        (8 * item_bytes(Size::Middle), 0)
    );
    let (flash, saved) = saves(Size::Most, 1);
    let count = flip("one of the largest", &flash, &saved, one_of_each_byte());
    assert_eq!(
        (count.unusable, count.before),
        (item_bytes(Size::Most) + 7 * HEADER, 0)
    );
}

#[test]
fn after_several_saves() {
    let (flash, saved) = saves(Size::Middle, 4);
    let count = flip("four", &flash, &saved, all());
    assert_eq!(
        (count.unusable, count.before),
        (0, 8 * item_bytes(Size::Middle))
    );
    let (flash, saved) = saves(Size::Most, 3);
    let count = flip("three of the largest", &flash, &saved, one_of_each_byte());
    assert_eq!((count.unusable, count.before), (0, item_bytes(Size::Most)));
}

#[test]
fn after_a_change_of_sectors() {
    let (flash, saved) = saves(Size::Most, 12);
    assert_eq!(flash.erases, [1, 1]);
    let count = flip("twelve of the largest", &flash, &saved, one_of_each_byte());
    assert_eq!(
        (count.unusable, count.before),
        (0, item_bytes(Size::Most) + 7 * HEADER)
    );
}
