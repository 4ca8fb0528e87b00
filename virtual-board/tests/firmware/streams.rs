//! Tests of streams at the highest rates: nothing is lost or out of order, and the counters agree at both
//! ends.

use super::binary::Reader;
use super::common::*;

/// The length of the long runs in seconds of virtual time. `SLITRANGE_SECONDS` sets another one.
const AN_HOUR: u64 = 3600;

/// The virtual time between two looks at what came. The sensor head remembers 64 rows, which are 365 ms.
const LOOK: Duration = Duration::from_millis(250);

/// The time from row to row.
const ROW: Duration = Duration::from_micros(5700);

/// How far a time between two results may be off, in microseconds: an interrupt may come before the firmware
/// notes the time.
const LATE_US: u64 = 20;

fn long_run() -> Duration {
    let seconds = match std::env::var("SLITRANGE_SECONDS") {
        Ok(seconds) => seconds.parse().expect("SLITRANGE_SECONDS is a number"),
        Err(_) => AN_HOUR,
    };
    Duration::from_secs(seconds)
}

/// Lets the board run, looks at what came meanwhile, and prints how far the run is.
fn run(
    board: &mut VirtualBoard,
    time: Duration,
    name: &str,
    mut look: impl FnMut(&mut VirtualBoard) -> u64,
) {
    let looks = time.as_millis() / LOOK.as_millis();
    let of_minute = 60_000 / LOOK.as_millis();
    for done in 1..=looks {
        board.run_for(LOOK).expect("a run");
        let results = look(board);
        if done % of_minute == 0 {
            let seconds = done * LOOK.as_millis() / 1000;
            let of = time.as_secs();
            println!("{name}: {seconds} of {of} s, {results} results, none lost");
        }
    }
}

/// A result's number and its time in microseconds.
type Stamp = (u64, u64);

/// Asserts that results come one after the other, each as long after the one before as a frame takes.
fn assert_next(before: Option<Stamp>, now: Stamp, frame: Duration) {
    let Some(before) = before else {
        return;
    };
    assert_eq!(now.0, before.0 + 1, "{before:?} {now:?}");
    let period = now.1 - before.1;
    let off = period.abs_diff(frame.as_micros() as u64);
    assert!(off <= LATE_US, "{period} us: {before:?} {now:?}");
}

/// Asserts that the firmware lost nothing, and counted as much as came: all results up to `last`, whose line
/// or packet came at most `ago` before this call, and the rows that the sensor head sent.
fn assert_counters_agree(status: &Status, last: Stamp, ago: Duration, frame: Duration, rows: u64) {
    status.assert_nothing_lost();
    status.assert_none(&["serial noise", "serial framing"]);
    let later = status.count("readings") + status.faults() - last.0;
    let most = (ago.as_nanos() / frame.as_nanos()) as u64 + 2;
    assert!(later <= most, "{later} of {most}: {last:?} {status:#?}");
    // The command takes less than a row.
    let read = status.count("rows read");
    assert!((rows..=rows + 2).contains(&(read + 1)), "{read} {rows}");
}

/// Text at 115200 baud, two rows in a frame, each line with its number and its time.
fn assert_text_arrives(time: Duration) {
    const COLUMNS: &str = "output counter time distance u r centre height rows exposure flags";
    let frame = 2 * ROW;
    let mut board = measuring(2);
    tell(&mut board, COLUMNS);
    board.take_lines();
    let (mut last, mut lines) = (None, 0);
    let mut take = |line: &str| {
        let number = |before, after| number(line, before, after) as u64;
        let now = (number("# ", " @ "), number(" @ ", " d "));
        assert_next(last, now, frame);
        last = Some(now);
        lines += 1;
    };
    run(&mut board, time, "text", |board| {
        // They would pile up.
        board.take_bytes();
        let lines = board.take_lines();
        lines.iter().for_each(|line| take(&line.text));
        let number = |line: &Line| number(&line.text, "# ", " @ ") as u64;
        lines.last().map_or(0, number)
    });
    // The lines up to the answer.
    let asked = board.now();
    tell(&mut board, "stream off");
    let rest = board.take_lines();
    let rest = rest.iter().filter(|line| line.text.starts_with("# "));
    rest.for_each(|line| take(&line.text));
    let last = last.expect("lines");
    println!("text: {lines} lines, the last one is {last:?}");
    let fewest = (time.as_nanos() / frame.as_nanos()) as u64 - 2;
    assert!(lines >= fewest, "{lines} of {fewest}");
    let rows = board.statistics().rows;
    let ago = since(&board, asked);
    assert_counters_agree(&Status::ask(&mut board), last, ago, frame, rows);
}

fn since(board: &VirtualBoard, then: Nanos) -> Duration {
    // And the answer before.
    Duration::from_nanos(board.now() - then) + Duration::from_millis(50)
}

/// Binary at 921600 baud, one row in a frame: each row's result and window. Prints and limits the time from a
/// row's last word to the first byte of its result.
fn assert_windows_arrive(time: Duration) {
    // The limit holds for an instruction a cycle.
    let mut board = measuring_under(paper(), 1, full_speed());
    set(&mut board, "baud 921600");
    let mut reader = Reader::start(&mut board);
    say(&mut board, "pixels window", 50);
    reader.read(&mut board);
    let (mut last, mut last_window, mut last_packet) = (None, None, None::<u16>);
    let (mut count, mut pixels, mut slowest) = (0, 0, Duration::ZERO);
    let mut look = |board: &mut VirtualBoard| {
        let received = reader.read(board);
        // Some bytes of packets are those of line ends.
        board.take_lines();
        assert_eq!(received.errors, []);
        assert_eq!(received.text, "");
        for &sequence in &received.sequence {
            let is_next = last_packet.is_none_or(|before| before.wrapping_add(1) == sequence);
            assert!(is_next, "{last_packet:?} {sequence}");
            last_packet = Some(sequence);
        }
        let last_words =
            board.head(|head| head.rows().map(|row| row.last_word).collect::<Vec<_>>());
        for (at, result) in &received.results {
            let now = (result.counter.into(), result.time_us);
            assert_next(last, now, ROW);
            // A byte is over ten bits after it began.
            let began = at - 10 * 1_000_000_000 / 921_600;
            let last_word = last_words.iter().rfind(|&&last_word| last_word < began);
            let latency = began - last_word.expect("the result's row");
            slowest = slowest.max(Duration::from_nanos(latency));
            last = Some(now);
            count += 1;
        }
        for (counter, counts) in &received.windows {
            let is_next = last_window.is_none_or(|before| before + 1 == *counter);
            assert!(is_next, "{last_window:?} {counter}");
            last_window = Some(*counter);
            pixels += counts.len();
        }
        // The last result's window may not have come yet.
        let (result, window) = (last.expect("results").0, last_window.expect("windows"));
        assert!(result - u64::from(window) <= 1, "{result} {window}");
        result
    };
    run(&mut board, time, "binary", &mut look);
    println!(
        "binary: {count} results with {} pixels each; the slowest began {slowest:?} after its row's last \
         word",
        pixels / count
    );
    assert!(slowest <= Duration::from_millis(1), "{slowest:?}");
    let fewest = (time.as_nanos() / ROW.as_nanos()) as usize - 2;
    assert!(count >= fewest, "{count} of {fewest}");
    // The results up to the answer.
    let asked = board.now();
    say(&mut board, "stream off", 50);
    let received = reader.read(&mut board);
    assert_eq!(received.text, "stream off\r\n");
    received.assert_whole();
    let mut last = last.expect("results");
    for (_, result) in &received.results {
        let now = (result.counter.into(), result.time_us);
        assert_next(Some(last), now, ROW);
        last = now;
    }
    board.take_lines();
    let rows = board.statistics().rows;
    let ago = since(&board, asked);
    say(&mut board, "status", 50);
    let text = reader.read(&mut board).text;
    let status = Status(text.lines().map(str::to_owned).collect());
    assert_counters_agree(&status, last, ago, ROW, rows);
}

#[test]
fn readings_as_text_and_windows_in_binary_all_arrive() {
    assert_text_arrives(Duration::from_secs(2));
    assert_windows_arrive(Duration::from_secs(2));
}

#[test]
#[ignore = "40 s of virtual time take 20 s; .ci/run runs it"]
fn readings_as_text_and_windows_in_binary_all_arrive_for_20_s() {
    assert_text_arrives(Duration::from_secs(20));
    assert_windows_arrive(Duration::from_secs(20));
}

#[test]
#[ignore = "an hour of virtual time takes half an hour; .ci/run leaves it out"]
fn lines_of_text_all_arrive_for_an_hour() {
    assert_text_arrives(long_run());
}

#[test]
#[ignore = "an hour of virtual time takes half an hour; .ci/run leaves it out"]
fn windows_in_binary_all_arrive_for_an_hour() {
    assert_windows_arrive(long_run());
}
