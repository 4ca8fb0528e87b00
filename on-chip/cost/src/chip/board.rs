//! The board as the firmware sets it up, as far as it decides how fast the core is: clocks and flash.
//! `embassy-stm32` gives the flash its five wait states and leaves its caches off, in the firmware and here.

use cortex_m::peripheral::DCB;
use embassy_stm32::time::Hertz;
use embassy_stm32::{Config, rcc};

/// Sets the clocks, starts the cycle counter, and keeps all interrupts off from now on.
pub fn init() {
    let _ = embassy_stm32::init(config());
    // As the firmware does.
    embassy_stm32::pac::FLASH.acr().modify(|acr| {
        acr.set_icen(true);
        acr.set_dcen(true);
        acr.set_prften(true);
    });
    cortex_m::interrupt::disable();
    // SAFETY: called once, before anything else could use these registers.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
}

/// The firmware's clocks: 8 MHz from the ST-LINK, 8 MHz / 4 * 168 / 2 = 168 MHz for the core.
fn config() -> Config {
    let mut config = Config::default();
    config.rcc.hse = Some(rcc::Hse {
        freq: Hertz(8_000_000),
        mode: rcc::HseMode::Bypass,
    });
    config.rcc.pll_src = rcc::PllSource::HSE;
    config.rcc.pll = Some(rcc::Pll {
        prediv: rcc::PllPreDiv::DIV4,
        mul: rcc::PllMul::MUL168,
        divp: Some(rcc::PllPDiv::DIV2),
        divq: Some(rcc::PllQDiv::DIV7),
        divr: None,
    });
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config.rcc.ahb_pre = rcc::AHBPrescaler::DIV1;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV4;
    config.rcc.apb2_pre = rcc::APBPrescaler::DIV2;
    config
}

/// Gives the debugger, or the emulator, the time to take the log's last line out of its buffer: 2 ms.
pub fn let_the_log_out() {
    cortex_m::asm::delay(336_000);
}

/// The end of the log: a debugger is told to go.
pub fn end_the_log() {
    let_the_log_out();
    if DCB::is_debugger_attached() {
        /// Semihosting's SYS_EXIT, and its reason "application exit".
        const SYS_EXIT: u32 = 0x18;
        const APPLICATION_EXIT: u32 = 0x20026;
        // SAFETY: this operation takes a number and no pointer, and a debugger is there to serve it.
        unsafe { cortex_m::asm::semihosting_syscall(SYS_EXIT, APPLICATION_EXIT) };
    }
}
