//! Tests of the watchdog, and of the cause that the banner names after a start.

use rigless::soc::stm32f427::generated::usart6::cr1;

use super::common::*;

/// The emulator's name for a reset by the watchdog.
const WATCHDOG: &str = r#"Model("IWDG")"#;

/// Lets the board boot again. Asserts that the banner names the cause, and that the settings are those of a
/// start.
fn assert_starts_again(board: &mut VirtualBoard, cause: &str) {
    let banner = await_banner(board);
    let end = format!(", started by {cause}");
    assert!(banner.text.ends_with(&end), "{banner}");
    let lines = fresh_results(board, 2);
    assert_readings(&lines);
    assert!(lines.iter().all(|line| line.contains(" n 16/16 ")));
    assert_eq!(ask(board, "status"), format!("status start {cause}"));
}

fn only_reset(board: &mut VirtualBoard, cause: &str) -> Nanos {
    let resets = board.resets().expect("resets");
    assert_eq!(resets.len(), 1, "{resets:?}");
    assert_eq!(format!("{:?}", resets[0].cause), cause);
    resets[0].at.0
}

/// Runs until the watchdog has reset the board, which then no longer hangs. Gives the time that this took, in
/// seconds.
fn run_into_the_watchdog(board: &mut VirtualBoard) -> f64 {
    let stopped = board.now();
    while board.resets().expect("resets").is_empty() {
        assert!(board.now() - stopped < 3_000_000_000, "no reset within 3 s");
        run_ms(board, 10);
    }
    board.unhang("measure_row").expect("the function");
    let reset = only_reset(board, WATCHDOG);
    let lasted = (reset - stopped) as f64 * 1e-9;
    println!("reset {lasted:.3} s after it stopped");
    lasted
}

/// A panic ends in an exception that the core cannot serve (a HardFault).
#[test]
fn the_watchdog_resets_after_a_logged_panic_and_if_a_computation_hangs() {
    type Stop = fn(&mut VirtualBoard, &str) -> anyhow::Result<()>;
    let cases: [(Stop, _, _); 2] = [
        // The panic comes within a row. After it nothing restarts the watchdog, whose second began at the
        // last check before.
        (VirtualBoard::panic_at, 0.85..1.05, 1),
        // One check, eight checks without a change, and the watchdog's own second.
        (VirtualBoard::hang_at, 1.5..2.5, 0),
    ];
    for (stop, range, panics) in cases {
        let mut board = measuring(4);
        fresh_results(&mut board, 1);
        assert_no_reset(&mut board);
        board.take_log();
        stop(&mut board, "measure_row").expect("the function");
        let lasted = run_into_the_watchdog(&mut board);
        assert!(range.contains(&lasted), "{lasted} s, not {range:?}");
        let log = format!("{:#?}", board.take_log());
        assert_eq!(log.matches("panicked").count(), panics, "{log}");
        assert_starts_again(&mut board, "watchdog");
        only_reset(&mut board, WATCHDOG);
    }
}

/// Stops a board in a pulse. The pulse must end at once, not after its 5.6 ms.
fn stop_in_a_pulse(board: &mut VirtualBoard, stop: fn(&mut VirtualBoard)) {
    let us = stopped_pulse_lasts(board, 0, stop);
    assert!(us < 100.0, "{us} us");
}

/// Stops a board in a pulse of 5.6 ms, some time after its begin. Gives how long the pulse then lasts, us.
fn stopped_pulse_lasts(
    board: &mut VirtualBoard,
    after_us: u64,
    stop: fn(&mut VirtualBoard),
) -> f64 {
    set(board, "exposure 5600");
    // The core then still computes a row at the pulse's begin.
    set(board, "estimator gauss-newton");
    results(board, 3);
    run_into_a_pulse(board);
    board
        .run_for(Duration::from_micros(after_us))
        .expect("a run");
    let stopped = board.now();
    stop(board);
    run_ms(board, 20);
    let pulse = board.head(|head| head.laser_pulses().next_back().expect("a pulse").clone());
    println!("stopped at {stopped} ns, in the pulse {pulse:?}");
    assert!(pulse.contains(&stopped));
    (pulse.end - stopped) as f64 / 1000.0
}

/// A core that a debugger halts serves no interrupt.
#[test]
fn a_halt_ends_the_pulse_within_a_millisecond() {
    for after_us in [10, 300, 390, 3000] {
        let mut board = measuring(4);
        let us = stopped_pulse_lasts(&mut board, after_us, serve_no_interrupt);
        println!("{after_us} us after the begin of a pulse: {us} us");
        assert!((500.0..1000.0).contains(&us), "{us} us");
    }
    // The next short pulse is a row's 5.7 ms after the one before. The timer has begun, the pulse has not.
    for before_us in [1700, 1000, 100] {
        let mut board = measuring(4);
        set(&mut board, "exposure 100");
        results(&mut board, 3);
        run_into_a_pulse(&mut board);
        board
            .run_for(Duration::from_micros(5700 - before_us))
            .expect("a run");
        serve_no_interrupt(&mut board);
        run_ms(&mut board, 1);
        let on_before = laser_time(&mut board);
        run_ms(&mut board, 20);
        assert_eq!(
            laser_time(&mut board),
            on_before,
            "halted {before_us} us before a pulse"
        );
    }
}

fn serve_no_interrupt(board: &mut VirtualBoard) {
    // NVIC_ICER0 to 2 (ARMv7-M manual, section B3.4.5).
    (0..3).for_each(|number| board.probe_writes(0xE000_E180 + 4 * number, u32::MAX));
}

/// Asserts what `info` says of the last stop, and how many stops `errors` counts.
fn assert_tells_why(board: &mut VirtualBoard, why: &str, stops: u64) {
    let info = ask_until(board, "info", |it| {
        it.starts_with("info uncertainty motion")
    });
    let told = info.iter().find(|line| line.starts_with("info last stop "));
    println!("{told:?}");
    assert!(told.is_some_and(|told| told.contains(why)), "{info:#?}");
    assert_eq!(Status::ask(board).count("stops"), stops);
}

#[test]
fn a_stop_ends_the_pulse_and_is_told_after_the_reset() {
    type Stop = fn(&mut VirtualBoard);
    let cases: [(Stop, _); 2] = [
        (|it| it.panic_now().expect("a panic"), "panic at "),
        (VirtualBoard::fault_now, "fault at 0x18000000, "),
    ];
    let mut board = measuring(4);
    for (count, (stop, why)) in (1..).zip(cases) {
        stop_in_a_pulse(&mut board, stop);
        await_line(&mut board, |line| line.ends_with("started by watchdog"));
        assert_tells_why(&mut board, why, count);
    }
    // The next interrupt finds no room on the stack.
    board.hang_now(stack_guard() + 4112);
    await_line(&mut board, |line| line.ends_with("started by watchdog"));
    assert_tells_why(&mut board, "the stack was full", 3);
    // It loses what RAM holds.
    board.dip_supply().expect("the emulator");
    await_banner(&mut board);
    assert_eq!(Status::ask(&mut board).count("stops"), 0);
}

/// How often LD1 changes in 2 s, and whether LD2 and LD3 are then on.
fn lights(board: &mut VirtualBoard) -> (usize, bool, bool) {
    let mut ld1 = vec![];
    for _ in 0..40 {
        ld1.push(output(board, "GPIOB", 0));
        run_ms(board, 50);
    }
    let changes = ld1.windows(2).filter(|it| it[0] != it[1]).count();
    let mut light = |number| output(board, "GPIOB", number).expect("an output");
    (changes, light(7), light(14))
}

#[test]
fn the_lights_show_how_the_sensor_is() {
    let mut board = measuring(4);
    let readings = lights(&mut board);
    set(&mut board, "laser off");
    results(&mut board, 3);
    run_ms(&mut board, 100);
    let faults = lights(&mut board);
    println!("readings {readings:?}, faults {faults:?}");
    assert!((3..=4).contains(&readings.0), "twice a second");
    assert!((19..=20).contains(&faults.0), "ten times a second");
    assert_eq!((readings.1, readings.2), (true, false));
    assert_eq!((faults.1, faults.2), (false, true));
    board.panic_at("measure_row").expect("the function");
    run_ms(&mut board, 20);
    let stopped = [0, 7, 14].map(|number| output(&mut board, "GPIOB", number));
    assert_eq!(stopped, [Some(false), Some(false), Some(true)]);
}

/// A flipped bit in the serial port's register stops only the serial line. An answer then waits for ever, and
/// the results wait behind it.
#[test]
fn the_watchdog_resets_if_the_serial_line_hangs() {
    let mut board = measuring(4);
    fresh_results(&mut board, 1);
    // Twice what the port's buffer holds.
    board.send(&"help\r\n".repeat(6));
    run_ms(&mut board, 50);
    change_serial_port(&mut board, Usart::Cr1, |control| control & !cr1::TE.mask());
    run_ms(&mut board, 1);
    board.take_lines();
    let rows = board.statistics().rows;
    let lasted = run_into_the_watchdog(&mut board);
    assert_eq!(board.take_lines(), [], "the line is dead");
    // 175 rows a second.
    let rows = (board.statistics().rows - rows) as f64;
    assert!(rows > 170.0 * lasted, "rows are read on: {rows}");
    assert!((1.5..2.5).contains(&lasted), "{lasted} s");
    assert_starts_again(&mut board, "watchdog");
}

/// The core's register for a reset by software (AIRCR), and the word that requests it. A debug probe starts
/// flashed firmware in this way.
const RESET_BY_SOFTWARE: (u64, u32) = (0xE000_ED0C, 0x05FA_0004);

/// The settings are then those of a start.
#[test]
fn the_banner_names_a_reset_in_the_middle_of_a_read_out() {
    type Reset = fn(&mut VirtualBoard);
    let by_software: Reset = |board| board.probe_writes(RESET_BY_SOFTWARE.0, RESET_BY_SOFTWARE.1);
    let by_hand: Reset = |board| board.reset_pin().expect("the emulator");
    for (reset, cause, of_emulator) in [
        (by_software, "software", "Core"),
        (by_hand, "reset pin", "Pin"),
    ] {
        let mut board = measuring(4);
        run_into_a_row(&mut board);
        reset(&mut board);
        assert_starts_again(&mut board, cause);
        only_reset(&mut board, of_emulator);
    }
}

/// The answer is whole, although the chip resets right after it.
#[test]
fn the_command_reset_is_answered_and_starts_the_firmware_again() {
    let mut board = measuring(4);
    run_into_a_row(&mut board);
    // Many bytes wait before the answer.
    board.send("help\r\nreset\r\n");
    let answered = await_text(&mut board, "reset").at;
    assert_starts_again(&mut board, "software");
    let reset = only_reset(&mut board, "Core");
    assert!(reset > answered);
    let uptime = ask(&mut board, "uptime");
    let since = (board.now() - reset) as f64 * 1e-9;
    println!("{uptime}, {since} s after the reset");
    assert!((since - 0.15..since).contains(&number(&uptime, "status uptime ", " s")));
}

#[test]
fn a_silent_sensor_does_not_make_the_watchdog_reset() {
    let (mut board, _) = boot(paper());
    board.open_line(Some(OpenLine::Ones));
    // This is longer than the watchdog waits.
    run_ms(&mut board, 2500);
    assert_no_reset(&mut board);
}

/// Lets the firmware hang with its stack there, until the next reset. Gives the rows of 100 ms.
fn rows_of_a_hang(board: &mut VirtualBoard, stack: u32) -> u64 {
    let hung = board.hang_with_stack_at("measure_row", stack);
    hung.expect("the function");
    let rows = board.statistics().rows;
    run_ms(board, 100);
    board.unhang("measure_row").expect("the function");
    board.statistics().rows - rows
}

fn stack_guard() -> u32 {
    let end_of_statics = firmware().address_of("__sheap").expect("the statics' end");
    let end_of_statics = u32::try_from(end_of_statics).expect("an address");
    end_of_statics.next_multiple_of(4096)
}

/// Without a guard the stack would grow into the statics, and nobody would notice.
#[test]
fn a_stack_that_is_too_deep_ends_in_a_reset() {
    let mut board = measuring(4);
    fresh_results(&mut board, 1);
    let guard = stack_guard();
    // An interrupt pushes 32 bytes or more.
    let (below, above) = (guard + 4096 + 16, guard + 8192);
    let more = rows_of_a_hang(&mut board, above);
    // As many as there are buffers, of which some may be in use.
    assert!(more >= 4, "interrupts take rows above the guard: {more}");
    board.reset_pin().expect("the emulator");
    assert_starts_again(&mut board, "reset pin");

    let more = rows_of_a_hang(&mut board, below);
    println!("{more} rows after the stack reached its guard");
    assert!(more <= 1, "{more} rows");
    assert_starts_again(&mut board, "watchdog");
}

/// The ST-LINK's clock may end. The firmware then measures by the chip's own oscillator, and says so.
#[test]
fn without_its_clock_the_firmware_ends_the_pulse_and_starts_again() {
    let mut board = measuring(4);
    stop_in_a_pulse(&mut board, |it| {
        it.end_clock().expect("a clock that is watched")
    });
    let banner = board.run_until_line(|line| line.contains("slitrange "), 6 * PATIENCE);
    let banner = banner.expect("a banner");
    println!("{banner} after {:.1} s", board.now() as f64 * 1e-9);
    let end = ", started by software, without its external clock";
    assert!(banner.text.ends_with(end), "{banner}");
    assert_readings(&fresh_results(&mut board, 2));
    assert_tells_why(&mut board, "the clock from outside stopped", 1);
    let info = ask_for_lines(&mut board, "info", 7).join("\n");
    assert!(info.contains("\ninfo clock internal"), "{info}");
}

/// The watchdog's clock may run at 17 to 47 kHz. At both ends a start, a save and `selftest` end without a
/// reset. A panic ends in a reset after 1 s by that clock, 0.68 to 1.88 s, less up to 100 ms since the last
/// pet.
#[test]
fn the_watchdog_works_with_the_slowest_and_the_fastest_clock() {
    for (watchdog_hz, least, most) in [(17_000, 1.78, 1.90), (47_000, 0.58, 0.70)] {
        let conditions = conditions(|it| it.watchdog_hz = watchdog_hz);
        let mut board = measuring_under(paper(), 64, conditions);
        for (command, last) in [("save nominal", "save"), ("selftest", "selftest pass")] {
            board.send(&format!("{command}\r\n"));
            let answer = board.run_until_line(|line| line == last, 2 * PATIENCE);
            answer.expect("an answer");
        }
        run_ms(&mut board, 2_000);
        assert_no_reset(&mut board);

        board.panic_at("measure_row").expect("the function");
        let seconds = run_into_the_watchdog(&mut board);
        let range = least..most;
        assert!(range.contains(&seconds), "{watchdog_hz} Hz: {seconds}");
        await_line(&mut board, |line| line.ends_with("started by watchdog"));
    }
}
