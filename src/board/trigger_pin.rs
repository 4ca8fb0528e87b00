//! The trigger's pin: a rising edge starts a frame.

use embassy_stm32::gpio::{Input, Pull};
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::peripherals::PA3;
use embassy_stm32::{Peri, interrupt, pac};

use crate::trigger::FRAMES;

/// The trigger's line of EXTI. After a reset, line 3 is that of PA3 (RM0090 section 9.2.3).
const TRIGGER: usize = 3;

/// Lets rising edges of the trigger interrupt.
pub fn watch_trigger(pin: Peri<'static, PA3>) {
    // Dropping the input would take its pull-down away.
    core::mem::forget(Input::new(pin, Pull::Down));
    pac::EXTI
        .rtsr(0)
        .modify(|rising| rising.set_line(TRIGGER, true));
    // SAFETY: the handler below needs nothing that is not ready.
    unsafe { interrupt::EXTI3.enable() };
}

/// Lets edges at the trigger's pin interrupt, or not: noise at a pin that nobody uses takes no time.
pub fn listen_to_trigger(listens: bool) {
    // An edge of before counts no more. Writing a one clears the line's flag, and no other.
    pac::EXTI.pr(0).write(|edges| edges.set_line(TRIGGER, true));
    pac::EXTI
        .imr(0)
        .modify(|enabled| enabled.set_line(TRIGGER, listens));
}

/// An edge at the trigger's pin.
#[interrupt]
fn EXTI3() {
    // Writing a one clears the line's flag, and no other.
    pac::EXTI.pr(0).write(|edges| edges.set_line(TRIGGER, true));
    FRAMES.take_edge();
}
