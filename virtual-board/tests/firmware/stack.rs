//! Measures the deepest stack of the firmware.

use rigless::soc::Width;
use std::ops::Range;

use super::comb::{any_combs, paper_behind_a_comb};
use super::common::*;
use super::records::{longest_of_comb, upload};

const PATTERN: u32 = 0xA5C3_5A3C;

/// The most bytes of stack that the firmware may take. A record has 3 KB, so a function that moves records
/// about takes much.
const MOST: u64 = 40_000;

/// The stack grows down from the end of RAM towards the static variables. Nothing stops it there, so it must
/// stay far away. An interrupt at the deepest moment takes a few hundred bytes more, and may not have come in
/// this test.
#[test]
fn the_stack_stays_far_from_the_statics() {
    let address = |symbol| firmware().address_of(symbol).expect("the symbol");
    let (start, end) = (address("_stack_start"), address("__sheap"));
    let mut board = CleanBoard::power_on(paper(), Conditions::default());
    board
        .on_emulator(move |_, host, _| {
            (end..start)
                .step_by(4)
                .try_for_each(|at| host.write(at, Width::W32, PATTERN.into()))
        })
        .expect("the emulator")
        .expect("RAM");
    await_banner(&mut board);
    set(&mut board, "rows 2");
    // The result under way, and one result of the new light.
    show_all_estimators(&mut board, 2, hard_rows);
    println!("one slit: {} bytes", used(&mut board, end..start));
    // Rows of a comb, first a good one.
    set(&mut board, "slits comb");
    show_all_estimators(&mut board, 10, || [paper_behind_a_comb(), any_combs(21)]);
    println!("and a comb: {} bytes", used(&mut board, end..start));
    set(&mut board, "slits one");
    let commands = "help, help estimator, info, status, distance, centre, calibration, what";
    for command in commands.split(", ") {
        say(&mut board, command, 200);
    }
    board.take_lines();
    // Records are the largest objects. Upload one, save it, and start again with it.
    upload(&mut board, &longest_of_comb());
    for command in ["save", "save nominal"] {
        board.send(&format!("{command}\r\n"));
        await_text(&mut board, "save");
        set(&mut board, "defaults");
    }
    press_reset(&mut board);
    set(&mut board, "defaults");
    let (used, room) = (used(&mut board, end..start), start - end);
    println!("stack: {used} bytes at most of {room}");
    // At least so much, or the measurement failed: rows alone take more. At most so much that an interrupt
    // more does not matter.
    assert!(used > 4 * 1024, "{used} of {room}");
    // More than half of the room stays free.
    assert!(used < MOST.min(room / 2), "{used} of {room}");
}

fn show_all_estimators<const N: usize>(
    board: &mut VirtualBoard,
    count: usize,
    lights: impl Fn() -> [LightSource; N],
) {
    for estimator in Estimator::ALL {
        set(board, &format!("estimator {}", estimator.name()));
        for light in lights() {
            board.set_light(light);
            results(board, count);
        }
    }
}

fn used(board: &mut VirtualBoard, mut room: Range<u64>) -> u64 {
    let start = room.end;
    let deepest = board.on_emulator(move |_, host, _| {
        let mut words = room.by_ref().step_by(4);
        words.find(|&at| host.read(at, Width::W32).ok() != Some(PATTERN.into()))
    });
    let deepest = deepest.expect("the emulator");
    start - deepest.expect("a stack that is used")
}

/// Rows that take the estimators' longest paths: a good spot, one cut off at full scale, one at the sensor's
/// edge, and one with a hot pixel.
fn hard_rows() -> [LightSource; 4] {
    let mut good = spot_at(1800.3, 2000.0);
    let hot = Box::new(move |exposure: &Exposure| {
        let mut row = good(exposure);
        row[1806] = 4000.0;
        row
    });
    [
        spot_at(1800.3, 2000.0),
        spot_at(1800.3, 12_000.0),
        spot_at(3.0, 2000.0),
        hot,
    ]
}
