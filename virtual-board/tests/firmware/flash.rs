//! Tests that saved configurations survive power cuts, resets and flipped bits.

use virtual_board::flash::{Done, History};

use super::common::*;
use super::kept;
use super::records::{CENTRE, longest, upload};

/// The longest time of a save: an erase of 800 ms (DS9405 table 48), and the words of the longest record.
const SAVE: Duration = Duration::from_secs(2);

fn saved(rows: u16) -> Configuration {
    kept::configuration(longest().record().clone(), rows, Mean::default())
}

/// How many such configurations fit into a sector: 16 KB over 1.9 KB.
const IN_A_SECTOR: u16 = 8;

/// Flash after `count` saves, with 1, 2, 3 rows and so on.
fn with_saves(count: u16) -> SharedFlash {
    let mut contents = Contents::erased();
    for rows in 1..=count {
        kept::save(&mut contents, &saved(rows));
    }
    SharedFlash::holding(contents)
}

fn power_on(flash: &SharedFlash) -> CleanBoard {
    boot_with(flash, spot_at(CENTRE, 2000.0))
}

fn run_into_a_save(board: &mut VirtualBoard, operations: usize) {
    board.send("save\r\n");
    let deadline = board.now() + SAVE.as_nanos() as u64;
    while board.flash().operation_count() < operations {
        assert!(board.now() < deadline, "{operations} operations");
        board.run_for(Duration::from_micros(100)).expect("a run");
    }
}

fn assert_saves(mut board: CleanBoard) {
    set(&mut board, "rows 21");
    save(&mut board);
    assert_eq!(kept::saved_in(&board.flash().contents()), saved(21));
}

struct Saves {
    first_ever: History,
    /// A save into the sector in use.
    without_erase: History,
    /// A save that erases the other sector.
    with_erase: History,
}

impl Saves {
    fn of_the_firmware() -> &'static Self {
        static SAVES: OnceLock<Saves> = OnceLock::new();
        SAVES.get_or_init(|| Self {
            first_ever: save_20_rows(&SharedFlash::default()),
            without_erase: save_20_rows(&with_saves(1)),
            with_erase: save_20_rows(&with_saves(IN_A_SECTOR)),
        })
    }
}

fn save_20_rows(flash: &SharedFlash) -> History {
    let mut board = power_on(flash);
    if flash.contents() == Contents::erased() {
        upload(&mut board, &longest());
    }
    set(&mut board, "rows 20");
    assert_eq!(flash.operation_count(), 0, "that touches no flash");
    save(&mut board);
    flash.take_history()
}

/// A power cut after a number of operations, or during the next operation, of which the seed is given.
type Cut = (usize, Option<u64>);

fn left_by((count, seed): Cut, history: &History) -> Contents {
    match seed {
        None => history.after(count),
        Some(seed) => history.torn_after(count, seed),
    }
}

fn before_and_after(history: &History) -> [Configuration; 2] {
    [0, history.operations.len()].map(|count| kept::saved_in(&history.after(count)))
}

/// Asserts that a board that starts with `contents` uses the configuration that the store finds there on this
/// PC.
fn assert_board_starts_with(contents: &Contents) {
    let flash = SharedFlash::holding(contents.clone());
    let mut board = power_on(&flash);
    kept::assert_in_use(&mut board, &kept::read(contents));
    assert_eq!(flash.contents(), *contents, "a start only reads");
}

/// Cuts the power after each operation of a save, and during each. The store then finds the old configuration
/// or the new one, whole. Once it finds the new one, it does so after every later cut.
#[test]
fn a_power_cut_at_any_operation_leaves_the_old_or_the_new_configuration() {
    let saves = Saves::of_the_firmware();
    for (what, history, erased) in [
        ("without an erase", &saves.without_erase, 0),
        ("with an erase", &saves.with_erase, 1),
    ] {
        assert_eq!(history.erases_of(12) + history.erases_of(13), erased);
        let [old, new] = before_and_after(history);
        assert_eq!(new, saved(20));
        assert_ne!(old, new);
        let is_new = |cut: Cut| match kept::saved_in(&left_by(cut, history)) {
            saved if saved == old => false,
            saved if saved == new => true,
            other => panic!("{what}, {cut:?}: neither the old nor the new but {other:?}"),
        };
        let count = history.operations.len();
        let plain: Vec<bool> = (0..=count).map(|count| is_new((count, None))).collect();
        assert!(plain.is_sorted(), "{what}: the old one came back");
        let mut torn = vec![];
        for (number, done) in history.operations.iter().enumerate() {
            // Each time it is torn differently.
            let ways = match done.operation {
                Operation::Erase { .. } => 100,
                Operation::Program { .. } => 4,
            };
            let seeds = (0..ways).map(|way| way << 32 | number as u64);
            torn.extend(seeds.map(|seed| is_new((number, Some(seed)))));
        }
        println!("a save {what}, {count} operations");
        for (name, cuts) in [("between operations", plain), ("in an operation", torn)] {
            let (all, new) = (cuts.len(), cuts.iter().filter(|&&new| new).count());
            println!("of {all} cuts {name} {new} leave the new one");
        }
        assert!(count > 300, "{count} operations");
    }
}

/// Below 2.7 V and without the brown-out reset, flash may program wrong words, and the firmware may go on. Of
/// some words in a row, any bits are cleared, and the save then ends as usual, or there. The store finds the
/// old configuration or the new one, never another.
#[test]
fn wrong_words_of_a_low_supply_leave_the_old_or_the_new_configuration() {
    let saves = Saves::of_the_firmware();
    let mut random = ChaCha8Rng::seed_from_u64(24);
    for history in [&saves.without_erase, &saves.with_erase] {
        let [old, new] = before_and_after(history);
        let operations = &history.operations;
        let mut found = [0; 2];
        for round in 0..300 {
            let wrong = random.random_range(0..operations.len());
            let wrong = wrong..wrong + [1, 1, 2, 8, 64][round % 5];
            let ends_there = round % 2 == 0;
            let mut contents = history.after(0);
            for (number, done) in operations.iter().enumerate() {
                if ends_there && number >= wrong.end {
                    break;
                }
                contents.apply(match done.operation {
                    Operation::Program { address, word } if wrong.contains(&number) => {
                        // Some bits that should stay are cleared, some that should be cleared stay.
                        let word = match round % 3 {
                            0 => random.random(),
                            1 => word & random.random::<u32>(),
                            _ => word | random.random::<u32>(),
                        };
                        Operation::Program { address, word }
                    }
                    operation => operation,
                });
            }
            let saved = kept::saved_in(&contents);
            let is_one = saved == old || saved == new;
            assert!(is_one, "{wrong:?} {ends_there}: {saved:?}");
            found[usize::from(saved == new)] += 1;
        }
        println!("the old one and the new one: {found:?} times");
        assert!(found[0] > 200, "{found:?}");
    }
}

/// In the very first save there is no old configuration. Until the new one is whole, the nominal calibration
/// is used, or none.
#[test]
fn a_power_cut_in_the_very_first_save_leaves_the_nominal_calibration_or_none() {
    let history = &Saves::of_the_firmware().first_ever;
    let count = history.operations.len();
    let new = Stored::Newest(kept::saved_in(&history.after(count)));
    let mut found = [0; 3];
    for count in 0..count {
        for cut in [(count, None), (count, Some(count as u64))] {
            let kept = kept::read(&left_by(cut, history));
            let is = [&Stored::Nothing, &Stored::Unusable, &new].map(|it| *it == kept);
            assert!(is.contains(&true), "{cut:?}: {kept:?}");
            for (found, is) in found.iter_mut().zip(is) {
                *found += usize::from(is);
            }
        }
    }
    let [nothing, unusable, new] = found;
    println!(
        "{count} operations: {nothing} cuts leave nothing, {unusable} none, {new} the new one"
    );
    // `Nothing` only before the first word, and the new configuration only after the last word.
    assert!((1..=4).contains(&nothing) && new <= 1);
    assert_board_starts_with(&history.after(count / 2));
}

/// After some of these cuts, the board uses the configuration that the store finds on this PC.
fn assert_board_starts_after(cuts: impl Fn(usize) -> Vec<Cut>) {
    let saves = Saves::of_the_firmware();
    for history in [&saves.without_erase, &saves.with_erase] {
        let last = history.operations.len() - 1;
        for cut in cuts(last) {
            println!("{cut:?} of {last}");
            assert_board_starts_with(&left_by(cut, history));
        }
    }
}

#[test]
fn a_board_starts_with_the_configuration_that_a_power_cut_left() {
    assert_board_starts_after(|last| vec![(0, Some(0)), (last, Some(0))]);
}

#[test]
#[ignore = "starts the board eight times, 20 s; .ci/run runs it"]
fn a_board_starts_with_the_configuration_that_any_power_cut_left() {
    assert_board_starts_after(|last| {
        let mut random = ChaCha8Rng::seed_from_u64(last as u64);
        let anywhere = (0..3).map(|_| (random.random_range(1..last), Some(random.random())));
        [(1, None)].into_iter().chain(anywhere).collect()
    });
}

/// Starts a board after some of the operations of a save. It uses the configuration that the store finds on
/// this PC, the old one or the new one. A start takes three seconds of the PC, so a start after every
/// operation would take an hour.
#[test]
#[ignore = "starts the board 34 times, 50 s; .ci/run runs it"]
fn a_board_starts_after_a_power_cut_anywhere_in_a_save() {
    const EVERY: usize = 47;

    let saves = Saves::of_the_firmware();
    for history in [&saves.without_erase, &saves.with_erase] {
        let flash = SharedFlash::holding(history.after(0));
        let mut board = power_on(&flash);
        let last = history.operations.len();
        println!("every {EVERY}th of {last}");
        for count in (0..last).step_by(EVERY).chain([last - 1, last]) {
            flash.put(history.after(count));
            board.take_lines();
            press_reset(&mut board);
            kept::assert_shown_as(&mut board, &kept::read(&flash.contents()));
        }
    }
}

/// The board's own power fails in the middle of a save. The next board with the same flash uses the old
/// configuration, and can save.
#[test]
fn a_save_ends_when_the_power_fails() {
    let flash = with_saves(3);
    let mut board = power_on(&flash);
    set(&mut board, "rows 20");
    flash.cut_power_after(200);
    board.send("save\r\n");
    board.run_for(SAVE).expect("a run");
    drop(board);
    assert_eq!(flash.take_history().operations.len(), 200);

    let mut board = power_on(&flash);
    kept::assert_in_use(&mut board, &Stored::Older(saved(3)));
    assert_saves(board);
}

#[test]
fn a_reset_during_an_erase_keeps_the_saved_configuration() {
    let flash = with_saves(IN_A_SECTOR);
    let mut board = power_on(&flash);
    set(&mut board, "rows 20");
    run_into_a_save(&mut board, 1);
    run_ms(&mut board, 100);
    assert_eq!(flash.operation_count(), 1, "it is being erased");
    press_reset(&mut board);
    kept::assert_in_use(&mut board, &Stored::Newest(saved(IN_A_SECTOR)));
    assert_saves(board);
}

/// The supply dips: in a row, in the erase of a save, and among the words of a save. Each time the board
/// starts by itself, names the cause, and measures with the old configuration or the new one.
#[test]
fn after_a_supply_dip_the_board_measures_with_the_old_or_the_new_configuration() {
    let flash = with_saves(IN_A_SECTOR);
    let mut board = power_on(&flash);
    run_into_a_row(&mut board);
    for dip in ["in a row", "in an erase", "among the words"] {
        if dip != "in a row" {
            flash.take_history();
            set(&mut board, "rows 20");
            run_into_a_save(&mut board, if dip == "in an erase" { 1 } else { 200 });
        }
        board.dip_supply().expect("the emulator");
        board.take_lines();
        let left = flash.contents();
        let banner = await_banner(&mut board);
        assert!(banner.text.ends_with(", started by supply dip"), "{banner}");
        let status = Status::ask(&mut board).0;
        assert_eq!(status[0], "status start supply dip");
        kept::assert_in_use(&mut board, &kept::read(&left));
        assert_eq!(flash.contents(), left, "a start only reads");
        assert_eq!(kept::saved_in(&left), saved(IN_A_SECTOR), "{dip}");
    }
    // The next reset names its own cause.
    let banner = press_reset(&mut board);
    assert!(banner.text.ends_with(", started by reset pin"), "{banner}");
    assert_eq!(board.resets().expect("resets").len(), 4);
    assert_saves(board);
}

/// Flips a bit. In the newest configuration: the board uses the one before, or gives no distances if there is
/// none. In the one before: nothing changes.
#[test]
fn a_flipped_bit_is_detected() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut flipped = |contents: &Contents, offset: usize| {
        let mut flipped = contents.clone();
        flipped.flip_bits(offset, 1 << random.random_range(0..8));
        flipped
    };
    let history = &Saves::of_the_firmware().without_erase;
    let [old, new] = before_and_after(history);
    let before = history.after(0);
    let after = history.after(history.operations.len());
    let place = |done: &Done| match done.operation {
        Operation::Program { address, .. } => Some((address - BASE) as usize),
        Operation::Erase { .. } => None,
    };
    let programmed: Vec<usize> = history.operations.iter().filter_map(place).collect();
    // A bit of the item's number, of the middle of the record, and of the last knot.
    for place in [3, programmed.len() / 2, programmed.len() - 10] {
        let contents = flipped(&after, programmed[place]);
        assert_eq!(kept::saved_in(&contents), old, "at {place}");
        assert_board_starts_with(&contents);
    }
    // A word before the older item marks its sector as used.
    let used = (before.bytes().iter()).position(|&byte| byte != 0xFF);
    for offset in [20, 1000].map(|offset| used.expect("an item") + offset) {
        let contents = flipped(&after, offset);
        assert_eq!(kept::saved_in(&contents), new);
        assert_board_starts_with(&contents);

        let contents = flipped(&before, offset);
        assert!(kept::read(&contents) == Stored::Unusable);
        assert_board_starts_with(&contents);
    }
}
