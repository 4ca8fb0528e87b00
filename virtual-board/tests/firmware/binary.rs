//! Tests of `format binary`: packets from the firmware as it is flashed.

use std::time::Duration;

use slitrange::protocol::packet::{Decoder, FrameResult, Message, PacketError};
use virtual_board::{Nanos, VirtualBoard};

use crate::common::{PATIENCE, Status, measuring, set};

/// A reader of the firmware's bytes.
#[derive(Debug, Default)]
struct Reader {
    decoder: Decoder,
    /// When the packet under way began.
    began: Option<Nanos>,
}

/// What the firmware sent, as packets.
#[derive(Debug, Default)]
struct Received {
    /// The sequence numbers.
    sequence: Vec<u16>,
    /// The results, each with the end of the first byte of its packet.
    results: Vec<(Nanos, FrameResult)>,
    text: String,
    errors: Vec<PacketError>,
}

impl Reader {
    /// Sends `format binary`, and reads from its answer on, which is a packet.
    fn start(board: &mut VirtualBoard) -> Self {
        board.take_bytes();
        board.send("format binary\r\n");
        board.run_for(Duration::from_millis(100)).expect("a run");
        let mut reader = Self::default();
        assert_eq!(reader.read(board).text, "format binary\r\n");
        reader
    }

    /// Reads all bytes since the last call.
    fn read(&mut self, board: &mut VirtualBoard) -> Received {
        let mut received = Received::default();
        for (at, byte) in board.take_bytes() {
            let start = *self.began.get_or_insert(at);
            match self.decoder.take(byte) {
                Some(Ok(packet)) => {
                    received.sequence.push(packet.sequence);
                    match packet.message {
                        Message::Result(result) => received.results.push((start, result)),
                        Message::Text(text) => received.text += &String::from_utf8_lossy(text),
                    }
                    self.began = None;
                }
                Some(Err(error)) => {
                    received.errors.push(error);
                    self.began = None;
                }
                None => {}
            }
        }
        received
    }
}

impl Received {
    /// Asserts that no packet is missing or out of order, and that none was damaged.
    fn assert_whole(&self) {
        assert_eq!(self.errors, []);
        let in_order = self
            .sequence
            .windows(2)
            .all(|two| two[1] == two[0].wrapping_add(1));
        assert!(in_order, "{:?}", self.sequence);
    }
}

#[test]
fn results_and_answers_come_as_packets_until_text_is_asked_for() {
    let mut board = measuring(2);
    set(&mut board, "stream on");
    let mut reader = Reader::start(&mut board);
    board.run_for(Duration::from_secs(1)).expect("a run");
    board.send("rows\r\n");
    board.run_for(Duration::from_millis(50)).expect("a run");
    let received = reader.read(&mut board);
    received.assert_whole();
    assert_eq!(received.text, "rows 2\r\n");
    // A frame takes 11.4 ms.
    assert!(received.results.len() >= 87, "{}", received.results.len());
    for two in received.results.windows(2) {
        let [(_, before), (at, result)] = two else {
            unreachable!("windows of two")
        };
        assert_eq!(result.counter, before.counter + 1);
        assert_eq!(result.time_us - before.time_us, 11_400);
        assert!(result.result.is_ok_and(|reading| reading.rows_used == 2));
        assert!(u64::from(*at) / 1000 > result.time_us);
    }
    board.send("format text\r\n");
    board
        .run_until_line(|line| line == "format text", PATIENCE)
        .expect("an answer");
    Status::ask(&mut board).assert_none(&["lines dropped", "rows lost"]);
    board.finish().expect("a clean run");
}
