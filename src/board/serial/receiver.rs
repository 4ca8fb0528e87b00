//! Receives characters from the serial line, and counts those that were lost or damaged.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::interrupt::typelevel::{Handler, USART3};
use embassy_stm32::pac;
use embassy_stm32::pac::usart::regs::Sr;
use embassy_stm32::usart::BufferedUartRx;
use embedded_io_async::Read as _;
use static_cell::ConstStaticCell;

use crate::counters::COUNTERS;

/// Incoming characters: 44 ms of the line, longer than any computation in thread mode.
pub static RECEIVED: ConstStaticCell<[u8; ROOM]> = ConstStaticCell::new([0; ROOM]);
const ROOM: usize = 512;

/// How many characters wait in that buffer. embassy drops those that come to a full buffer, and tells nobody.
static WAITING: AtomicU32 = AtomicU32::new(0);

/// The receiver.
pub struct Receiver(BufferedUartRx<'static>);

impl Receiver {
    /// Makes a receiver of a port's receiving side.
    pub fn new(port: BufferedUartRx<'static>) -> Self {
        Self(port)
    }

    /// Reads the characters that came, or waits for some, and gives their number. A character that comes to a
    /// full buffer just before this ends is counted as lost, although it found room.
    pub async fn read(&mut self, bytes: &mut [u8]) -> usize {
        // This driver never returns an error: it drops them, and `CountSerialErrors` counts them.
        let count = self.0.read(bytes).await.unwrap_or(0);
        // A character that came between two reads of the interrupt's flags was not noted, so this must not
        // wrap.
        let taken = count as u32;
        let _ = WAITING.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |waiting| {
            Some(waiting.saturating_sub(taken))
        });
        count
    }
}

/// The serial line's flags at the begin of its interrupt.
static FLAGS: AtomicU32 = AtomicU32::new(0);

/// Notes the flags.
pub struct NoteFlags;

impl Handler<USART3> for NoteFlags {
    unsafe fn on_interrupt() {
        // Reading SR alone clears nothing.
        FLAGS.store(pac::USART3.sr().read().0, Ordering::Relaxed);
    }
}

/// Counts receive errors, and characters that find the buffer full. embassy's driver clears the errors and
/// logs them, but tells nobody.
pub struct CountSerialErrors;

impl Handler<USART3> for CountSerialErrors {
    unsafe fn on_interrupt() {
        let flags = Sr(FLAGS.load(Ordering::Relaxed));
        if flags.rxne() {
            let is_full = WAITING.load(Ordering::Relaxed) >= ROOM as u32;
            COUNTERS.serial_overrun.add_if(is_full);
            WAITING.fetch_add(u32::from(!is_full), Ordering::Relaxed);
        }
        // Nearly always there is no error, and an interrupt comes for each character.
        if !(flags.ne() || flags.fe() || flags.ore()) {
            return;
        }
        COUNTERS.serial_noise.add_if(flags.ne());
        COUNTERS.serial_framing.add_if(flags.fe());
        COUNTERS.serial_overrun.add_if(flags.ore());
    }
}
