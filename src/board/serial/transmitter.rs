//! Sends characters to the serial line.
//!
//! # Note
//!
//! embassy-stm32 0.6.0's buffered transmitter wants care:
//! * `write` takes all of the bytes or none, and fails if there are more than its buffer holds.
//! * `write` without room registers no waker: awaited, it would sleep for ever. It is polled here.
//! * `write` starts the interrupt only if the buffer was empty when it checked. If the last bytes leave
//!   between that check and the new bytes' arrival, nobody starts it: [`hand_over_bytes`] starts it after
//!   every write.

use embassy_futures::poll_once;
use embassy_stm32::usart::BufferedUartTx;
use embassy_time::Timer;
use embedded_io_async::Write as _;
use slitrange_device::settings::serial_line::Baud;

use super::rs485::hand_over_bytes;
use crate::counters::COUNTERS;

/// Bytes handed over at a time: a small part of the driver's buffer, so that it does not run dry meanwhile.
const PIECE: usize = 64;

/// See the module.
pub struct Transmitter {
    port: BufferedUartTx<'static>,
    baud: Baud,
}

impl Transmitter {
    /// Makes a transmitter of a port's sending side, which has the rate of every start.
    pub fn new(port: BufferedUartTx<'static>) -> Self {
        Self {
            port,
            baud: Baud::default(),
        }
    }

    /// Changes the rate of both directions, once all bytes have left at the old rate.
    pub async fn set_baud(&mut self, baud: Baud) {
        if baud == self.baud {
            return;
        }
        self.drain().await;
        // The rates are constant: a wrong one fails at its first use.
        defmt::unwrap!(self.port.set_baudrate(baud.bits_a_second()));
        self.baud = baud;
    }

    /// Waits until the last bit has left.
    pub async fn drain(&mut self) {
        while !self.is_empty() {
            Timer::after_millis(1).await;
        }
    }

    /// Sends bytes, however long that takes: a person or a program waits for them.
    pub async fn send(&mut self, bytes: &[u8]) {
        for piece in bytes.chunks(PIECE) {
            while !self.try_hand_over(piece) {
                // The line carries 11 to 92 bytes a millisecond.
                Timer::after_millis(2).await;
            }
        }
    }

    /// Sends a line or a packet if there is room for it, and drops it otherwise: the next one is more recent.
    pub fn send_or_drop(&mut self, bytes: &[u8]) {
        COUNTERS.lines_dropped.add_if(!self.try_hand_over(bytes));
    }

    /// Whether the last bit of all bytes has left.
    pub fn is_empty(&mut self) -> bool {
        poll_once(self.port.flush()).is_ready()
    }

    /// Hands over all of the bytes or, without room for them, none. On an error the bytes count as handed
    /// over, because a second try would give the same error.
    fn try_hand_over(&mut self, bytes: &[u8]) -> bool {
        if bytes.is_empty() {
            return true;
        }
        hand_over_bytes(|| poll_once(self.port.write(bytes)).is_ready())
    }
}
