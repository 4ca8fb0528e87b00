//! The serial line: readings go out as they come, commands come in and are answered.
//!
//! # Note
//!
//! embassy-stm32 0.6.0's buffered transmitter wants care:
//! * `write` takes all of the bytes or none, and fails if there are more than its buffer holds.
//! * `write` without room registers no waker: awaited, it would sleep for ever. It is polled here.
//! * `write` starts the interrupt only if the buffer was empty when it looked. If the last bytes leave between that
//!   look and the new bytes' arrival, nobody starts it: it is started here after every write.

use core::fmt::{Arguments, Display, Write as _};

use embassy_futures::poll_once;
use embassy_futures::select::{Either, select};
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::usart::{BufferedUart, BufferedUartTx};
use embassy_time::{Instant, Timer};
use embedded_io_async::{Read as _, Write as _};
use heapless::String;
use slitrange::calibration::Calibration;
use slitrange::measurement::Settings;
use slitrange::protocol::MAX_ANSWER;
use slitrange::protocol::answer::HELP;
use slitrange::protocol::command::Command;
use slitrange::protocol::info::{Banner, Hardware, Info};
use slitrange::protocol::input::Input;
use slitrange::protocol::ladder::Ladder;
use slitrange::protocol::status::{SerialErrors, StartCause, Status};
use slitrange::reading::{Fault, Measured};

use super::shared::{COUNTERS, RESULTS, SETTINGS};
use super::{acquisition, board, tcd1304};

/// Bytes handed to the transmitter at a time: a small part of its buffer, so that it does not run dry meanwhile.
const PIECE: usize = 64;

const HARDWARE: Hardware = Hardware {
    board: board::NAME,
    head: tcd1304::NAME,
    row_us: acquisition::ROW_PERIOD.as_micros() as u32,
};

/// Serves the line for ever.
///
/// Results are looked at before bytes: they come 175 times a second at most, so bytes get their turn, while bytes
/// could come without an end.
#[embassy_executor::task]
pub async fn serve(uart: BufferedUart<'static>, started_by: StartCause, settings: Settings) {
    let (tx, mut rx) = uart.split();
    let mut session = Session {
        tx: Transmitter(tx),
        started_by,
        started_at: Instant::now(),
        settings,
        calibration: Calibration::nominal(),
        stream: true,
        distance_wanted: false,
        readings: 0,
        faults: [0; Fault::KINDS],
    };
    session
        .tx
        .send(format_args!("{}", Banner(&HARDWARE, started_by)))
        .await;
    let mut input = Input::new();
    let mut bytes = [0; PIECE];
    loop {
        match select(RESULTS.receive(), rx.read(&mut bytes)).await {
            Either::First(result) => session.report(result).await,
            Either::Second(received) => {
                // Never an error in this driver, which counts and drops them; if it were, there are no bytes.
                let received = received.unwrap_or(0);
                for command in bytes[..received]
                    .iter()
                    .filter_map(|&byte| input.take(byte))
                {
                    match command {
                        Ok(command) => session.answer(command).await,
                        Err(error) => session.tx.send(format_args!("{error}")).await,
                    }
                }
            }
        }
    }
}

/// What the one at the other end has set, and what was reported.
struct Session {
    tx: Transmitter,
    started_by: StartCause,
    started_at: Instant,
    settings: Settings,
    /// What centres mean, where the sensor is calibrated.
    calibration: Option<Calibration>,
    stream: bool,
    distance_wanted: bool,
    readings: u32,
    faults: [u32; Fault::KINDS],
}

impl Session {
    /// Counts a result, and says it where it is wanted.
    async fn report(&mut self, result: Result<Measured, Fault>) {
        let result = result.and_then(|measured| measured.reading(self.calibration.as_ref()));
        COUNTERS.results.add();
        match &result {
            Ok(_) => self.readings = self.readings.wrapping_add(1),
            Err(fault) => {
                let count = &mut self.faults[fault.kind()];
                *count = count.wrapping_add(1);
            }
        }
        if self.distance_wanted {
            self.distance_wanted = false;
            match result {
                Ok(reading) => self.tx.send(format_args!("{reading}")).await,
                Err(fault) => {
                    self.tx
                        .send(format_args!("{fault}\r\n({})", fault.advice()))
                        .await
                }
            }
        } else if self.stream {
            match result {
                Ok(reading) => self.tx.offer(&reading),
                Err(fault) => self.tx.offer(&fault),
            }
        }
    }

    /// Does what was asked for and answers.
    async fn answer(&mut self, command: Command) {
        match command {
            Command::Nothing => {}
            Command::Help => self.tx.send(format_args!("{HELP}")).await,
            Command::HelpEstimator => self.tx.send(format_args!("{Ladder}")).await,
            Command::Info => {
                let geometry = tcd1304::geometry();
                let info = Info {
                    hardware: &HARDWARE,
                    geometry: &geometry,
                    settings: &self.settings,
                    calibration: self.calibration.as_ref(),
                };
                self.tx.send(format_args!("{info}")).await;
            }
            Command::Status => self.tx.send(format_args!("{}", self.status())).await,
            // The reading is the answer.
            Command::Distance => self.distance_wanted = true,
            Command::Stream(on) => {
                self.stream = on.unwrap_or(self.stream);
                self.tx
                    .send(format_args!("{}", Command::Stream(Some(self.stream))))
                    .await;
            }
            Command::Rows(rows) => {
                if let Some(rows) = rows {
                    self.settings.rows = rows;
                    self.apply();
                }
                self.tx
                    .send(format_args!("{}", Command::Rows(Some(self.settings.rows))))
                    .await;
            }
            Command::Black(black) => {
                if let Some(black) = black {
                    self.settings.black_level = black;
                    self.apply();
                }
                self.tx
                    .send(format_args!(
                        "{}",
                        Command::Black(Some(self.settings.black_level))
                    ))
                    .await;
            }
            Command::Mean(mean) => {
                if let Some(mean) = mean {
                    self.settings.mean = mean;
                    self.apply();
                }
                self.tx
                    .send(format_args!("{}", Command::Mean(Some(self.settings.mean))))
                    .await;
            }
            Command::Estimator(estimator) => {
                if let Some(estimator) = estimator {
                    self.settings.estimator = estimator;
                    self.apply();
                }
                self.tx
                    .send(format_args!(
                        "{}",
                        Command::Estimator(Some(self.settings.estimator))
                    ))
                    .await;
            }
            Command::Calibration(on) => {
                if let Some(on) = on {
                    self.calibration = if on { Calibration::nominal() } else { None };
                }
                let on = self.calibration.is_some();
                self.tx
                    .send(format_args!("{}", Command::Calibration(Some(on))))
                    .await;
            }
        }
    }

    fn apply(&self) {
        SETTINGS.signal(self.settings);
    }

    fn status(&self) -> Status {
        Status {
            started_by: self.started_by,
            uptime_ms: self.started_at.elapsed().as_millis(),
            rows: COUNTERS.rows.get(),
            rows_lost: COUNTERS.rows_lost.get(),
            rows_failed: COUNTERS.rows_failed.get(),
            row_cycles: COUNTERS.row_cycles.get(),
            readings: self.readings,
            faults: self.faults,
            lines_dropped: COUNTERS.lines_dropped.get(),
            serial_errors: SerialErrors {
                noise: COUNTERS.serial_noise.get(),
                framing: COUNTERS.serial_framing.get(),
                overrun: COUNTERS.serial_overrun.get(),
            },
        }
    }
}

/// The line's sending side.
struct Transmitter(BufferedUartTx<'static>);

impl Transmitter {
    /// Sends an answer, however long that takes: a person or a program waits for it.
    async fn send(&mut self, answer: Arguments<'_>) {
        let mut text = String::<MAX_ANSWER>::new();
        // An answer that does not fit is cut off; the tests of the protocol hold that all fit.
        let _ = write!(text, "{answer}\r\n");
        for piece in text.as_bytes().chunks(PIECE) {
            while !self.accept(piece) {
                // The line carries 11 bytes a millisecond.
                Timer::after_millis(2).await;
            }
        }
    }

    /// Sends a result if there is room for it, and drops it otherwise: the next one is more recent.
    fn offer(&mut self, result: &dyn Display) {
        let mut line = String::<128>::new();
        let _ = write!(line, "{result}\r\n");
        COUNTERS.lines_dropped.add_if(!self.accept(line.as_bytes()));
    }

    /// Hands over all of the bytes or, without room for them, none. An error would come again if it were repeated:
    /// the bytes count as handed over.
    fn accept(&mut self, bytes: &[u8]) -> bool {
        let accepted = poll_once(self.0.write(bytes)).is_ready();
        board::SERIAL_INTERRUPT.pend();
        accepted
    }
}
