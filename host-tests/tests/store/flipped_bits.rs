//! A bit that has changed, anywhere in the two sectors: what is read is what was saved last, or before that, or it is unusable.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use slitrange::store::Stored;
use slitrange::store::configuration::Configuration;

use crate::flash::{BYTES, Flash, SECTOR};
use crate::samples::{Size, keep, read, sample};

/// What is read of each, so many times.
#[derive(Debug, Default, PartialEq, Eq)]
struct Count {
    newest: usize,
    doubted: usize,
    before: usize,
    unusable: usize,
}

/// Turns bits over, one at a time, reads, and now and then saves.
fn turn_over(
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
            kept => match saved
                .iter()
                .rev()
                .position(|saved| Some(saved) == kept.saved())
            {
                Some(0) if matches!(kept, Stored::Newest(_)) => count.newest += 1,
                // Whole, but damage elsewhere looks like something newer.
                Some(0) => count.doubted += 1,
                // That it is not the newest is always said.
                Some(1) if matches!(kept, Stored::Older(_)) => count.before += 1,
                Some(by) => panic!("{what}, bit {bit}: that of {by} saves before"),
                None => panic!("{what}, bit {bit}: {kept:?} was never saved"),
            },
        }
        if marks(bit) || bit % 251 == 0 {
            keep(&mut flash.clone(), &next);
        }
        turn(&mut flash, bit);
    }
    println!("{what}: {count:?}");
    count
}

/// What marks a sector as used, and the first item's place.
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

/// So many saves of a size, to an erased flash.
fn saves(size: Size, count: u32) -> (Flash, Vec<Configuration>) {
    let mut flash = Flash::erased();
    let saved: Vec<Configuration> = (0..count).map(|i| sample(size, i)).collect();
    for saved in &saved {
        keep(&mut flash, saved);
    }
    (flash, saved)
}

/// Bytes of an item that mean something: the library's header, the number, what is saved. A bit that pads them to words means nothing.
const HEADER: usize = 8;
const MIDDLE: usize = HEADER + 4 + 65;
const MOST: usize = HEADER + 4 + 2651;

#[test]
fn in_erased_flash() {
    let count = turn_over("erased", &Flash::erased(), &[], all());
    assert_eq!(count.unusable, 8 * BYTES);
}

#[test]
fn after_a_single_save() {
    let (flash, saved) = saves(Size::Middle, 1);
    let count = turn_over("one", &flash, &saved, all());
    assert_eq!((count.unusable, count.before), (8 * MIDDLE, 0));
    let (flash, saved) = saves(Size::Most, 1);
    let count = turn_over("one of the largest", &flash, &saved, one_of_each_byte());
    assert_eq!((count.unusable, count.before), (MOST + 7 * HEADER, 0));
}

#[test]
fn after_several_saves() {
    let (flash, saved) = saves(Size::Middle, 4);
    let count = turn_over("four", &flash, &saved, all());
    assert_eq!((count.unusable, count.before), (0, 8 * MIDDLE));
    let (flash, saved) = saves(Size::Most, 3);
    let count = turn_over("three of the largest", &flash, &saved, one_of_each_byte());
    assert_eq!((count.unusable, count.before), (0, MOST));
}

#[test]
fn after_a_change_of_sectors() {
    let (flash, saved) = saves(Size::Most, 7);
    assert_eq!(flash.erases, [1, 1]);
    let count = turn_over("seven of the largest", &flash, &saved, one_of_each_byte());
    assert_eq!((count.unusable, count.before), (0, MOST + 7 * HEADER));
}
