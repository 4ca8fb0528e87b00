//! The trigger's pin: line 3 of EXTI, which belongs to PA3 after a reset.
//!
//! rigless has the registers of EXTI and no model behind them. This one has rising edges, the mask and the
//! pending flag of one line (RM0090 section 12.3). Firmware that selects another port in SYSCFG, which has no
//! model either, fails a clean run.

use rigless::device::{Device, DeviceContext as Context, Level, RegisterFile as Registers};
use rigless::soc::stm32f427::generated::exti::Register;

/// The line, and its interrupt's place in the list of EXTI's interrupts.
const LINE: u64 = 3;
const INTERRUPT: usize = 4;

/// EXTI with the level of one pin.
#[derive(Debug, Default)]
pub struct Trigger {
    is_high: bool,
}

impl Trigger {
    /// Drives the pin.
    pub fn drive(&mut self, high: bool, registers: &mut Registers, context: &mut Context<'_>) {
        let rises = high && !self.is_high;
        self.is_high = high;
        if rises && registers.get(Register::Rtsr) >> LINE & 1 == 1 {
            registers.set(Register::Pr, registers.get(Register::Pr) | 1 << LINE);
            interrupt(registers, context);
        }
    }
}

/// The line's interrupt is the level of its flag and its mask.
fn interrupt(registers: &Registers, context: &mut Context<'_>) {
    let raised = registers.get(Register::Pr) & registers.get(Register::Imr);
    context.interrupt(INTERRUPT, Level::from(raised >> LINE & 1 == 1));
}

impl Device for Trigger {
    type Register = Register;

    fn write(&mut self, what: Register, value: u64, at: &mut Registers, context: &mut Context<'_>) {
        match what {
            // A one clears.
            Register::Pr => at.set(Register::Pr, at.get(Register::Pr) & !value),
            register => at.set(register, value),
        }
        interrupt(at, context);
    }
}
