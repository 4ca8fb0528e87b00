//! The serial line's port, USART3: DMA takes the characters that come, an interrupt sends the others.
//!
//! embassy-stm32 0.6.0's drivers of this port lose characters. `BufferedUart` takes each by an interrupt,
//! which may wait for the sensor's pulses longer than a character lasts at 921600 baud.
//! `RingBufferedUartRx::read` reads the data register itself, and then the DMA misses that character.

mod queue;
mod receiver;
mod transmitter;

use embassy_stm32::gpio::{AfType, AnyPin, Flex, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::interrupt::{Interrupt, InterruptExt};
use embassy_stm32::pac::usart::vals::{M0, Stop};
use embassy_stm32::peripherals::{DMA1_CH1, PD8, PD9, PD12, USART3};
use embassy_stm32::{Peri, interrupt, pac, rcc};
use slitrange_device::settings::serial_line::{Baud, Bits};

pub use receiver::{Lost, Receiver};
pub use transmitter::Transmitter;

/// Both directions.
pub type SerialPort = (Transmitter, Receiver);

/// The interrupt of the serial line.
pub const INTERRUPT: Interrupt = Interrupt::USART3;

/// The alternate function that is USART3 (data sheet of the STM32F429, table 12).
const USART3_FUNCTION: u8 = 7;

/// Opens the port, at the rate of the factory.
pub fn open(
    _port: Peri<'static, USART3>,
    rx: Peri<'static, PD9>,
    tx: Peri<'static, PD8>,
    driver: Peri<'static, PD12>,
    dma: Peri<'static, DMA1_CH1>,
) -> SerialPort {
    // Dropping a pin would make it an input again.
    core::mem::forget(Output::new(driver, Level::Low, Speed::Low));
    connect(
        tx.into(),
        AfType::output(OutputType::PushPull, Speed::Medium),
    );
    // While the sensor sends, an RS-485 chip whose RE is tied to DE lets go of the pin.
    connect(rx.into(), AfType::input(Pull::Up));
    rcc::enable_and_reset::<USART3>();
    set_line(Baud::default(), Bits::default());
    let port = pac::USART3;
    let receiver = Receiver::new(dma);
    port.cr3().write(|control| {
        control.set_dmar(true);
        control.set_eie(true);
    });
    port.cr1().modify(|control| {
        control.set_ue(true);
        control.set_te(true);
        control.set_re(true);
        control.set_idleie(true);
        control.set_peie(true);
    });
    INTERRUPT.unpend();
    // SAFETY: nothing depends on its absence.
    unsafe { INTERRUPT.enable() };
    (Transmitter::new(), receiver)
}

fn connect(pin: Peri<'static, AnyPin>, function: AfType) {
    let mut pin = Flex::new(pin);
    pin.set_as_af_unchecked(USART3_FUNCTION, function);
    core::mem::forget(pin);
}

/// Sets rate and characters of both directions. The rate is the nearest divisor of the port's clock (RM0090
/// section 30.3.4). Nothing is being sent, so no interrupt changes CR1 meanwhile.
fn set_line(baud: Baud, bits: Bits) {
    let (clock, rate) = (rcc::frequency::<USART3>().0, baud.bits_a_second());
    let divisor = (clock + rate / 2) / rate;
    // At 42 MHz and 9600 baud it is 4375. BRR holds sixteenths of USARTDIV in 16 bits.
    pac::USART3.brr().write(|register| register.0 = divisor);
    let stop = match bits {
        Bits::N1 | Bits::E1 => Stop::STOP1,
        Bits::N2 => Stop::STOP2,
    };
    pac::USART3.cr2().write(|control| control.set_stop(stop));
    // The parity bit counts as a data bit, the ninth (RM0090 section 30.3.7, even after a reset). DMA takes
    // the lower eight.
    let has_parity = bits == Bits::E1;
    pac::USART3.cr1().modify(|control| {
        control.set_m0(if has_parity { M0::BIT9 } else { M0::BIT8 });
        control.set_pce(has_parity);
    });
}

#[interrupt]
fn USART3() {
    let flags = pac::USART3.sr().read();
    receiver::on_interrupt(flags);
    transmitter::on_interrupt(flags);
}
