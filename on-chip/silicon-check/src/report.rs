//! The lines of the results.

use core::fmt::Write as _;

use heapless::String;

use crate::board::Transmitter;

pub type Text = String<256>;

/// Makes a line's text, as `format!`. What does not fit is cut off.
macro_rules! text {
    ($($arguments:tt)*) => {{
        let mut text = $crate::report::Text::new();
        let _ = core::fmt::Write::write_fmt(&mut text, format_args!($($arguments)*));
        text
    }};
}
pub(crate) use text;

/// The serial port, and how the checks ended.
pub struct Report {
    pub serial: Transmitter,
    pub passed: u32,
    pub failed: u32,
    pub skipped: u32,
}

impl Report {
    pub fn new(serial: Transmitter) -> Self {
        Self {
            serial,
            passed: 0,
            failed: 0,
            skipped: 0,
        }
    }

    pub async fn line(&mut self, line: &str) {
        self.serial.send(line.as_bytes()).await;
        self.serial.send(b"\r\n").await;
    }

    pub async fn flush(&mut self) {
        self.serial.drain().await;
    }

    /// Reports a check: what was found, and where to look if it is wrong.
    pub async fn check(&mut self, name: &str, passes: bool, found: &str, look_at: &str) {
        let mut line = Text::new();
        if passes {
            self.passed += 1;
            let _ = write!(line, "pass {name}: {found}");
        } else {
            self.failed += 1;
            let _ = write!(line, "FAIL {name}: {found}; {look_at}");
        }
        self.line(&line).await;
    }

    /// Reports a check that needs another one to pass.
    pub async fn skip(&mut self, name: &str, needed: &str) {
        self.skipped += 1;
        self.line(&text!("skip {name}: it needs `{needed}` to pass"))
            .await;
    }

    pub async fn end(&mut self) {
        let (passed, failed, skipped) = (self.passed, self.failed, self.skipped);
        let line = text!("silicon-check: {passed} pass, {failed} fail, {skipped} skipped");
        self.line(&line).await;
    }
}
