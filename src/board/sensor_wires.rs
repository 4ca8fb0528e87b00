//! What the drivers of the sensor heads need of the chip: the sensor's master clock, its converter at SPI1,
//! and ICG's edge.

use cortex_m::peripheral::DWT;
use embassy_stm32::gpio::{Output, OutputType, Pull};
use embassy_stm32::mode::Async;
use embassy_stm32::peripherals::{DMA2_CH0, DMA2_CH3, PA5, PA6, PE9, SPI1, TIM1};
use embassy_stm32::spi::mode::Master;
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::low_level::CountingMode;
use embassy_stm32::timer::simple_pwm::{PwmPin, SimplePwm};
use embassy_stm32::{Peri, pac};

use super::processor::cycles;
use super::{Interrupts, Laser};

/// The sensor's converter.
pub type Converter = Spi<'static, Async, Master>;

/// The sensor's master clock.
pub type MasterClock = SimplePwm<'static, TIM1>;

/// The wires to the sensor head beside clock and SPI.
pub struct Pins {
    /// Integration clear gate, idle high.
    pub icg: Output<'static>,
    /// Shift gate, idle low.
    pub sh: Output<'static>,
    /// The converter's chip select, idle high.
    pub chip_select: Output<'static>,
    /// The laser's switch.
    pub laser: Laser,
}

/// Starts the master clock.
pub fn start_master_clock(
    timer: Peri<'static, TIM1>,
    pin: Peri<'static, PE9>,
    hz: u32,
) -> MasterClock {
    let mut clock = SimplePwm::new(
        timer,
        Some(PwmPin::new(pin, OutputType::PushPull)),
        None,
        None,
        None,
        Hertz(hz),
        CountingMode::EdgeAlignedUp,
    );
    clock.ch1().set_duty_cycle_fraction(1, 2);
    clock.ch1().enable();
    clock
}

/// Connects the converter.
pub fn connect_converter(
    sclk_hz: u32,
    spi: Peri<'static, SPI1>,
    sclk: Peri<'static, PA5>,
    dout: Peri<'static, PA6>,
    sending: Peri<'static, DMA2_CH3>,
    receiving: Peri<'static, DMA2_CH0>,
) -> Converter {
    let mut config = spi::Config::default();
    config.frequency = Hertz(sclk_hz);
    config.mode = spi::MODE_3;
    // Words of an absent converter are then all ones, which no row is.
    config.miso_pull = Pull::Up;
    Spi::new_rxonly(spi, sclk, dout, sending, receiving, Interrupts, config)
}

/// When the master clock rose last, by the cycle counter. TIM1 counts at the core's speed, and its output
/// rises as it wraps.
pub fn master_clock_rose() -> u32 {
    let since = pac::TIM1.cnt().read().0 & 0xFFFF;
    cycles().wrapping_sub(since)
}

/// Waits until the cycle counter is `due`, and raises ICG: 3 to 6 instructions later, because ICG must rise
/// within 32 cycles. Returns the core cycles since the master clock rose, read after the edge.
pub fn raise_icg_at(due: u32) -> u32 {
    let since_master_clock_rose: u32;
    // SAFETY: reads two counters, and sets a pin that only the owner of the sensor head calls for.
    unsafe {
        core::arch::asm!(
            "2:",
            "ldr {counter}, [{cycles}]",
            "subs {counter}, {counter}, {due}",
            "bmi 2b",
            "str {icg}, [{port}]",
            "ldr {counter}, [{timer}]",
            cycles = in(reg) &raw const (*DWT::PTR).cyccnt,
            due = in(reg) due,
            icg = in(reg) 1 << 12,
            port = in(reg) pac::GPIOF.bsrr().as_ptr(),
            timer = in(reg) pac::TIM1.cnt().as_ptr(),
            counter = out(reg) since_master_clock_rose,
            options(nostack),
        );
    }
    since_master_clock_rose & 0xFFFF
}

/// Words that the read-out under way still has to bring: the count of the DMA stream that receives.
pub fn words_to_come() -> u32 {
    u32::from(pac::DMA2.st(0).ndtr().read().ndt())
}

/// Whether a word of the read-out under way came before DMA had fetched the one before. Clears the flag,
/// which embassy never reads (RM0090 section 28.3.10).
pub fn has_lost_a_word() -> bool {
    let is_lost = pac::SPI1.sr().read().ovr();
    if is_lost {
        pac::SPI1.dr().read();
        pac::SPI1.sr().read();
    }
    is_lost
}
