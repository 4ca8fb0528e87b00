//! `cargo silicon-check` on the virtual board: it passes, and each of its checks fails when its fault is put
//! in. Checks that do not meet share a run.

use std::sync::OnceLock;
use std::time::Duration;

use rigless::mcu::{Mcu as _, Operate as _};
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::{dbg, flash, gpioa};
use simulator::with;
use virtual_board::board::Conditions;
use virtual_board::flash::{BASE, BYTES, Operation};
use virtual_board::jumpers::{Jumpers, Miso};
use virtual_board::{Exposure, Firmware, PIXELS, VirtualBoard};

/// The program's mark beside a number of rows: `WRITTEN` in on-chip/silicon-check/src/kept.rs.
const WRITTEN: u32 = 0x5111_C0DE;

/// Rows of a short run.
const ROWS: u32 = 20;

/// Clears a bit of the last word of sector 15, a bit that the program does not clear.
const LAST_WORD: Operation = Operation::Program {
    address: BASE + BYTES as u64 - 4,
    word: !0b10,
};

/// The last check before the program waits for the watchdog.
const BEFORE_WATCHDOG: &str = "laser off";

fn program() -> &'static Firmware {
    static PROGRAM: OnceLock<Firmware> = OnceLock::new();
    PROGRAM.get_or_init(|| Firmware::build_package("silicon-check").expect("it builds"))
}

/// A board with these jumper wires, before its first instruction.
fn board(jumpers: Jumpers, conditions: Conditions, rows: u32) -> VirtualBoard {
    let conditions = with(conditions, |it| it.jumpers = Some(jumpers));
    let dark = Box::new(|_: &Exposure| vec![200.0; PIXELS]);
    let mut board = VirtualBoard::power_on_under(program(), dark, conditions).expect("a board");
    let kept = program().address_of("KEPT").expect("the symbol");
    board.write_words(kept, vec![WRITTEN, rows]).expect("RAM");
    board
}

/// All lines up to the one of this check, or to the last one.
fn lines_up_to(board: &mut VirtualBoard, check: &str, patience: Duration) -> Vec<String> {
    let is_last = |line: &str| {
        let of_check = line.split_once(' ').map(|(_, rest)| rest);
        line.starts_with("silicon-check:") || of_check.is_some_and(|rest| rest.starts_with(check))
    };
    let last = board.run_until_line(is_last, patience);
    let lines = board.take_lines().into_iter();
    let lines: Vec<String> = lines.map(|line| line.text).collect();
    last.unwrap_or_else(|error| panic!("{error:#}\n{}", lines.join("\n")));
    lines
}

/// The names of the checks that `word` begins the lines of.
fn named<'a>(word: &str, lines: &'a [String]) -> Vec<&'a str> {
    let checks = lines.iter().filter_map(|line| line.strip_prefix(word));
    checks
        .filter_map(|line| line.split_once(": ").map(|(name, _)| name.trim()))
        .collect()
}

/// Runs up to the watchdog. Exactly these checks must fail and be skipped; commas divide them.
#[track_caller]
fn fails(mut board: VirtualBoard, failing: &str, skipped: &str) {
    let lines = lines_up_to(&mut board, BEFORE_WATCHDOG, Duration::from_secs(10));
    let named = ["FAIL", "skip"].map(|word| named(word, &lines).join(", "));
    assert_eq!(named, [failing, skipped], "{}", lines.join("\n"));
}

/// Runs all checks, and none must fail. The lines are those in the documentation.
fn passes(rows: u32) {
    let mut board = board(Jumpers::default(), Conditions::default(), rows);
    let mut contents = board.flash().contents();
    contents.apply(LAST_WORD);
    board.flash().put(contents.clone());
    let lines = lines_up_to(&mut board, "silicon-check", Duration::from_secs(90));
    let text = lines.join("\n");
    assert_eq!(named("FAIL", &lines), [""; 0], "{text}");
    assert_eq!(named("skip", &lines), [""; 0], "{text}");
    let last = "silicon-check: 28 pass, 0 fail, 0 skipped";
    assert_eq!(lines.last().unwrap(), last);
    let is_as_before = board.flash().contents() == contents;
    assert!(is_as_before, "the sector is as it was");
    board.finish().expect("a clean run");
    println!("{text}");
    compare_with_documentation(&text);
}

/// A text with one `#` for each number.
fn without_numbers(text: &str) -> String {
    let mut letters: Vec<char> = text.chars().collect();
    letters.dedup_by(|next, before| next.is_ascii_digit() && before.is_ascii_digit());
    String::from_iter(letters).replace(|letter: char| letter.is_ascii_digit(), "#")
}

/// The run in the documentation, and this run, must be the same but for their numbers.
fn compare_with_documentation(run: &str) {
    let page = include_str!("../../docs/silicon-check.md");
    let start = page.find("```text\n").expect("a run") + "```text\n".len();
    let shown = &page[start..];
    let shown = &shown[..shown.find("\n```").expect("its end")];
    assert!(
        without_numbers(shown) == without_numbers(run),
        "docs/silicon-check.md shows another run; this is the run:\n{run}"
    );
}

#[test]
#[ignore = "its program is a build of its own, 30 CPU s; .ci/run runs it"]
fn all_checks_pass_on_a_board_without_faults() {
    passes(ROWS);
}

#[test]
#[ignore = "takes some minutes: prints the run that docs/silicon-check.md shows"]
fn all_checks_pass_with_ten_thousand_rows() {
    passes(10_000);
}

/// A board whose conditions and wires differ from good ones.
fn board_with(change: impl FnOnce(&mut Conditions, &mut Jumpers)) -> VirtualBoard {
    let (mut conditions, mut jumpers) = (Conditions::default(), Jumpers::default());
    change(&mut conditions, &mut jumpers);
    board(jumpers, conditions, ROWS)
}

#[test]
#[ignore = "its program is a build of its own, 30 CPU s; .ci/run runs it"]
fn missing_wires_and_a_missing_clock_fail() {
    let board = board_with(|conditions, jumpers| {
        (jumpers.lacks_fm, jumpers.lacks_sclk, jumpers.miso) = (true, true, Miso::Missing);
        conditions.has_clock = false;
    });
    let failing = "clock, fM, SCLK edges, MISO low, MISO fM";
    fails(board, failing, "t4, SCLK time");
}

#[test]
#[ignore = "its program is a build of its own, 30 CPU s; .ci/run runs it"]
fn a_late_fall_of_sh_and_an_sclk_with_gaps_fail() {
    // t1 is 9.0 us, and at least 1 us is right. MISO is low while it is high or open.
    let mut board = board_with(|_, jumpers| {
        jumpers.late.sh_falls = 168 * 86 / 10;
        jumpers.miso = Miso::StuckLow;
    });
    // One period of SCLK after word 1000.
    let pause = (1000, Duration::from_nanos(96));
    board.pause_words(Some(pause)).expect("the emulator");
    fails(board, "t1, SCLK time, MISO high, MISO open, MISO fM", "");
}

#[test]
#[ignore = "its program is a build of its own, 30 CPU s; .ci/run runs it"]
fn a_late_fall_of_icg_and_lost_edges_fail() {
    // t2 is 500 ns, and 100 ns or more are right.
    let board = board_with(|_, jumpers| {
        (jumpers.late.icg_falls, jumpers.lost_edges) = (75, 1);
        jumpers.miso = Miso::NoPullUp;
    });
    fails(board, "t2, SCLK edges, MISO open", "SCLK time");
}

#[test]
#[ignore = "its program is a build of its own, 30 CPU s; .ci/run runs it"]
fn a_short_pulse_of_sh_and_a_missing_chip_select_fail() {
    // t3 is 1500 ns, and 1000 ns or more are right. t2 is 500 ns and gains 100 ns.
    let board = board_with(|_, jumpers| {
        jumpers.late.icg_falls = 168 * 7 / 10;
        jumpers.late.sh_rises = 168 * 8 / 10;
        (jumpers.lacks_chip_select, jumpers.miso) = (true, Miso::StuckHigh);
    });
    fails(board, "t3, SCLK edges, MISO low, MISO fM", "SCLK time");
}

#[test]
#[ignore = "its program is a build of its own, 30 CPU s; .ci/run runs it"]
fn a_late_rise_of_icg_and_a_slow_flash_fail() {
    // t4 is below 50 ns, and fM is high for 190 ns. An erase takes at most 800 ms, a word 100 us.
    let board = board_with(|conditions, jumpers| {
        jumpers.late.icg_rises = 32;
        (conditions.flash_erase, conditions.flash_word) = (850_000_000, 120_000);
    });
    fails(board, "t4, erase, program", "");
}

#[test]
#[ignore = "its program is a build of its own, 30 CPU s; .ci/run runs it"]
fn missing_pulses_and_bits_of_miso_fail() {
    // And a bit that SPI1 loses, or reads too early.
    for change in [
        |wires: &mut Jumpers| (wires.lacks_icg, wires.miso) = (true, Miso::Slips),
        |wires: &mut Jumpers| (wires.lacks_sh, wires.miso) = (true, Miso::Stale),
    ] {
        let board = board_with(|_, wires| change(wires));
        fails(board, "pulses, MISO fM", "t1, t2, t3, t4");
    }
}

#[test]
#[ignore = "its program is a build of its own, 30 CPU s; .ci/run runs it"]
fn another_chip_and_faults_of_its_own_pins_fail() {
    let mut board = board_with(|_, wires| {
        wires.laser_falls_late = 100_000;
        (wires.trigger_at_ground, wires.bytes_unheard) = (true, 3);
    });
    // An STM32F405, and PD12 is no output.
    board
        .on_emulator(|session, _, _| {
            let part = &mut session.board_mut().processor.part;
            let slot = part.bus().slot("DBG").expect("the debugger's block");
            let registers = part.bus_mut().slot_mut(slot).registers_mut();
            registers.set(dbg::Register::DbgmcuIdcode, 0x1007_0413);
        })
        .expect("the emulator");
    lines_up_to(&mut board, "clock", Duration::from_secs(4));
    board
        .on_emulator(|session, _, _| {
            let (_, registers) = session.board_mut().processor.part.port(3);
            let modes = registers.get(gpioa::Register::Moder);
            registers.set(gpioa::Register::Moder, modes & !(0b11 << 24));
        })
        .expect("the emulator");
    let failing = "chip, RS-485, trigger, reception, laser, laser off";
    fails(board, failing, "");
}

#[test]
#[ignore = "its program is a build of its own, 30 CPU s; .ci/run runs it"]
fn a_slow_core_fails() {
    // More than five clocks an instruction: t4 is far beyond its limit then, whatever the phase of fM.
    let mut board = board_with(|it, _| it.instructions_per_second = 32_000_000);
    // The sensor head sees the late edges too.
    board.expect_violations();
    let failing = "rows, t4, cycles centroid, cycles phase-table, cycles adaptive, cycles gauss-newton, \
                   cycles fraunhofer";
    let skipped = "MISO low, MISO high, MISO open, MISO fM, erase, program";
    fails(board, failing, skipped);
}

#[test]
#[ignore = "its program is a build of its own, 30 CPU s; .ci/run runs it"]
fn a_protected_and_a_worn_sector_fail() {
    let mut board = board(Jumpers::default(), Conditions::default(), ROWS);
    lines_up_to(&mut board, "MISO high", Duration::from_secs(10));
    // The rows with MISO open take less than 50 ms. Then the sector is erased for 400 ms.
    board.run_for(Duration::from_millis(100)).expect("a run");
    // The erase reports that the sector is protected.
    board
        .on_emulator(|session, _, _| {
            let part = &mut session.board_mut().processor.part;
            let slot = part.bus().slot("FLASH").expect("the flash's interface");
            let registers = part.bus_mut().slot_mut(slot).registers_mut();
            let flags = registers.get(flash::Register::Sr);
            assert!(flash::sr::BSY.is_set(flags), "an erase is under way");
            registers.set(flash::Register::Sr, flash::sr::WRPERR.set(flags, 1));
        })
        .expect("the emulator");
    // A bit of its last word was not erased.
    let mut contents = board.flash().contents();
    contents.apply(LAST_WORD);
    board.flash().put(contents);
    board.expect_violations();
    fails(board, "erase, program", "");
}

#[test]
#[ignore = "its program is a build of its own, 30 CPU s; .ci/run runs it"]
fn a_watchdog_that_does_not_bite_fails() {
    let mut board = board(Jumpers::default(), Conditions::default(), ROWS);
    lines_up_to(&mut board, BEFORE_WATCHDOG, Duration::from_secs(10));
    // Pets the watchdog in the firmware's place.
    for _ in 0..60 {
        board.run_for(Duration::from_millis(100)).expect("a run");
        board
            .on_emulator(|session, _, stop| {
                let part = &mut session.board_mut().processor.part;
                part.write(stop.at, 0x4000_3000, Width::W32, 0xAAAA)
            })
            .expect("the emulator")
            .expect("the watchdog's register");
    }
    let lines = lines_up_to(&mut board, "silicon-check", Duration::from_secs(1));
    assert_eq!(named("FAIL", &lines), ["watchdog"], "{}", lines.join("\n"));
    let last = "silicon-check: 27 pass, 1 fail, 0 skipped";
    assert_eq!(lines.last().unwrap(), last);
}
