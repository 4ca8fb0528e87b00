//! The laser: a timer switches it on for the exposure, once in each row.
//!
//! TIM4 runs in one-pulse mode at 1 MHz. The program starts it at the end of SH's pulse, which begins a row's
//! light. The timer alone raises and lowers the output: neither interrupts nor a program that hangs can make
//! the pulse longer. The timer goes on only while its own interrupt is served: if nothing serves interrupts,
//! or a debugger halts the core, the laser is off 0.9 ms later, and stays off. At reset the pin is an input.
//! A resistor at the laser's driver then keeps the laser off (docs/exposure.md).
//!
//! The middle of the pulse is the same for all exposures, so that a target that moves is seen at the same
//! time of each row.

use core::sync::atomic::{AtomicU16, Ordering};

use embassy_stm32::gpio::OutputType;
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::pac::timer::vals::Ocm;
use embassy_stm32::timer::Ch4;
use embassy_stm32::timer::low_level::Timer;
use embassy_stm32::timer::simple_pwm::PwmPin;
use embassy_stm32::{Peri, pac, peripherals};
use slitrange::base::exposure::Exposure;

/// The counter's speed: a step is a microsecond.
const COUNTER_HZ: u32 = 1_000_000;

/// Channel 4 of TIM4.
const CHANNEL: usize = 3;

/// The channel whose compare value calls for the next extension of a pulse. Its pin is not connected.
const EXTENSION: usize = 0;

/// A pulse is extended every so many microseconds, and ends this long after an extension that does not come.
const EXTEND_EVERY: u16 = 400;
const END_AFTER: u16 = 500;

/// The counter's last value in the pulse that was ordered.
static LAST: AtomicU16 = AtomicU16::new(0);

/// Lets the pulse last until the next extension is overdue, at most as long as it was ordered.
fn extend(at: u16) {
    let timer = pac::TIM4;
    // At most 5600 + 400 + 500.
    let next = at + EXTEND_EVERY;
    let last = LAST.load(Ordering::Relaxed).min(next + END_AFTER);
    timer.ccr(EXTENSION).write(|compare| compare.set_ccr(next));
    timer.arr().write(|reload| reload.set_arr(last));
}

#[interrupt]
fn TIM4() {
    clear_flag();
    extend(pac::TIM4.ccr(EXTENSION).read().ccr());
}

/// Clears the flag that calls for an extension, by a zero.
fn clear_flag() {
    pac::TIM4.sr().write(|flags| {
        flags.0 = u32::MAX;
        flags.set_ccif(EXTENSION, false);
    });
}

/// Switches the laser off until the next reset, in a pulse too, and whatever else uses the timer.
pub fn force_off() {
    pac::TIM4
        .ccmr_output(CHANNEL / 2)
        .modify(|mode| mode.set_ocm(CHANNEL % 2, Ocm::FORCE_INACTIVE));
}

/// Whether rows have pulses.
pub fn is_used() -> bool {
    pac::TIM4.arr().read().arr() != 0
}

/// The laser's switch.
pub struct Laser {
    /// The timer has its clock, and the pin its output, as long as these are kept.
    _timer: Timer<'static, peripherals::TIM4>,
    _pin: PwmPin<'static, peripherals::TIM4, Ch4>,
}

impl Laser {
    /// Sets the timer up. The laser stays off.
    pub fn new(
        timer: Peri<'static, peripherals::TIM4>,
        pin: Peri<'static, peripherals::PD15>,
    ) -> Self {
        let timer = Timer::new(timer);
        let registers = pac::TIM4;
        let prescaler = timer.get_clock_frequency().0 / COUNTER_HZ - 1;
        registers.psc().write_value(prescaler as u16);
        // The output is low while the counter, which stands at 0, is below the compare value. So that value
        // is set before the output's mode, and the pin is connected last.
        registers.ccr(CHANNEL).write(|compare| compare.set_ccr(1));
        registers.egr().write(|event| event.set_ug(true));
        registers
            .ccmr_output(CHANNEL / 2)
            .modify(|mode| mode.set_ocm(CHANNEL % 2, Ocm::PWM_MODE2));
        registers.cr1().modify(|control| control.set_opm(true));
        registers
            .ccer()
            .modify(|enable| enable.set_cce(CHANNEL, true));
        registers
            .dier()
            .write(|enable| enable.set_ccie(EXTENSION, true));
        // SAFETY: the handler above needs nothing that is not ready.
        unsafe { interrupt::TIM4.enable() };
        Self {
            _timer: timer,
            _pin: PwmPin::new(pin, OutputType::PushPull),
        }
    }

    /// Sets the length of the next pulse, whose middle is that of the `longest`. `None`: no pulse. Call it
    /// while no pulse is under way.
    pub fn set_exposure(&mut self, exposure: Option<Exposure>, longest: Exposure) {
        let us = exposure.map_or(0, Exposure::us);
        // The output is high from `rise` up to the counter's last value.
        let rise = 1 + (longest.us() - us) / 2;
        let last = if us == 0 { 0 } else { rise + us - 1 };
        // It stands still already, but for a row that began too early after a halt.
        pac::TIM4.cr1().modify(|control| control.set_cen(false));
        pac::TIM4
            .ccr(CHANNEL)
            .write(|compare| compare.set_ccr(rise));
        LAST.store(last, Ordering::Relaxed);
        extend(0);
        // Restarts the prescaler too, so that each pulse begins as long after its start.
        pac::TIM4.egr().write(|event| event.set_ug(true));
        clear_flag();
    }

    /// Starts the pulse.
    #[inline]
    pub fn start(&mut self) {
        if is_used() {
            pac::TIM4.cr1().modify(|control| control.set_cen(true));
        }
    }
}
