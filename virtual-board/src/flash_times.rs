//! rigless's flash interface with the times of the board's conditions: an erase may take longer than
//! rigless's, and a word is busy for some time.

use std::num::NonZeroU32;

use rigless::device::{Device, DeviceContext as Context, RegisterFile as Registers};
use rigless::soc::stm32f427::generated::flash::{Register, cr, sr};
use rigless::soc::stm32f427::peripherals::flash::Flash;
use rigless::soc::stm32f427::peripherals::rcc;
use rigless::time::{EventId, VirtualNanos};

use crate::base::Nanos;
use crate::forward::forward;

/// How long an erase of a sector takes in rigless, ns.
pub(crate) const SHORTEST_ERASE: Nanos = 400_000_000;

#[derive(Debug)]
pub(crate) struct FlashTimes {
    interface: Flash,
    /// How much longer than [`SHORTEST_ERASE`] an erase takes, ns.
    pub(crate) longer: Nanos,
    /// The late end of an erase, and rigless's own.
    erase: Option<(EventId, EventId)>,
    word: Option<EventId>,
}

impl FlashTimes {
    pub(crate) fn new(longer: Nanos, supply_millivolts: NonZeroU32) -> Self {
        // As rigless makes it.
        let mut interface = Flash::with_clock(rcc::HSI_HZ);
        interface.set_supply(supply_millivolts);
        Self {
            interface,
            longer,
            erase: None,
            word: None,
        }
    }

    pub(crate) fn word_ends(&mut self, at: Nanos, context: &mut Context<'_>) {
        self.word = Some(context.schedule(VirtualNanos(at.max(context.now().0))));
    }
}

impl Device for FlashTimes {
    type Register = Register;

    fn on_event(&mut self, event: EventId, registers: &mut Registers, context: &mut Context<'_>) {
        if self.word == Some(event) {
            self.word = None;
            let status = registers.get(Register::Sr);
            if cr::EOPIE.is_set(registers.get(Register::Cr)) {
                registers.set(Register::Sr, sr::EOP.set(status, 1));
            }
            // This clears no bit, and raises the interrupt.
            Device::write(&mut self.interface, Register::Sr, 0, registers, context);
            return;
        }
        let event = match self.erase.take() {
            Some((late, end)) if late == event => end,
            _ if self.longer > 0 => {
                let late = context.schedule(VirtualNanos(context.now().0 + self.longer));
                self.erase = Some((late, event));
                return;
            }
            _ => event,
        };
        Device::on_event(&mut self.interface, event, registers, context);
    }

    forward! { Device for interface:
        fn on_clock(&mut self, hz: u64, registers: &mut Registers, context: &mut Context<'_>);
        fn write(&mut self, what: Register, value: u64, at: &mut Registers, context: &mut Context<'_>);
    }
}
