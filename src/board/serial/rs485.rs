//! The driver of an RS-485 line: enabled while the sensor sends.

use embassy_stm32::gpio::{Level, Output, Speed};
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::interrupt::typelevel::{Handler, USART3};
use embassy_stm32::peripherals::PD12;
use embassy_stm32::{Peri, pac};

use super::INTERRUPT;

/// The pin of port D that enables the line's driver, with RS-485.
const DRIVER_ENABLE: usize = 12;

/// The sensor does not send yet.
pub fn start(pin: Peri<'static, PD12>) {
    // Dropping the output would make the pin an input again.
    core::mem::forget(Output::new(pin, Level::Low, Speed::Low));
}

/// Hands bytes over to embassy's transmitter by `write`, with the line's driver enabled from before the first
/// bit on. [`ReleaseLine`] disables it after the last one.
pub fn hand_over_bytes<T>(write: impl FnOnce() -> T) -> T {
    // Without the serial line's interrupt, nothing releases the line before the bytes have come.
    INTERRUPT.disable();
    pac::GPIOD
        .bsrr()
        .write(|pins| pins.set_bs(DRIVER_ENABLE, true));
    let written = write();
    INTERRUPT.pend();
    // SAFETY: the interrupt was enabled before, and nothing here depends on its absence.
    unsafe { INTERRUPT.enable() };
    written
}

/// Disables the line's driver once the last bit has left.
pub struct ReleaseLine;

impl Handler<USART3> for ReleaseLine {
    unsafe fn on_interrupt() {
        // embassy's handler, which ran before, waits for TXE while bytes wait, and for TC from the last byte
        // on.
        let control = pac::USART3.cr1().read();
        if !control.txeie() && !control.tcie() {
            pac::GPIOD
                .bsrr()
                .write(|pins| pins.set_br(DRIVER_ENABLE, true));
        }
    }
}
