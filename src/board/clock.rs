//! The clocks: 168 MHz for the core, from the ST-LINK's 8 MHz or from the chip's own oscillator.

use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::time::Hertz;
use embassy_stm32::{Config, Peripherals, interrupt, pac, rcc};
use slitrange_device::protocol::info::Clock;

use super::processor::cycles;

/// How long the ST-LINK's clock may take to come: it comes some 2 s after the power if the board is not
/// powered by the ST-LINK.
const CLOCK_TIMEOUT_MS: u32 = 3000;

/// The chip starts with its own oscillator, in kHz.
const OWN_CLOCK_KHZ: u32 = 16_000;

/// Waits for the clock from the ST-LINK. embassy would wait for ever.
pub fn start() -> Clock {
    pac::RCC.cr().modify(|cr| {
        cr.set_hsebyp(true);
        cr.set_hseon(true);
    });
    let start = cycles();
    while cycles().wrapping_sub(start) < CLOCK_TIMEOUT_MS * OWN_CLOCK_KHZ {
        if pac::RCC.cr().read().hserdy() {
            return Clock::External;
        }
        pac::IWDG.kr().write(|kr| kr.set_key(Key::RESET));
        cortex_m::asm::delay(OWN_CLOCK_KHZ);
    }
    pac::RCC.cr().modify(|cr| cr.set_hseon(false));
    Clock::Internal
}

/// Sets up embassy, and clears the flags that its set-up raises in TIM5.
///
/// embassy-stm32 0.6.0 generates an update while compare register 1 is still 0, which counts as a match. Its
/// interrupt would then count half a wrap of TIM5 that has not passed. From then on, time would fall back by
/// 65 ms for a moment at each wrap, from the wrap to its interrupt. An alarm due in that moment would ring 65
/// ms late, and the pulses that it should have brought would follow at once, 5 us apart.
pub fn init_chip(clock: Clock) -> Peripherals {
    cortex_m::interrupt::free(|_| {
        let p = embassy_stm32::init(config(clock));
        pac::TIM5.sr().write(|_| ());
        interrupt::TIM5.unpend();
        p
    })
}

/// 8 MHz from the ST-LINK or 16 MHz from the chip's own oscillator, 168 MHz for the core, 84 MHz for SPI1
/// (APB2), 42 MHz for USART3 (APB1).
fn config(clock: Clock) -> Config {
    let mut config = Config::default();
    let (source, divider) = match clock {
        Clock::External => {
            config.rcc.hse = Some(rcc::Hse {
                freq: Hertz(8_000_000),
                mode: rcc::HseMode::Bypass,
            });
            (rcc::PllSource::HSE, rcc::PllPreDiv::DIV4)
        }
        Clock::Internal => (rcc::PllSource::HSI, rcc::PllPreDiv::DIV8),
    };
    config.rcc.pll_src = source;
    // 2 MHz * 168 / 2 = 168 MHz. / 7 = 48 MHz, which nothing uses, but the PLL must be within its limits.
    config.rcc.pll = Some(rcc::Pll {
        prediv: divider,
        mul: rcc::PllMul::MUL168,
        divp: Some(rcc::PllPDiv::DIV2),
        divq: Some(rcc::PllQDiv::DIV7),
        divr: None,
    });
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config.rcc.ahb_pre = rcc::AHBPrescaler::DIV1;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV4;
    config.rcc.apb2_pre = rcc::APBPrescaler::DIV2;
    config.dma_interrupt_priority = Priority::P1;
    config
}

/// Lets the chip watch the clock from outside. If the clock stops, the chip goes on by its own oscillator,
/// and the exception NMI switches the laser off ([`super::last_stop`]).
pub fn watch(clock: Clock) {
    pac::RCC
        .cr()
        .modify(|cr| cr.set_csson(clock == Clock::External));
}

/// Enables caches and prefetch, which hide most of flash's five wait states (RM0090 section 3.5).
/// embassy-stm32 0.6.0 sets the wait states only.
pub fn enable_flash_accelerator() {
    pac::FLASH.acr().modify(|acr| {
        acr.set_icen(true);
        acr.set_dcen(true);
        acr.set_prften(true);
    });
}
