//! The far end of the serial line: the bytes from the firmware and to the firmware, with their times.

use std::collections::VecDeque;
use std::fmt;
use std::sync::{Arc, Mutex};

use rigless::chip::{Timeline, spi, uart};
use rigless::snapshot::store;
use rigless::time::VirtualNanos;

use crate::base::{Nanos, lock};

/// USART3, the ST-LINK's serial port, in rigless's order.
pub(crate) const SERIAL_PORT: usize = 2;

/// A line that the firmware sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// When the stop bit of its line feed ended.
    pub at: Nanos,
    /// The line without its end. Invalid UTF-8 is replaced.
    pub text: String,
}

impl fmt::Display for Line {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{:.6} s {}", self.at as f64 / 1e9, self.text)
    }
}

/// A byte as the firmware's receiver takes it. A break is the byte 0 without a stop bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// The byte.
    pub byte: u8,
    /// Without a stop bit, the receiver reports a framing error.
    pub has_stop_bit: bool,
}

/// The far end of the line.
#[derive(Debug, Default)]
pub struct SerialLine {
    /// The bytes that nobody has taken yet, each with the end of its stop bit.
    pub bytes: Vec<(Nanos, u8)>,
    lines: Vec<Line>,
    /// The number of `lines` that a wait has already seen.
    waited_for: usize,
    unfinished: Vec<u8>,
    due: VecDeque<(Nanos, u8)>,
    /// The port hears what it sends itself (half-duplex), but for so many bytes of a thousand. It sends at
    /// another rate than the far end's.
    pub(crate) echo: Option<u8>,
    echoed: u32,
    /// The edges of the pin that enables the line's driver: when, and whether it rose.
    pub driver: Vec<(Nanos, bool)>,
}

impl SerialLine {
    /// Sends `bytes` to the firmware from `at` on, at the line's rate, after all bytes that still wait.
    pub fn say(&mut self, at: Nanos, bytes: &[u8]) {
        let at = self.due.back().map_or(at, |&(last, _)| at.max(last));
        self.due.extend(bytes.iter().map(|&byte| (at, byte)));
    }

    /// When the next byte for the firmware is due.
    pub fn next_due(&self) -> Option<Nanos> {
        self.due.front().map(|&(at, _)| at)
    }

    /// A byte from the firmware, whose stop bit ended at `at`.
    pub fn hear(&mut self, at: Nanos, byte: u8) {
        if let Some(unheard) = self.echo {
            self.echoed += 1;
            if self.echoed % 1000 >= u32::from(unheard) {
                self.due.push_back((at, byte));
            }
            return;
        }
        self.bytes.push((at, byte));
        if byte == b'\n' {
            let line = &self.unfinished;
            let line = line.strip_suffix(b"\r").unwrap_or(line);
            let text = String::from_utf8_lossy(line).into_owned();
            self.lines.push(Line { at, text });
            self.unfinished.clear();
        } else {
            self.unfinished.push(byte);
        }
    }

    fn next(&mut self, now: Nanos) -> Option<u8> {
        let (_, byte) = self.due.pop_front_if(|&mut (at, _)| at <= now)?;
        Some(byte)
    }

    /// Takes the lines since the last call.
    pub fn take_lines(&mut self) -> Vec<Line> {
        self.waited_for = 0;
        std::mem::take(&mut self.lines)
    }

    /// The first line that `wanted` accepts and that no wait has seen. Each line is seen once. `take_lines`
    /// still gives all lines.
    pub fn find(&mut self, mut wanted: impl FnMut(&str) -> bool) -> Option<Line> {
        while let Some(line) = self.lines.get(self.waited_for) {
            self.waited_for += 1;
            if wanted(&line.text) {
                return Some(line.clone());
            }
        }
        None
    }

    /// The last lines and the unfinished line, for an error message.
    pub fn tail(&self) -> String {
        let mut tail = String::new();
        for line in self.lines.iter().rev().take(5).rev() {
            tail += &format!("\n  {line}");
        }
        if !self.unfinished.is_empty() {
            let unfinished = String::from_utf8_lossy(&self.unfinished);
            tail += &format!("\n  (unfinished) {unfinished}");
        }
        match tail.as_str() {
            "" => "nothing".to_owned(),
            _ => tail,
        }
    }
}

/// The far end as a chip on the processor's serial port.
#[derive(Debug)]
pub(crate) struct FarEnd {
    pub(crate) line: Arc<Mutex<SerialLine>>,
}
store! { FarEnd { values: [], parts: [], built: [line] } }

impl uart::Peer for FarEnd {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        let [byte, _] = word.to_le_bytes();
        lock(&self.line).hear(context.now().0, byte);
    }

    fn transmit(&mut self, now: VirtualNanos) -> Option<u16> {
        lock(&self.line).next(now.0).map(u16::from)
    }
}

/// The pin that enables the line's driver, as a chip with a chip select (see the module `pins`).
#[derive(Debug)]
pub(crate) struct DriverEnable {
    pub(crate) line: Arc<Mutex<SerialLine>>,
}
store! { DriverEnable { values: [], parts: [], built: [line] } }

impl spi::Peer for DriverEnable {
    fn transfer(&mut self, _mosi: u32, _bits: u8, _context: &mut Timeline<'_, '_>) -> u32 {
        0
    }

    fn select(&mut self, context: &mut Timeline<'_, '_>) {
        lock(&self.line).driver.push((context.now().0, true));
    }

    fn deselect(&mut self, context: &mut Timeline<'_, '_>) {
        lock(&self.line).driver.push((context.now().0, false));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_at_the_line_feed_and_keep_its_instant() {
        let mut line = SerialLine::default();
        for (at, &byte) in (1..).zip(b"one\r\ntwo\nthr") {
            line.hear(at, byte);
        }
        let (at, text) = (9, "two".to_owned());
        assert_eq!(line.find(|text| text == "two"), Some(Line { at, text }));
        assert_eq!(line.find(|_| true), None, "each line is waited for once");
        assert_eq!(line.take_lines().len(), 2, "waiting takes nothing away");
        assert_eq!(line.bytes.len(), 12);
        assert!(line.tail().contains("thr"));
    }

    #[test]
    fn bytes_are_sent_in_order_and_not_before_they_are_due() {
        let mut line = SerialLine::default();
        line.say(10, b"a");
        line.say(5, b"b");
        assert_eq!((line.next_due(), line.next(9)), (Some(10), None));
        let bytes = [(); 3].map(|()| line.next(10));
        assert_eq!(bytes, [Some(b'a'), Some(b'b'), None]);
    }
}
