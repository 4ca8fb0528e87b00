//! What the tool needs of the PC: serial ports and a clock. Tests put a simulated sensor with its own clock
//! here. Errors are the system's.

use std::io::{self, IsTerminal as _, Write as _};
use std::time::{Duration, Instant};

use serialport::{ClearBuffer, Parity, SerialPort as _, StopBits};
use slitrange_device::settings::serial_line::{Baud, Bits};
use time::OffsetDateTime;

use crate::keyboard;
use crate::screen::{RealScreen, Screen};

/// The date and the time, `2026-11-21T11:00:11.123Z`.
pub fn utc() -> String {
    let now = OffsetDateTime::now_utc();
    let (hour, minute, second, ms) = now.to_hms_milli();
    format!("{}T{hour:02}:{minute:02}:{second:02}.{ms:03}Z", now.date())
}

/// Serial ports, a clock and a terminal.
pub trait Pc {
    /// Opens a serial port for this program alone, and drops the bytes that came before.
    fn open(&self, port: &str) -> serialport::Result<Box<dyn Port + '_>>;

    /// The names of the serial ports. Pseudo-terminals are not among them.
    fn ports(&self) -> Vec<String> {
        vec![]
    }

    /// The terminal, if standard output is one.
    fn screen(&self) -> io::Result<Option<Box<dyn Screen + '_>>> {
        Ok(None)
    }

    /// The time since a moment that does not change.
    fn now(&self) -> Duration;

    /// Waits.
    fn sleep(&self, time: Duration);

    /// Whether somebody pressed Ctrl-C since this was asked for the first time. From then on Ctrl-C ends the
    /// program only when it is pressed twice, and the command must ask from time to time.
    fn interrupted(&self) -> bool {
        false
    }
}

/// An open serial port.
pub trait Port {
    /// Reads the bytes that are there, or waits for some, and gives their number.
    ///
    /// # Errors
    /// `TimedOut` if none come within `wait`; otherwise the system's.
    fn read(&mut self, bytes: &mut [u8], wait: Duration) -> io::Result<usize>;

    /// Writes all bytes.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Changes rate and characters. A port that has none, as in a test, ignores it.
    fn set_line(&mut self, baud: Baud, bits: Bits) -> io::Result<()> {
        let _ = (baud, bits);
        Ok(())
    }
}

/// The PC's own ports and clock.
#[derive(Clone, Copy, Debug)]
pub struct RealPc(Instant);

impl Default for RealPc {
    /// Time begins now.
    fn default() -> Self {
        Self(Instant::now())
    }
}

impl Pc for RealPc {
    fn open(&self, port: &str) -> serialport::Result<Box<dyn Port + '_>> {
        let port = serialport::new(port, Baud::default().bits_a_second()).open_native()?;
        #[cfg(unix)]
        let port = {
            let mut port = port;
            // The mark of exclusive use outlives a program that is killed while another end of a
            // pseudo-terminal stays open, and would keep everybody out. The library's lock ends with the
            // program, and keeps other programs out that lock the port, too.
            port.set_exclusive(false)?;
            port
        };
        port.clear(ClearBuffer::Input)?;
        Ok(Box::new(port))
    }

    fn ports(&self) -> Vec<String> {
        let ports = serialport::available_ports().unwrap_or_default();
        ports.into_iter().map(|port| port.port_name).collect()
    }

    fn screen(&self) -> io::Result<Option<Box<dyn Screen + '_>>> {
        if !io::stdout().is_terminal() {
            return Ok(None);
        }
        Ok(Some(Box::new(RealScreen::new()?)))
    }

    fn now(&self) -> Duration {
        self.0.elapsed()
    }

    fn sleep(&self, time: Duration) {
        std::thread::sleep(time);
    }

    fn interrupted(&self) -> bool {
        keyboard::watch_interrupts()
    }
}

#[cfg(unix)]
type Native = serialport::TTYPort;
#[cfg(windows)]
type Native = serialport::COMPort;

impl Port for Native {
    fn read(&mut self, bytes: &mut [u8], wait: Duration) -> io::Result<usize> {
        self.set_timeout(wait)?;
        io::Read::read(self, bytes)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.write_all(bytes)
    }

    fn set_line(&mut self, baud: Baud, bits: Bits) -> io::Result<()> {
        let (parity, stop) = match bits {
            Bits::N1 => (Parity::None, StopBits::One),
            Bits::E1 => (Parity::Even, StopBits::One),
            Bits::N2 => (Parity::None, StopBits::Two),
        };
        // A pseudo-terminal has no parity, and refuses it.
        let _ = self.set_parity(parity);
        self.set_stop_bits(stop)?;
        Ok(self.set_baud_rate(baud.bits_a_second())?)
    }
}
