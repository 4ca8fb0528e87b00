//! Up to ten thousand saves: both sectors wear evenly, and nothing is lost. A configuration that is already
//! there is not written again.

use super::flash::Flash;
use super::samples::{Size, read, sample, save, save_and_check};
use crate::support::*;

fn wear(what: &str, saves: u32, sizes: &[Size]) {
    let mut flash = Flash::erased();
    for (i, &size) in (0..saves).zip(sizes.iter().cycle()) {
        let saved = sample(size, i);
        // Now and then read as after a start; each save also reads what it wrote.
        if i % 20 == 0 || i + 10 > saves {
            save_and_check(&mut flash, &saved);
        } else {
            assert_eq!(save(&mut flash, &saved), Ok(()));
        }
        let [first, second] = flash.erases;
        let is_even = first.abs_diff(second) <= 1;
        assert!(is_even, "{what}, after {i}: {first}, {second}");
        assert_eq!(flash.overwritten, 0, "{what}");
    }
    let last = sample(sizes[(saves as usize - 1) % sizes.len()], saves - 1);
    assert!(read(&mut flash) == Stored::Newest(last), "{what}");
    let (erases, words) = (flash.erases, flash.operations);
    println!("{what}: {saves} saves erase the sectors {erases:?} times and program {words} words");
}

const ALL: [Size; 7] = {
    use Size::{Least, Middle, Most};
    [Least, Most, Middle, Middle, Least, Most, Most]
};

#[test]
fn saves_wear_both_sectors_evenly() {
    wear("all sizes", 1000, &ALL);
    wear("the smallest", 2000, &[Size::Least]);
}

#[test]
#[ignore = "twice ten thousand saves; takes 11 CPU s; run by .ci/run"]
fn ten_thousand_saves_wear_both_sectors_evenly() {
    wear("all sizes", 10_000, &ALL);
    wear("the largest", 10_000, &[Size::Most]);
}

#[test]
fn saving_the_same_configuration_again_writes_nothing() {
    let mut flash = Flash::erased();
    for (i, size) in (0..).zip([Size::Least, Size::Middle, Size::Most].repeat(5)) {
        let saved = sample(size, i);
        save_and_check(&mut flash, &saved);
        let operations = flash.operations;
        assert_eq!(save(&mut flash, &saved), Ok(()));
        assert_eq!(flash.operations, operations);
    }
}
