//! Power that is cut at each operation of a save: the erasing of a sector, the programming of each word. Plain, which is between two
//! operations, and torn, which is in the middle of one.

use slitrange::store::Stored;
use slitrange::store::configuration::Configuration;

use crate::flash::{BYTES, Flash, SECTOR};
use crate::samples::{Size, keep, read, sample, save};

/// What is there after power was cut.
#[derive(Debug, Default, PartialEq, Eq)]
struct Count {
    operations: usize,
    cuts: usize,
    nothing: usize,
    unusable: usize,
    old: usize,
    new: usize,
}

/// Cuts each operation of saving `new` to `flash`, looks what is there, and saves again: plain, then torn.
fn cut_each_operation(what: &str, flash: &Flash, new: &Configuration) -> [Count; 2] {
    let old = read(&mut flash.clone());
    [false, true].map(|torn| {
        let mut count = Count::default();
        while cut_operation(flash, &old, new, torn, &mut count) {
            count.operations += 1;
        }
        println!("{what}: {} {count:?}", if torn { "torn" } else { "plain" });
        count
    })
}

/// False if there is no such operation.
fn cut_operation(
    flash: &Flash,
    old: &Stored,
    new: &Configuration,
    torn: bool,
    count: &mut Count,
) -> bool {
    // Erasing, and what says where an item is, come first.
    let ways = match (torn, count.operations) {
        (false, _) => 1,
        (true, 0..4) => 16,
        (true, _) => 1,
    };
    for way in 0..ways {
        let mut flash = flash.clone();
        let seed = way << 32 | count.operations as u64;
        flash.cut_after(count.operations, torn.then_some(seed));
        let saved = save(&mut flash, new);
        flash.power_on();
        let kept = read(&mut flash);
        if saved.is_ok() {
            assert!(kept == Stored::Newest(new.clone()));
            return false;
        }
        count.cuts += 1;
        match kept {
            Stored::Nothing => count.nothing += 1,
            Stored::Unusable => count.unusable += 1,
            kept if kept.saved() == old.saved() => count.old += 1,
            kept if kept == Stored::Newest(new.clone()) => count.new += 1,
            other => panic!("neither old nor new: {count:?}, {way}: {other:?}"),
        }
        keep(&mut flash, &sample(Size::Middle, 999_999));
        assert_eq!(flash.overwritten, 0);
    }
    true
}

/// The old or the new is there.
fn nothing_is_lost(what: &str, flash: &Flash, new: &Configuration) {
    for count in cut_each_operation(what, flash, new) {
        assert_eq!(count.old + count.new, count.cuts);
    }
}

/// Saves until the next save is the first in the other sector: gives the flash before and after that.
fn around_a_change(mut flash: Flash, sizes: &[Size]) -> (Flash, Flash, Configuration) {
    for (i, &size) in sizes.iter().cycle().enumerate() {
        let before = flash.clone();
        let saved = sample(size, i as u32);
        keep(&mut flash, &saved);
        if i > 0 && flash.erases != before.erases {
            return (before, flash, saved);
        }
    }
    unreachable!("a sector is full some time")
}

fn with(sizes: &[Size]) -> Flash {
    let mut flash = Flash::erased();
    for (i, &size) in sizes.iter().enumerate() {
        keep(&mut flash, &sample(size, i as u32));
    }
    flash
}

fn cuts_of(size: Size) {
    let name = format!("{size:?}");
    let new = sample(size, 1000);
    nothing_is_lost(&format!("{name}, the second"), &with(&[size]), &new);
    let (before, after, first) = around_a_change(with(&[size]), &[size]);
    nothing_is_lost(&format!("{name}, in a fresh sector"), &before, &first);
    nothing_is_lost(&format!("{name}, after it"), &after, &new);
    // Now the sector that is erased has something in it.
    let (before, _, first) = around_a_change(after, &[size]);
    nothing_is_lost(&format!("{name}, in a used sector"), &before, &first);
}

#[test]
fn the_largest() {
    cuts_of(Size::Most);
}

#[test]
fn the_smallest() {
    cuts_of(Size::Least);
}

#[test]
fn large_and_small_by_turns() {
    let (large, small) = (Size::Most, Size::Least);
    nothing_is_lost("large on small", &with(&[small]), &sample(large, 1));
    nothing_is_lost("small on large", &with(&[large]), &sample(small, 1));
    let (_, after, _) = around_a_change(Flash::erased(), &[large, small]);
    let (before, _, first) = around_a_change(after, &[large, small]);
    nothing_is_lost("by turns, in a used sector", &before, &first);
}

/// Before the first word is programmed nothing was saved; then it is unusable until it is whole.
#[test]
fn the_first_ever() {
    for size in [Size::Most, Size::Least] {
        let what = format!("{size:?}, the first");
        let [plain, torn] = cut_each_operation(&what, &Flash::erased(), &sample(size, 0));
        // The erasure, and the word that marks the sector as used.
        assert_eq!(plain.nothing, 2);
        for count in [plain, torn] {
            assert_eq!(count.nothing + count.unusable + count.new, count.cuts);
        }
    }
}

/// What is unusable stays so until it is saved over: it never looks as if nothing had ever been saved.
#[test]
fn over_what_is_unusable() {
    let mut interrupted = Flash::erased();
    interrupted.cut_after(100, None);
    assert!(save(&mut interrupted, &sample(Size::Most, 0)).is_err());
    interrupted.power_on();
    let mut first = vec![0xff; BYTES];
    first[100] = 0;
    let mut second = vec![0xff; BYTES];
    second[BYTES - 1] = 0x7f;
    let mut both = vec![0x5a; BYTES];
    both[SECTOR..].fill(0);
    for (what, flash, size) in [
        ("an interrupted first", interrupted, Size::Most),
        ("a byte in the first", Flash::with(first), Size::Middle),
        ("a bit in the second", Flash::with(second), Size::Middle),
        ("both full of something", Flash::with(both), Size::Middle),
    ] {
        assert_eq!(read(&mut flash.clone()), Stored::Unusable);
        for count in cut_each_operation(what, &flash, &sample(size, 0)) {
            assert_eq!(count.unusable + count.new, count.cuts);
        }
    }
}

/// Power that is cut, and cut again in the save that follows.
#[test]
fn twice() {
    let (_, after, _) = around_a_change(Flash::erased(), &[Size::Most]);
    let (before, _, first) = around_a_change(after, &[Size::Most]);
    let (second, third) = (sample(Size::Most, 2000), sample(Size::Most, 3000));
    let old = read(&mut before.clone());
    let mut cuts = 0;
    for (at, again) in (0..680)
        .step_by(41)
        .flat_map(|at| (0..680).step_by(37).map(move |again| (at, again)))
        // The erasure, each way.
        .chain((0..40).flat_map(|i| [(0, i % 4), (i % 4, 0)]))
    {
        let mut flash = before.clone();
        flash.cut_after(at, Some(cuts));
        let saved = save(&mut flash, &first);
        flash.power_on();
        let kept = read(&mut flash);
        assert!(
            kept == Stored::Newest(first.clone()) || saved.is_err() && kept.saved() == old.saved()
        );
        flash.cut_after(again, Some(cuts << 32));
        let saved = save(&mut flash, &second);
        flash.power_on();
        let kept_then = read(&mut flash);
        assert!(
            kept_then == Stored::Newest(second.clone())
                || saved.is_err() && kept_then.saved() == kept.saved(),
            "{at}, then {again}"
        );
        keep(&mut flash, &third);
        assert_eq!(flash.overwritten, 0);
        cuts += 1;
    }
    println!("{cuts} times two cuts");
}
