//! Sends characters to the serial line. The driver of an RS-485 line is enabled meanwhile.

use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::pac;
use embassy_stm32::pac::usart::regs::Sr;
use embassy_time::Timer;
use slitrange_device::protocol::MAX_ANSWER;
use slitrange_device::settings::serial_line::{Baud, Bits};

use super::queue::Queue;
use super::{INTERRUPT, set_line};
use crate::counters::COUNTERS;

/// Outgoing characters: the longest answer, and as many characters of the readings that come meanwhile if a
/// frame is one row. With less, lines are dropped after `help estimator`. In core-coupled memory, because no
/// DMA needs it, and the stack has the room.
#[unsafe(link_section = ".ccm.to_send")]
static TO_SEND: Queue<{ 2 * MAX_ANSWER }> = Queue::new();

/// Bytes handed over at a time: a small part of the queue, so that it does not run dry meanwhile.
const PIECE: usize = 64;

/// The pin of port D that enables the line's driver, with RS-485.
const DRIVER_ENABLE: usize = 12;

/// See the module.
pub struct Transmitter {
    line: (Baud, Bits),
}

impl Transmitter {
    pub(super) fn new() -> Self {
        Self {
            line: Default::default(),
        }
    }

    /// Changes rate and characters of both directions, once all bytes have left as before.
    pub async fn set_line(&mut self, baud: Baud, bits: Bits) {
        if (baud, bits) == self.line {
            return;
        }
        self.drain().await;
        set_line(baud, bits);
        self.line = (baud, bits);
    }

    /// Waits until the last bit has left. The bytes that leave are a sign of life: at 9600 baud, an answer
    /// takes seconds.
    pub async fn drain(&mut self) {
        while !self.is_empty() {
            let left = TO_SEND.len();
            Timer::after_millis(1).await;
            COUNTERS.results.add_if(TO_SEND.len() < left);
        }
    }

    /// Sends bytes, however long that takes: a person or a program waits for them.
    pub async fn send(&mut self, bytes: &[u8]) {
        for piece in bytes.chunks(PIECE) {
            while !self.try_hand_over(piece) {
                // The line carries 1 to 92 bytes a millisecond.
                Timer::after_millis(2).await;
            }
            COUNTERS.results.add();
        }
    }

    /// Sends a line or a packet if there is room for it, and drops it otherwise: the next one is more recent.
    pub fn send_or_drop(&mut self, bytes: &[u8]) {
        let (baud, _) = self.line;
        // What waits takes 0.8 s, with ten bits a character. At 115200 baud and above the queue holds less.
        let is_late = TO_SEND.len() > baud.bits_a_second() as usize * 8 / 100;
        let is_sent = !is_late && self.try_hand_over(bytes);
        COUNTERS.lines_dropped.add_if(!is_sent);
    }

    /// Whether the last bit of all bytes has left.
    pub fn is_empty(&mut self) -> bool {
        if !TO_SEND.is_empty() {
            return false;
        }
        let control = pac::USART3.cr1().read();
        !control.txeie() && !control.tcie()
    }

    /// Hands over all of the bytes or, without room for them, none. The interrupt, which comes at once, is
    /// the only one that touches the port from here on.
    fn try_hand_over(&mut self, bytes: &[u8]) -> bool {
        let has_room = TO_SEND.try_push(bytes);
        INTERRUPT.pend();
        has_room
    }
}

/// Sends the next character. The line's driver is enabled from before the first bit until after the last.
pub fn on_interrupt(flags: Sr) {
    let port = pac::USART3;
    let control = port.cr1().read();
    if !TO_SEND.is_empty() {
        pac::GPIOD
            .bsrr()
            .write(|pins| pins.set_bs(DRIVER_ENABLE, true));
        if flags.txe()
            && let Some(byte) = TO_SEND.pop()
        {
            // This clears TC only if SR was read after it rose.
            cortex_m::interrupt::free(|_| {
                port.sr().read();
                port.dr().write(|data| data.set_dr(byte.into()));
            });
        }
        if !control.txeie() || control.tcie() {
            await_flags(true, false);
        }
    } else if control.txeie() {
        // The last character is on its way.
        await_flags(false, true);
    } else if control.tcie() && flags.tc() {
        await_flags(false, false);
        pac::GPIOD
            .bsrr()
            .write(|pins| pins.set_br(DRIVER_ENABLE, true));
    }
}

/// The interrupt comes when the next character may be written, or when the last bit has left.
fn await_flags(txe: bool, tc: bool) {
    pac::USART3.cr1().modify(|control| {
        control.set_txeie(txe);
        control.set_tcie(tc);
    });
}
