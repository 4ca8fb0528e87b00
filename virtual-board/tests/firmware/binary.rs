//! Tests of `format binary`: packets from the firmware as it is flashed.

use slitrange::row::sensor_heads::tcd1304dg;
use slitrange_device::protocol::packet::{
    Decoder, FrameResult, Message, PacketError, RowHead, unpack,
};
use slitrange_device::settings::serial_line::Baud;

use super::common::*;

#[derive(Debug, Default)]
pub struct Reader {
    decoder: Decoder,
    /// When the packet under way began.
    began: Option<Nanos>,
}

/// What the firmware sent, as packets.
#[derive(Debug, Default)]
pub struct Received {
    pub sequence: Vec<u16>,
    /// The results, each with the end of the first byte of its packet.
    pub results: Vec<(Nanos, FrameResult)>,
    /// The windows: the counter of the result, and the counts.
    pub windows: Vec<(u32, Vec<u16>)>,
    pub rows: Vec<(RowHead, Vec<u16>)>,
    pub text: String,
    pub errors: Vec<PacketError>,
}

impl Reader {
    /// Sends `format binary`, and reads from its answer on, which is a packet.
    pub fn start(board: &mut VirtualBoard) -> Self {
        board.take_bytes();
        say(board, "format binary", 100);
        let mut reader = Self::default();
        assert_eq!(reader.read(board).text, "format binary\r\n");
        reader
    }

    pub fn read(&mut self, board: &mut VirtualBoard) -> Received {
        let mut received = Received::default();
        for (at, byte) in board.take_bytes() {
            let start = *self.began.get_or_insert(at);
            let Some(packet) = self.decoder.take(byte) else {
                continue;
            };
            self.began = None;
            match packet {
                Ok(packet) => {
                    received.sequence.push(packet.sequence);
                    received.take(start, packet.message);
                }
                Err(error) => received.errors.push(error),
            }
        }
        received
    }
}

impl Received {
    fn take(&mut self, start: Nanos, message: Message<'_>) {
        match message {
            Message::Result(result) => self.results.push((start, result)),
            Message::Text(text) => self.text += &String::from_utf8_lossy(text),
            Message::Window {
                counter, counts, ..
            } => self.windows.push((counter, unpack(counts).collect())),
            Message::Row(head) => self.rows.push((head, vec![])),
            Message::Words {
                number,
                first,
                words,
            } => {
                // The head of the first row may have come before the last call.
                if let Some((head, before)) = self.rows.last_mut() {
                    assert_eq!((number, usize::from(first)), (head.number, before.len()));
                    before.extend(unpack(words));
                }
            }
        }
    }

    /// Asserts that no packet is missing or out of order, and that none was damaged.
    pub fn assert_whole(&self) {
        assert_eq!(self.errors, []);
        let mut pairs = self.sequence.windows(2);
        let in_order = pairs.all(|two| two[1] == two[0].wrapping_add(1));
        assert!(in_order, "{:?}", self.sequence);
    }
}

#[test]
fn results_and_answers_come_as_packets_until_text_is_asked_for() {
    let mut board = measuring(2);
    set(&mut board, "stream on");
    let mut reader = Reader::start(&mut board);
    run_ms(&mut board, 1_000);
    say(&mut board, "rows", 50);
    let received = reader.read(&mut board);
    received.assert_whole();
    assert_eq!(received.text, "rows 2\r\n");
    // A frame takes 11.4 ms.
    assert!(received.results.len() >= 87, "{}", received.results.len());
    for ((_, before), (at, result)) in received.results.iter().zip(&received.results[1..]) {
        assert_eq!(result.counter, before.counter + 1);
        let period = result.time_us - before.time_us;
        assert!(period.abs_diff(11_400) <= 20, "{period}");
        assert!(result.result.is_ok_and(|reading| reading.rows_used == 2));
        assert!(at / 1000 > result.time_us);
    }
    tell(&mut board, "format text");
    Status::ask(&mut board).assert_nothing_lost();
}

/// The shortest time from one byte to the next, in bits at a rate.
fn bits_a_byte(bytes: &[(Nanos, u8)], baud: Baud) -> f64 {
    let times = bytes.windows(2).map(|two| two[1].0 - two[0].0);
    let shortest = times.min().expect("bytes") as f64 * 1e-9;
    shortest * f64::from(baud.bits_a_second())
}

/// USART3's clock of 42 MHz is not a multiple of the rates: the nearest divisor of 921600 baud is 0.93 % off,
/// and the others are nearer. A receiver takes 3 % and more.
#[test]
fn the_answer_to_baud_is_at_the_old_rate_and_all_later_bytes_are_at_the_new_one() {
    let mut board = measuring(4);
    // At 9600 baud, readings that wait for the end of `info` would be dropped.
    set(&mut board, "stream off");
    let mut before = Baud::default();
    for baud in Baud::ALL.into_iter().rev() {
        board.take_bytes();
        set(&mut board, &format!("baud {}", baud.bits_a_second()));
        let bits = bits_a_byte(&board.take_bytes(), before);
        assert!((bits - 10.0).abs() < 0.1, "to {baud:?}: {bits} bits");
        // The answer has less than 2,000 bytes.
        let ms = 20_000_000 / baud.bits_a_second();
        say(&mut board, "info", ms.into());
        let bits = bits_a_byte(&board.take_bytes(), baud);
        println!("{baud:?}: {bits:.3} bits a byte");
        assert!((bits - 10.0).abs() < 0.1, "{baud:?}: {bits} bits");
        before = baud;
        run_ms(&mut board, 50);
        board.take_lines();
    }
    Status::ask(&mut board).assert_none(&["lines dropped", "serial framing", "serial overrun"]);
}

#[test]
fn whole_rows_arrive_with_the_results_that_a_pc_finds_in_them() {
    let mut board = measuring(16);
    set(&mut board, "baud 921600");
    let mut reader = Reader::start(&mut board);
    say(&mut board, "pixels rows", 50);
    reader.read(&mut board);
    run_ms(&mut board, 1_000);
    // A command that waits for a frame interrupts the rows.
    board.send("distance\r\n");
    run_ms(&mut board, 1_000);
    let received = reader.read(&mut board);
    received.assert_whole();
    let readings = received.text.lines().filter(|line| is_reading(line));
    assert_eq!(readings.count(), 1);
    assert!(number(&received.text, " n ", "/16") == 16.0);
    assert_eq!(received.results, []);
    let mut measurement = Measurement::new(tcd1304dg(), Options::default());
    // The last row is not whole.
    let whole = &received.rows[..received.rows.len() - 1];
    for (head, words) in whole {
        assert_eq!(usize::from(head.words), words.len());
        let measured = measurement.measure_alone(&mut words.clone(), head.exposure, None);
        assert_eq!(head.result, Ok(measured.expect("a centre")));
    }
    for two in whole.windows(2) {
        assert_eq!(two[1].0.number, two[0].0.number + two[1].0.skipped + 1);
    }
    let per_second = whole.len() as f64 / 1.9;
    println!("{} rows in 2 s, {per_second:.1} a second", whole.len());
    // 6.1 KB a row, 92 KB a second, less the frame for `distance`.
    assert!(whole.len() >= 24, "{}", whole.len());
}
