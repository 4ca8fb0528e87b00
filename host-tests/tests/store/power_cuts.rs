//! Power cuts at each operation of a save: the erasing of a sector, the programming of each word. A plain cut
//! falls between two operations, a torn cut in the middle of one.

use super::flash::{BYTES, Flash, SECTOR};
use super::samples::{Size, read, sample, save, save_and_check, saves};
use crate::support::*;

#[derive(Debug, Default, PartialEq, Eq)]
struct Count {
    operations: usize,
    cuts: usize,
    nothing: usize,
    unusable: usize,
    old: usize,
    new: usize,
}

/// Cuts the power at the first eight operations of saving `new` to `flash` and then at every so many, reads,
/// and saves again: plain, then torn.
fn cut_operations(what: &str, flash: &Flash, new: &Configuration, step: usize) -> [Count; 2] {
    let old = read(&mut flash.clone());
    [false, true].map(|torn| {
        let mut count = Count::default();
        while cut_operation(flash, &old, new, torn, &mut count) {
            count.operations += if count.operations < 8 { 1 } else { step };
        }
        println!("{what}: {} {count:?}", if torn { "torn" } else { "plain" });
        count
    })
}

/// Cuts the power at the next operation. False if the save has no such operation.
fn cut_operation(
    flash: &Flash,
    old: &Stored,
    new: &Configuration,
    torn: bool,
    count: &mut Count,
) -> bool {
    // The erasure and the words that place the item come first: tear those in several ways.
    let ways = if torn && count.operations < 4 { 16 } else { 1 };
    for way in 0..ways {
        let mut flash = flash.clone();
        let seed = way << 32 | count.operations as u64;
        flash.cut_after(count.operations, torn.then_some(seed));
        let saved = save(&mut flash, new);
        flash.power_on();
        let stored = read(&mut flash);
        if saved.is_ok() {
            assert!(stored == Stored::Newest(new.clone()));
            return false;
        }
        count.cuts += 1;
        match stored {
            Stored::Nothing => count.nothing += 1,
            Stored::Unusable => count.unusable += 1,
            stored if stored.configuration() == old.configuration() => count.old += 1,
            stored if stored == Stored::Newest(new.clone()) => count.new += 1,
            other => panic!("neither old nor new: {count:?}, {way}: {other:?}"),
        }
        save_and_check(&mut flash, &sample(Size::Middle, 999_999));
        assert_eq!(flash.overwritten, 0);
    }
    true
}

fn nothing_is_lost(what: &str, flash: &Flash, new: &Configuration, step: usize) {
    for count in cut_operations(what, flash, new, step) {
        assert_eq!(count.old + count.new, count.cuts);
    }
}

/// Saves until one goes to the other sector: the flash before and after that, and its configuration.
fn around_a_change(mut flash: Flash, sizes: &[Size]) -> (Flash, Flash, Configuration) {
    for (i, &size) in sizes.iter().cycle().enumerate() {
        let before = flash.clone();
        let saved = sample(size, i as u32);
        save_and_check(&mut flash, &saved);
        if i > 0 && flash.erases != before.erases {
            return (before, flash, saved);
        }
    }
    unreachable!("a sector is full after some saves")
}

fn cuts_of(size: Size, step: usize) {
    let name = format!("{size:?}");
    let new = sample(size, 1000);
    let (one, _) = saves(&[size]);
    nothing_is_lost(&format!("{name}, the second"), &one, &new, step);
    let (before, after, first) = around_a_change(one, &[size]);
    nothing_is_lost(&format!("{name}, in a fresh sector"), &before, &first, step);
    nothing_is_lost(&format!("{name}, after it"), &after, &new, step);
    // Now the sector to erase is in use.
    let (before, _, first) = around_a_change(after, &[size]);
    nothing_is_lost(&format!("{name}, in a used sector"), &before, &first, step);
}

/// Of the smallest at each operation; of the largest at the first eight, and then at every seventh.
#[test]
fn power_cuts_in_saves_of_the_smallest_and_the_largest_configuration() {
    cuts_of(Size::Least, 1);
    cuts_of(Size::Most, 7);
}

#[test]
#[ignore = "takes 10 CPU s; run by .ci/run"]
fn power_cuts_at_each_operation_of_saves_of_the_largest_configuration() {
    cuts_of(Size::Most, 1);
}

#[test]
fn power_cuts_in_saves_of_large_and_small_configurations() {
    let (large, small) = (Size::Most, Size::Least);
    nothing_is_lost("large on small", &saves(&[small]).0, &sample(large, 1), 1);
    nothing_is_lost("small on large", &saves(&[large]).0, &sample(small, 1), 1);
    let (_, after, _) = around_a_change(Flash::erased(), &[large, small]);
    let (before, _, first) = around_a_change(after, &[large, small]);
    nothing_is_lost("by turns, in a used sector", &before, &first, 1);
}

/// The store finds nothing until the first word is programmed, and then "unusable" until the item is whole.
#[test]
fn power_cuts_in_the_very_first_save() {
    for size in [Size::Most, Size::Least] {
        let what = format!("{size:?}, the first");
        let [plain, torn] = cut_operations(&what, &Flash::erased(), &sample(size, 0), 1);
        // The erasure, and the word that marks the sector as used.
        assert_eq!(plain.nothing, 2);
        for count in [plain, torn] {
            assert_eq!(count.nothing + count.unusable + count.new, count.cuts);
        }
    }
}

/// Unusable flash stays unusable until a save is whole: the store never reports erased flash.
#[test]
fn power_cuts_in_a_save_over_unusable_contents() {
    let mut interrupted = Flash::erased();
    interrupted.cut_after(100, None);
    assert!(save(&mut interrupted, &sample(Size::Most, 0)).is_err());
    interrupted.power_on();
    let first = with(vec![0xff; BYTES], |it| it[100] = 0);
    let second = with(vec![0xff; BYTES], |it| it[BYTES - 1] = 0x7f);
    let both = with(vec![0x5a; BYTES], |it| it[SECTOR..].fill(0));
    for (what, flash, size) in [
        ("an interrupted first", interrupted, Size::Most),
        ("a byte in the first", Flash::with(first), Size::Middle),
        ("a bit in the second", Flash::with(second), Size::Middle),
        ("both full of something", Flash::with(both), Size::Middle),
    ] {
        assert_eq!(read(&mut flash.clone()), Stored::Unusable);
        for count in cut_operations(what, &flash, &sample(size, 0), 1) {
            assert_eq!(count.unusable + count.new, count.cuts);
        }
    }
}

#[test]
fn two_power_cuts_in_two_saves() {
    let (_, after, _) = around_a_change(Flash::erased(), &[Size::Most]);
    let (before, _, first) = around_a_change(after, &[Size::Most]);
    let (second, third) = (sample(Size::Most, 2000), sample(Size::Most, 3000));
    let old = read(&mut before.clone());
    let mut cuts = 0;
    // A save of the largest has 399 operations.
    let of_saves = pairs((0..410).step_by(22), (0..410).step_by(20));
    // The erasure, each way.
    let of_erasure = (0..40).flat_map(|i| [(0, i % 4), (i % 4, 0)]);
    for (at, again) in of_saves.chain(of_erasure) {
        let mut flash = before.clone();
        flash.cut_after(at, Some(cuts));
        let saved = save(&mut flash, &first);
        flash.power_on();
        let stored = read(&mut flash);
        let is_old = saved.is_err() && stored.configuration() == old.configuration();
        assert!(is_old || stored == Stored::Newest(first.clone()));
        flash.cut_after(again, Some(cuts << 32));
        let saved = save(&mut flash, &second);
        flash.power_on();
        let stored_then = read(&mut flash);
        let is_old = saved.is_err() && stored_then.configuration() == stored.configuration();
        let is_new = stored_then == Stored::Newest(second.clone());
        assert!(is_old || is_new, "{at}, then {again}");
        save_and_check(&mut flash, &third);
        assert_eq!(flash.overwritten, 0);
        cuts += 1;
    }
    println!("{cuts} times two cuts");
}
