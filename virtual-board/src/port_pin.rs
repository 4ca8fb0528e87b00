//! How the firmware has set up the pins of the processor's ports.

use rigless::mcu::Mcu as _;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32f427::generated::gpioa::Register::{Afrh, Afrl, Moder, Odr, Ospeedr, Pupdr};

/// Modes of a pin (RM0090 section 8.4.1).
pub const OUTPUT: u64 = 0b01;
/// The mode of a pin that a peripheral drives.
pub const ALTERNATE: u64 = 0b10;

/// The bits of a port's registers for one pin (RM0090 section 8.4).
pub struct Pin {
    /// [`OUTPUT`], [`ALTERNATE`], or an input.
    pub mode: u64,
    /// The number of the alternate function.
    pub function: u64,
    /// How fast its edges are.
    pub speed: u64,
    /// Pull-up (1) or pull-down (2).
    pub pull: u64,
    /// Whether an output is high.
    pub is_high: bool,
}

impl Pin {
    /// A pin of a port of a name, as `GPIOA`.
    ///
    /// # Panics
    /// The part has no such port.
    pub fn of(part: &Stm32f427, port: &'static str, number: u64) -> Self {
        let slot = part.bus().slot(port).expect("the part has this port");
        let registers = part.bus().slots()[slot].registers();
        let two_bits = |register| registers.get(register) >> (2 * number) & 0b11;
        let half = [Afrl, Afrh][usize::from(number >= 8)];
        Self {
            mode: two_bits(Moder),
            function: registers.get(half) >> (4 * (number % 8)) & 0b1111,
            speed: two_bits(Ospeedr),
            pull: two_bits(Pupdr),
            is_high: registers.get(Odr) >> number & 1 == 1,
        }
    }

    /// Whether a peripheral drives it by this function.
    pub fn has_function(&self, function: u64) -> bool {
        self.mode == ALTERNATE && self.function == function
    }
}
