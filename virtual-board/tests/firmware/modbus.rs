//! Tests of `format modbus`: requests and answers on the serial line. clients/python/tests/test_modbus.py
//! does the same with a stock master.

use rigless::soc::stm32f427::generated::usart6::{cr1, cr2};
use virtual_board::Nanos;

use super::common::*;

const NOTHING: [u8; 0] = [];

/// A request or an answer with its checksum.
fn frame(body: &[u8]) -> Vec<u8> {
    let sum = body.iter().fold(0xFFFF_u16, |sum, &byte| {
        (0..8).fold(sum ^ u16::from(byte), |sum, _| {
            (sum >> 1) ^ if sum & 1 == 1 { 0xA001 } else { 0 }
        })
    });
    [body, &sum.to_le_bytes()].concat()
}

/// Sends bytes. Gives the bytes that come within a time.
fn say(board: &mut VirtualBoard, bytes: &[u8], ms: u64) -> Vec<u8> {
    board.take_bytes();
    board.send_at(board.now(), bytes);
    run_ms(board, ms);
    let bytes = board.take_bytes().into_iter();
    bytes.map(|(_, byte)| byte).collect()
}

/// Asks with a request. Gives the answer, whose checksum is right, without the checksum.
fn request(board: &mut VirtualBoard, body: &[u8]) -> Vec<u8> {
    let answer = say(board, &frame(body), 30);
    let (body, _) = answer.split_last_chunk::<2>().expect("an answer");
    assert_eq!(frame(body), answer);
    body.to_vec()
}

#[test]
fn a_master_reads_results_and_writes_settings() {
    let (mut board, _) = boot(paper());
    let reading = fresh_results(&mut board, 1).remove(0);
    set(&mut board, "address 17");
    tell(&mut board, "@17 format modbus");
    // Nothing is sent unasked.
    assert_eq!(say(&mut board, b"", 300), NOTHING);
    let inputs = request(&mut board, &[17, 4, 0, 0, 0, 16]);
    println!("{reading}\n{inputs:?}");
    assert_eq!(inputs[..7], [17, 4, 32, 0, 0, 0, 0b0100]);
    let pair = |register: usize| {
        let at = 3 + 2 * register;
        i32::from_be_bytes(inputs[at..at + 4].try_into().expect("two registers"))
    };
    // Of another frame: noise of some um.
    assert!((f64::from(pair(4)) * 1e-4 - number(&reading, "d ", " mm")).abs() < 0.05);
    assert!((f64::from(pair(6)) * 1e-4 - number(&reading, " u ", " r ")).abs() < 0.02);
    let write = [17, 6, 0, 0, 0, 4];
    assert_eq!(request(&mut board, &write), write);
    let values = [17, 3, 12, 0, 4, 0, 0, 0x15, 0xE0, 0, 1, 0, 2, 0, 17];
    assert_eq!(request(&mut board, &[17, 3, 0, 0, 0, 6]), values);
    // Garbage changes nothing and has no answer, without a pause, with pauses, and with a request behind it.
    let mut state = 1u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let garbage: Vec<u8> = (0..4000).map(|_| random()).collect();
    assert_eq!(say(&mut board, &garbage, 400), NOTHING);
    for length in [1, 7, 8, 255, 256, 257, 600] {
        let garbage: Vec<u8> = (0..length).map(|_| random()).collect();
        assert_eq!(say(&mut board, &garbage, 60), NOTHING);
    }
    assert_eq!(say(&mut board, b"rows 7\r\n@17 rows 7\r\n", 30), NOTHING);
    assert_eq!(say(&mut board, &frame(&[18, 6, 0, 0, 0, 7]), 30), NOTHING);
    let two = [frame(&[17, 6, 0, 0, 0, 7]), frame(&[17, 6, 0, 0, 0, 8])].concat();
    // No silence between them: only the last one counts.
    assert_eq!(say(&mut board, &two, 30), frame(&[17, 6, 0, 0, 0, 8]));
    assert_eq!(request(&mut board, &[17, 3, 0, 0, 0, 1]), [17, 3, 2, 0, 8]);
    assert_eq!(request(&mut board, &[17, 4, 0, 24, 0, 1]), [17, 0x84, 2]);
    // For all stations.
    assert_eq!(say(&mut board, &frame(&[0, 6, 0, 0, 0, 5]), 30), NOTHING);
    assert_eq!(request(&mut board, &[17, 3, 0, 0, 0, 1]), [17, 3, 2, 0, 5]);
    // Saved: the sensor starts with Modbus.
    let save = [17, 6, 0, 6, 0, 1];
    assert_eq!(request(&mut board, &save), save);
    run_ms(&mut board, 500);
    board.reset_pin().expect("the emulator");
    assert_eq!(say(&mut board, b"", 300), NOTHING, "no banner");
    assert_eq!(request(&mut board, &[17, 3, 0, 0, 0, 1]), [17, 3, 2, 0, 5]);
    let edges = board.take_driver_edges();
    assert!(edges.len().is_multiple_of(2), "the line is released");
    // The way back.
    let alone_in_text = [17, 16, 0, 4, 0, 2, 4, 0, 0, 0, 0];
    let answer = say(&mut board, &frame(&alone_in_text), 30);
    // Lines may follow at once.
    assert_eq!(answer[..8], frame(&alone_in_text[..6]));
    assert_readings(&fresh_results(&mut board, 2));
    assert_eq!(ask(&mut board, "rows"), "rows 5");
}

/// Asserts that USART3 has nine bits with even parity, or eight, and its stop bits (RM0090 section 30.6).
fn assert_characters(board: &mut VirtualBoard, bits: &str) {
    let [one, two] = with_processor(board, |it| {
        let (_, registers) = it.part.serial_port(2);
        [Usart::Cr1, Usart::Cr2].map(|register| registers.get(register))
    });
    let [nine, parity, odd] = [cr1::M, cr1::PCE, cr1::PS].map(|field| field.is_set(one));
    let expected = (bits == "8e1", bits == "8e1", false);
    assert_eq!((nine, parity, odd), expected, "{bits}");
    let stop = cr2::STOP.get(two);
    assert_eq!(stop, if bits == "8n2" { 0b10 } else { 0 }, "{bits}");
}

/// As PLCs speak it, after a reset: rate, characters and format are saved. A pause within a request ends it
/// if it is longer than 3.5 characters of 11 bits: 4.01 ms at 9600 baud, 2.01 ms at 19200.
#[test]
fn rates_and_characters_of_plcs_are_saved_and_time_the_requests() {
    let (mut board, _) = boot(paper());
    let mut before = "bits 8n1";
    for (baud, bits) in [(9600, "8e1"), (19_200, "8n2")] {
        set(&mut board, "plain on");
        set(&mut board, &format!("bits {bits}"));
        set(&mut board, &format!("baud {baud}"));
        set(&mut board, "format modbus");
        set(&mut board, "plain off");
        say(&mut board, &frame(&[1, 6, 0, 6, 0, 1]), 600);
        board.reset_pin().expect("the emulator");
        assert_eq!(say(&mut board, b"", 300), NOTHING, "after {before}");
        assert_characters(&mut board, bits);
        let character = 11.0 / f64::from(baud);
        let asked = frame(&[1, 3, 0, 4, 0, 1]);
        for (pause, is_one) in [(0.0, true), (2.7, true), (5.5, false)] {
            board.take_bytes();
            let start = board.now();
            board.send_at(start, &asked[..3]);
            let pause = (pause * character * 1e9) as Nanos;
            let rest = start + (3.0 * character * 1e9) as Nanos + pause;
            board.send_at(rest, &asked[3..]);
            run_ms(&mut board, 60);
            let answer = board.take_bytes();
            let bytes: Vec<u8> = answer.iter().map(|&(_, byte)| byte).collect();
            let expected = is_one.then(|| frame(&[1, 3, 2, 0, 2]));
            let expected = expected.unwrap_or_default();
            assert_eq!(bytes, expected, "{baud} {bits}, a pause of {pause} ns");
            let Some(&[(first, _), (second, _)]) = answer.first_chunk() else {
                continue;
            };
            let length = (second - first) as f64 * 1e-9 / character;
            // Behind five more characters, a silence of 3.5, and the first one of the answer.
            let silence = (first - rest) as f64 * 1e-9 / character - 5.0 - 1.0;
            println!("{baud} {bits}: a character of {length:.3}, answered after {silence:.2}");
            assert!((length - 1.0).abs() < 0.01, "{length}");
            // The receiver notices a silence after a character. A row may be computed meanwhile.
            let due = 3.5..5.5 + 0.02 / character;
            assert!(due.contains(&silence), "{silence}");
        }
        // The way back, whatever is saved: the button, held while the board starts.
        board.reset_pin().expect("the emulator");
        board.hold_button(true).expect("the emulator");
        // Behind the bytes of an answer, which is no line.
        await_line(&mut board, |line| line.ends_with("plain on"));
        board.hold_button(false).expect("the emulator");
        assert_characters(&mut board, "8n1");
        assert_readings(&fresh_results(&mut board, 1));
        assert_eq!(ask(&mut board, "format"), "format modbus");
        assert_eq!(ask(&mut board, "baud"), format!("baud {baud}"));
        before = bits;
    }
}

/// Two boards on one line, as stations 1 and 2. The line carries each byte to all others.
struct Bus([CleanBoard; 2]);

impl Bus {
    /// How far apart the boards' times are at most.
    const STEP: Duration = Duration::from_micros(50);

    fn new() -> Self {
        Self([1, 2].map(|station| {
            let (mut board, _) = boot(paper());
            set(&mut board, &format!("address {station}"));
            tell(&mut board, &format!("@{station} format modbus"));
            run_ms(&mut board, 5);
            board.take_bytes();
            board
        }))
    }

    /// Lets a master ask, and waits for an answer of `length` bytes, up to 100 ms. Gives the answer. The line
    /// is silent for `silence` before the request and behind the answer.
    fn ask(&mut self, request: &[u8], length: usize, silence: Duration) -> Vec<u8> {
        for board in &mut self.0 {
            board.run_for(silence).expect("a run");
            let now = board.now();
            board.send_at(now, request);
        }
        let (mut answer, start) = (vec![], self.0[0].now());
        while answer.len() < length && self.0[0].now() < start + 100_000_000 {
            for speaker in 0..2 {
                self.0[speaker].run_for(Self::STEP).expect("a run");
                let bytes: Vec<u8> = self.0[speaker].take_bytes().iter().map(|it| it.1).collect();
                let other = &mut self.0[1 - speaker];
                let now = other.now();
                other.send_at(now, &bytes);
                answer.extend(bytes);
            }
        }
        answer
    }
}

/// Asks two stations in turn. Each request must have its answer.
fn all_requests_are_answered(requests: usize) {
    // The silence that the standard wants above 19,200 baud, and 3.5 characters of 11 bits.
    for silence in [Duration::from_micros(1750), Duration::from_nanos(334_000)] {
        let mut bus = Bus::new();
        let mut unanswered = 0;
        for number in 0..requests {
            let station = [1, 2][number % 2];
            let answer = bus.ask(&frame(&[station, 4, 0, 0, 0, 16]), 37, silence);
            let parts = answer.split_last_chunk::<2>();
            let is_whole = parts.is_some_and(|(body, _)| frame(body) == answer);
            unanswered += usize::from(!(is_whole && answer[..3] == [station, 4, 32]));
        }
        println!("{silence:?}: {unanswered} of {requests} unanswered");
        assert_eq!(unanswered, 0, "of {requests}");
    }
}

#[test]
fn two_stations_on_one_line_answer_all_requests() {
    all_requests_are_answered(60);
}

#[test]
#[ignore = "takes minutes; .ci/run leaves it out"]
fn two_stations_on_one_line_answer_ten_thousand_requests() {
    all_requests_are_answered(5_000);
}
