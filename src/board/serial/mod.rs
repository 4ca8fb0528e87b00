//! The serial line's port.

mod receiver;
mod rs485;
mod transmitter;

use embassy_stm32::Peri;
use embassy_stm32::gpio::Pull;
use embassy_stm32::interrupt::Interrupt;
use embassy_stm32::peripherals::{PD8, PD9, PD12, USART3};
use embassy_stm32::usart::{self, BufferedUart};
use slitrange_device::protocol::MAX_ANSWER;
use slitrange_device::settings::serial_line::Baud;
use static_cell::ConstStaticCell;

pub use receiver::{CountSerialErrors, NoteFlags, Receiver};
pub use rs485::ReleaseLine;
pub use transmitter::Transmitter;

use super::Interrupts;

/// Both directions.
pub type SerialPort = BufferedUart<'static>;

/// The interrupt of the serial line.
pub const INTERRUPT: Interrupt = Interrupt::USART3;

/// Outgoing characters: the longest answer, and as many characters of the readings that come meanwhile if a
/// frame is one row. With less, lines are dropped after `help estimator`. In core-coupled memory, because no
/// DMA needs it, and the stack has the room.
#[unsafe(link_section = ".ccm.to_send")]
static TO_SEND: ConstStaticCell<[u8; 2 * MAX_ANSWER]> = ConstStaticCell::new([0; 2 * MAX_ANSWER]);

/// Opens the port, with the rate of every start.
pub fn open(
    port: Peri<'static, USART3>,
    rx: Peri<'static, PD9>,
    tx: Peri<'static, PD8>,
    driver: Peri<'static, PD12>,
) -> SerialPort {
    rs485::start(driver);
    let mut config = usart::Config::default();
    config.baudrate = Baud::default().bits_a_second();
    // While the sensor sends, an RS-485 chip whose RE is tied to DE lets go of the pin.
    config.rx_pull = Pull::Up;
    let (to_send, received) = (TO_SEND.take(), receiver::RECEIVED.take());
    let port = BufferedUart::new(port, rx, tx, to_send, received, Interrupts, config);
    // The configuration is constant: a wrong one fails at the first start.
    defmt::unwrap!(port)
}
