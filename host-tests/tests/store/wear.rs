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
        assert!(first.abs_diff(second) <= 1, "after {i}: {first}, {second}");
        assert_eq!(flash.overwritten, 0);
    }
    let last = sample(sizes[(saves as usize - 1) % sizes.len()], saves - 1);
    assert!(read(&mut flash) == Stored::Newest(last));
    let (erases, words) = (flash.erases, flash.operations);
    println!("{what}: {saves} saves erase the sectors {erases:?} times and program {words} words");
}

#[test]
#[ignore = "ten thousand saves; takes 6 CPU s; run by .ci/run"]
fn ten_thousand_saves_of_the_largest_wear_both_sectors_evenly() {
    wear("the largest", 10_000, &[Size::Most]);
}

fn wear_of_all_sizes(saves: u32) {
    use Size::{Least, Middle, Most};
    let sizes = [Least, Most, Middle, Middle, Least, Most, Most];
    wear("all sizes", saves, &sizes);
}

#[test]
fn saves_of_all_sizes_wear_both_sectors_evenly() {
    wear_of_all_sizes(1000);
}

#[test]
#[ignore = "ten thousand saves; takes 5 CPU s; run by .ci/run"]
fn ten_thousand_saves_of_all_sizes_wear_both_sectors_evenly() {
    wear_of_all_sizes(10_000);
}

#[test]
fn saves_of_the_smallest_wear_both_sectors_evenly() {
    wear("the smallest", 2000, &[Size::Least]);
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
