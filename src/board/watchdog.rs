//! The chip's watchdog, which no bug can stop.

use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peri, pac};

/// Starts the board again if nobody pets it.
pub type Watchdog = IndependentWatchdog<'static, IWDG>;

/// The watchdog's timeout by its own clock, which may run between 17 and 47 kHz instead of 32 (data sheet of
/// the STM32F429, LSI): 0.7 to 1.9 s.
const TIMEOUT_US: u32 = 1_000_000;

/// Starts the watchdog. Its first timeout is that of every start, 0.3 to 1 s.
pub fn start() {
    // A breakpoint stops the watchdog too, but not the laser's timer: it would leave the laser on. A debugger
    // may have set that, and a reset does not clear it (RM0090 section 38.16.4).
    pac::DBGMCU.apb1fzr().modify(|freeze| {
        freeze.set_iwdg(true);
        freeze.set_tim4(false);
    });
    pac::IWDG.kr().write(|kr| kr.set_key(Key::START));
}

/// Sets the timeout.
pub fn set_timeout(peripheral: Peri<'static, IWDG>) -> Watchdog {
    let mut watchdog = IndependentWatchdog::new(peripheral, TIMEOUT_US);
    watchdog.unleash();
    watchdog
}
