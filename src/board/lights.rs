//! The board's three lights. LD1 blinks: once a second while the sensor measures, five times a second while
//! results are faults. If it does not blink, the firmware has stopped. LD2 is on while the laser is used. LD3
//! is on while results are faults, and after a panic or a HardFault.

use embassy_stm32::gpio::{AnyPin, Level, Output, Speed};
use embassy_stm32::{Peri, pac, peripherals};

use super::laser;
use crate::counters::COUNTERS;

/// The ports of LD1 to LD3: PB0, PB7, PB14 (UM1974, section 6.5).
const PINS: [usize; 3] = [0, 7, 14];

/// Calls of [`Lights::update`] in half a period of LD1 while the sensor measures.
const HALF_PERIOD: u32 = 5;

/// See the module.
pub struct Lights {
    pins: [Output<'static>; 3],
    updates: u32,
}

impl Lights {
    /// All dark.
    pub fn new(
        ld1: Peri<'static, peripherals::PB0>,
        ld2: Peri<'static, peripherals::PB7>,
        ld3: Peri<'static, peripherals::PB14>,
    ) -> Self {
        let pins: [Peri<'static, AnyPin>; 3] = [ld1.into(), ld2.into(), ld3.into()];
        Self {
            pins: pins.map(|pin| Output::new(pin, Level::Low, Speed::Low)),
            updates: 0,
        }
    }

    /// Shows how the sensor is. Call it every 100 ms.
    pub fn update(&mut self, alive: bool) {
        self.updates = self.updates.wrapping_add(1);
        let faulty = COUNTERS.result_is_fault.get() != 0;
        let half_period = if faulty { 1 } else { HALF_PERIOD };
        let blink = (self.updates / half_period).is_multiple_of(2);
        let shown = [alive && blink, laser::is_used(), faulty];
        for (pin, on) in self.pins.iter_mut().zip(shown) {
            pin.set_level(on.into());
        }
    }
}

/// Shows that the firmware has stopped.
pub fn stopped() {
    pac::GPIOB.bsrr().write(|pins| {
        pins.set_br(PINS[0], true);
        pins.set_br(PINS[1], true);
        pins.set_bs(PINS[2], true);
    });
}
