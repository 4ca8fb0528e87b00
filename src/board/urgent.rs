//! The executor for what must be on time. It runs in the interrupt of UART4; the port itself is not used.

use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_stm32::interrupt;

static URGENT: InterruptExecutor = InterruptExecutor::new();

/// Starts the executor for what must be on time.
pub fn start_urgent_executor() -> SendSpawner {
    URGENT.start(interrupt::UART4)
}

#[interrupt]
unsafe fn UART4() {
    // SAFETY: this is the interrupt of the executor, and nothing else calls `on_interrupt`. The interrupt
    // comes only after `start` enabled it.
    unsafe { URGENT.on_interrupt() }
}
