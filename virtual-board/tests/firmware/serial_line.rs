//! Tests of noise and random bytes on the serial line: the firmware continues to measure and answers only
//! with errors.

use rigless::soc::stm32f427::generated::usart6::{cr1, cr3};
use slitrange_device::protocol::command::Command;
use slitrange_device::protocol::input::Input;
use virtual_board::Arrival;

use super::common::*;
use super::records::CENTRE;

/// The number of random bytes.
const BYTES: usize = 10 * 1024;

/// The time to send the bytes at 115200 baud, ten bits each.
const TRANSFER: Duration = Duration::from_micros(BYTES as u64 * 10 * 1_000_000 / 115_200);

/// Uniform random bytes. The probability that they contain a command is about 10^4 / 256^5.
fn random_bytes(seed: u64) -> Vec<u8> {
    let mut bytes = vec![0; BYTES];
    ChaCha8Rng::seed_from_u64(seed).fill(&mut bytes[..]);
    bytes
}

/// Sends the bytes at full line rate. Gives the start time, and all lines that came meanwhile.
fn flood(board: &mut VirtualBoard, bytes: &[u8]) -> (Nanos, Vec<Line>) {
    board.take_lines();
    let start = board.now();
    board.send_at(start, bytes);
    // The last line of the bytes has no end.
    board.send("\r\n");
    let longest = TRANSFER + Duration::from_millis(50);
    board.run_for(longest).expect("a run");
    (start, board.take_lines())
}

/// Asserts that every line is a reading or an error, and that there are enough of both.
fn assert_measures_on(lines: &[Line], start: Nanos) {
    let end = start + TRANSFER.as_nanos() as Nanos;
    let (mut readings, mut errors) = (0, 0);
    for line in lines {
        assert!(is_reading(&line.text) || is_error(&line.text), "{line}");
        errors += usize::from(is_error(&line.text));
        readings += usize::from(is_reading(&line.text) && (start..end).contains(&line.at));
    }
    println!("{BYTES} bytes: {readings} readings meanwhile, {errors} errors said");
    // A frame of 4 rows takes 22.8 ms.
    let frames = (TRANSFER.as_secs_f64() / 0.0228) as usize;
    assert!(readings >= frames - 2, "{readings} of {frames}: {lines:#?}");
    assert!(errors >= 20, "{lines:#?}");
}

/// Whether a line is `E`, a number, a blank and words.
fn is_error(line: &str) -> bool {
    let parts = line.strip_prefix('E').and_then(|rest| rest.split_once(' '));
    parts.is_some_and(|(number, words)| number.parse::<u32>().is_ok() && !words.is_empty())
}

/// Asserts that readings come, that no row was lost, and that a command works.
fn assert_lives_on(board: &mut VirtualBoard) {
    Status::ask(board).assert_nothing_lost();
    set(board, "rows 7");
    for line in fresh_results(board, 3) {
        assert!(line.contains(" n 7/7 "), "{line}");
    }
}

/// The core's answers to these bytes.
fn errors_about(bytes: &[u8]) -> Vec<String> {
    let mut input = Input::new();
    bytes
        .iter()
        .chain(b"\r\n")
        .filter_map(|&byte| match input.take(byte)? {
            Ok(Command::Nothing) => None,
            Ok(command) => panic!("the bytes hold the command `{command}`: take another seed"),
            Err(error) => Some(error.to_string()),
        })
        .collect()
}

#[test]
fn random_bytes_are_answered_by_errors_and_measuring_continues() {
    let mut board = measuring(4);
    fresh_results(&mut board, 1);
    let bytes = random_bytes(1);
    let (start, lines) = flood(&mut board, &bytes);
    assert_measures_on(&lines, start);
    let errors = lines.iter().map(|line| &line.text);
    let errors = errors.filter(|line| is_error(line));
    assert!(errors.eq(&errors_about(&bytes)));
    assert_lives_on(&mut board);
}

#[test]
fn noise_and_framing_errors_are_counted_and_the_line_still_works() {
    let mut board = measuring(4);
    fresh_results(&mut board, 1);
    // A tenth of the bytes each.
    garble(&mut board, 100_000, 100_000);
    let (start, lines) = flood(&mut board, &random_bytes(2));
    assert_measures_on(&lines, start);
    garble(&mut board, 0, 0);
    // The garbled bytes may have ended within a line.
    say(&mut board, "", 20);
    board.take_lines();
    let status = Status::ask(&mut board);
    for kind in ["serial noise", "serial framing"] {
        let count = status.count(kind);
        println!("{kind}: {count}");
        assert!((800..1300).contains(&count), "{kind}: {count} of {BYTES}");
    }
    assert_lives_on(&mut board);
}

#[test]
fn commands_typed_without_a_pause_are_all_answered() {
    let mut board = measuring(16);
    let commands: Vec<String> = (1..=64).map(|rows| format!("rows {rows}")).collect();
    board.take_lines();
    say(&mut board, &commands.join("\r\n"), 150);
    let mut answers = take_texts(&mut board);
    answers.retain(|line| !is_result(line));
    assert_eq!(answers, commands);
    assert_eq!(ask(&mut board, "rows"), "rows 64");
}

/// The rate that the firmware receives at, bits a second.
const BAUD: u64 = 115_200;

/// The levels of the line while bytes are sent at a rate, each with its duration in seconds. A byte has a
/// start bit, eight bits with the lowest first, and a stop bit.
fn levels(bytes: &[u8], baud: u64) -> Vec<(bool, f64)> {
    let bit = 1.0 / baud as f64;
    let bits = |byte: &u8| {
        let byte = u16::from(*byte);
        (0..10).map(move |place| ((byte << 1 | 0x200) >> place & 1 == 1, bit))
    };
    bytes.iter().flat_map(bits).collect()
}

/// What a receiver at [`BAUD`] makes of the line's levels. It waits for an edge from high to low, and looks
/// into the middle of each bit.
fn received(levels: &[(bool, f64)]) -> Vec<Arrival> {
    let total: f64 = levels.iter().map(|(_, time)| time).sum();
    let at = |time: f64| {
        let mut end = 0.0;
        let level = levels.iter().find(|(_, length)| {
            end += length;
            time < end
        });
        level.is_none_or(|(level, _)| *level)
    };
    let bit = 1.0 / BAUD as f64;
    let step = bit / 16.0;
    let (mut time, mut before, mut arrivals) = (0.0, true, vec![]);
    while time < total {
        let now = at(time);
        if before && !now {
            let sample = |place: u32| at(time + (f64::from(place) + 0.5) * bit);
            let byte = (0..8)
                .map(|place| u8::from(sample(place + 1)) << place)
                .sum();
            let has_stop_bit = sample(9);
            arrivals.push(Arrival { byte, has_stop_bit });
            time += 9.5 * bit;
            before = has_stop_bit;
        } else {
            time += step;
            before = now;
        }
    }
    arrivals
}

#[test]
fn a_receiver_takes_bytes_at_its_rate_and_a_break_as_one_byte() {
    let bytes = b"rows 5\r\n\x00\xff";
    let clean = bytes.map(|byte| Arrival {
        byte,
        has_stop_bit: true,
    });
    assert_eq!(received(&levels(bytes, BAUD)), clean);
    // Two per cent off.
    assert_eq!(received(&levels(bytes, BAUD * 98 / 100)), clean);
    let a_break = Arrival {
        byte: 0,
        has_stop_bit: false,
    };
    assert_eq!(received(&[(false, 0.1), (true, 0.1)]), [a_break]);
}

/// Lines with their numbers. Asserts that each result of the stream is the next one, whatever comes between.
#[derive(Default)]
struct Numbered {
    last: Option<f64>,
    results: usize,
    others: Vec<String>,
}

impl Numbered {
    fn start(board: &mut VirtualBoard) -> Self {
        const COLUMNS: &str = "output counter distance u r centre rows flags";
        tell(board, COLUMNS);
        board.take_lines();
        Self::default()
    }

    fn take(&mut self, board: &mut VirtualBoard) {
        for line in board.take_lines() {
            if !line.text.starts_with("# ") {
                self.others.push(line.text);
                continue;
            }
            let now = number(&line.text, "# ", " d ");
            assert!(self.last.is_none_or(|last| last + 1.0 == now), "{line}");
            self.last = Some(now);
            self.results += 1;
        }
    }

    /// Sends a line. Gives what came that is no result.
    fn ask(&mut self, board: &mut VirtualBoard, line: &str) -> Vec<String> {
        say(board, line, 60);
        self.take(board);
        std::mem::take(&mut self.others)
    }
}

/// After a break, and after a PC that has another rate, the next line is a command again.
#[test]
fn breaks_and_other_rates_are_counted_and_cost_no_reading_and_no_setting() {
    let mut board = measuring(4);
    let mut numbered = Numbered::start(&mut board);
    let mut without_stop_bit = 0;
    let mut arrive = |board: &mut VirtualBoard, levels: &[(bool, f64)]| {
        let arrivals = received(levels);
        without_stop_bit += arrivals.iter().filter(|it| !it.has_stop_bit).count();
        board.arrive(&arrivals).expect("a run");
        arrivals.iter().map(|it| it.byte).collect::<Vec<u8>>()
    };
    // Breaks before a command.
    for breaks in [1, 3] {
        for _ in 0..breaks {
            arrive(&mut board, &[(false, 0.03), (true, 0.001)]);
        }
        assert_eq!(numbered.ask(&mut board, "rows"), ["rows 4"]);
    }
    // A break within a command.
    board.send("rows 9");
    run_ms(&mut board, 5);
    arrive(&mut board, &[(false, 0.03), (true, 0.001)]);
    assert_eq!(numbered.ask(&mut board, ""), ["E5 not ASCII text"]);
    assert_eq!(numbered.ask(&mut board, "rows"), ["rows 4"]);
    for baud in [9600, 19_200, 38_400, 57_600, 230_400, 460_800, 921_600] {
        let mut all = levels(&b"rows 9\r\nstream off\r\n".repeat(3), baud);
        all.push((true, 0.001));
        let bytes = arrive(&mut board, &all);
        let errors = numbered.ask(&mut board, "");
        println!("{baud} baud: {} bytes, {errors:?}", bytes.len());
        assert_eq!(errors, errors_about(&bytes), "{baud} baud");
        assert_eq!(numbered.ask(&mut board, "rows"), ["rows 4"]);
    }
    let results = numbered.results;
    println!("{results} results came, {without_stop_bit} bytes had no stop bit");
    assert!(results > 30, "{results}");
    assert!(without_stop_bit > 30, "{without_stop_bit}");
    assert_eq!(numbered.ask(&mut board, "stream off"), ["stream off"]);
    let status = Status::ask(&mut board);
    // An error is not counted if its byte comes within some ten cycles of the begin of an interrupt, before
    // the driver clears the flags. An interrupt comes every 87 us, 14,600 cycles: 0.3 of 386 bytes on the
    // average.
    let missed = (without_stop_bit as u64).checked_sub(status.count("serial framing"));
    assert!(missed.is_some_and(|missed| missed <= 3), "{missed:?}");
    status.assert_nothing_lost();
    status.assert_none(&["serial noise"]);
}

/// Nobody takes the bytes that come: neither DMA nor the interrupt.
#[test]
fn an_overrun_is_counted_and_the_next_command_is_answered() {
    let mut board = measuring(4);
    let mut numbered = Numbered::start(&mut board);
    // The line is silent for a while after a result, so no interrupt for a byte to send comes.
    await_line(&mut board, |line| line.starts_with("# "));
    change_serial_port(&mut board, Usart::Cr1, |it| it & !cr1::IDLEIE.mask());
    change_serial_port(&mut board, Usart::Cr3, |it| it & !cr3::DMAR.mask());
    board.send("rows 9");
    run_ms(&mut board, 2);
    change_serial_port(&mut board, Usart::Cr3, |it| it | cr3::DMAR.mask());
    change_serial_port(&mut board, Usart::Cr1, |it| it | cr1::IDLEIE.mask());
    let answer = numbered.ask(&mut board, "");
    println!("{answer:?}");
    // The first byte was there, and the others were lost.
    assert_eq!(answer, ["E1 unknown command, try help"]);
    assert_eq!(numbered.ask(&mut board, "rows"), ["rows 4"]);
    assert_eq!(numbered.ask(&mut board, "stream off"), ["stream off"]);
    let status = Status::ask(&mut board);
    assert_eq!(status.count("serial overrun"), 1);
    status.assert_none(&["rows lost", "lines dropped"]);
    status.assert_none(&["serial noise", "serial framing"]);
}

/// During a save nobody takes bytes. If the buffer overflows, the line under way is refused, and nothing that
/// is left of a command becomes another one.
#[test]
fn lines_that_find_the_buffer_full_are_refused_and_counted() {
    let mut board = measuring(4);
    let mut numbered = Numbered::start(&mut board);
    assert_eq!(numbered.ask(&mut board, "stream off"), ["stream off"]);
    board.send("save\r");
    board.send(&"average moving 9\r".repeat(400));
    run_ms(&mut board, 3_000);
    let mut answers = take_texts(&mut board);
    answers.retain(|it| !it.starts_with("save"));
    let refused = "E7 characters were lost, so this line was not taken: send it again";
    println!("{} answers", answers.len());
    let refusals = answers.iter().filter(|it| *it == refused).count();
    let taken = answers
        .iter()
        .filter(|it| *it == "average moving 9")
        .count();
    assert!((1..5).contains(&refusals), "{refusals}");
    assert!(taken > 10, "{taken}");
    assert_eq!(refusals + taken, answers.len(), "{answers:?}");
    assert_eq!(
        Status::ask(&mut board).count("serial overrun"),
        refusals as u64
    );
}

/// At the highest rate a byte takes 10.9 us, and the pulses of a row last about as long. Commands come
/// without a pause, while results go out.
#[test]
fn commands_at_921600_baud_arrive_whole_on_slow_cores_too() {
    let commands: Vec<String> = (2..=64).map(|it| format!("average moving {it}")).collect();
    for millions in [168, 84, 56] {
        let conditions = conditions(|it| it.instructions_per_second = millions * 1_000_000);
        let mut board = CleanBoard::power_on(spot_at(CENTRE, 1500.0), conditions);
        await_banner(&mut board);
        set(&mut board, "rows 1");
        set(&mut board, "baud 921600");
        board.take_lines();
        for _ in 0..5 {
            say(&mut board, &commands.join("\r\n"), 150);
            let mut answers = take_texts(&mut board);
            answers.retain(|line| !is_result(line));
            assert_eq!(
                answers, commands,
                "at {millions} million instructions a second"
            );
        }
        set(&mut board, "average none");
        set(&mut board, "stream off");
        let status = Status::ask(&mut board);
        status.assert_none(&[
            "serial noise",
            "serial framing",
            "serial overrun",
            "rows late",
            "rows lost",
        ]);
    }
}
