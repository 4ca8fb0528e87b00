//! The NUCLEO-F429ZI: clocks, pins, interrupts and their priorities. Only this folder and the drivers of the
//! sensor heads know the chip.
//!
//! | pin | | to |
//! |---|---|---|
//! | PE9 | TIM1 channel 1 | sensor, fM |
//! | PF12 | output | sensor, ICG |
//! | PF13 | output | sensor, SH |
//! | PD14 | output | converter, chip select |
//! | PD15 | TIM4 channel 4 | laser |
//! | PA5, PA6 | SPI1 | converter, SCLK, DOUT |
//! | PE11 (D5) | output, low after a reset | the switching output of the setting `limits` |
//! | PD8, PD9 | USART3 | ST-LINK's serial port, TX, RX |
//! | PA3 | input, EXTI3, pulled down | the trigger: a rising edge starts a frame (setting `trigger pin`) |
//! | PC13 | input at the start, pulled down | the board's blue button: high starts with `plain on` |
//! | PD12 | output | an RS-485 driver: high while the sensor sends |
//! | PB0, PB7, PB14 | outputs | the board's lights LD1 to LD3 |
//! | PA12 | output, low | nothing (see `keep_pa12_low`) |
//!
//! # Priorities
//!
//! From the most urgent down, each a level above the next:
//! 1. DMA and TIM5 (the clock of embassy-time). Their handlers only wake tasks, and say when a row is due.
//! 2. UART4, which carries the urgent executor: only the handlers above interrupt it from the tick to the
//!    pulses.
//! 3. USART3, for each character that the sensor sends. DMA takes those that come, however long the pulses
//!    last. TIM4, which lets the laser's pulse go on.
//! 4. FLASH, after each word of a save. It only wakes the task that saves, which has no deadline. EXTI3, the
//!    trigger's edge, which notes how many pulses were given before it.
//! 5. Thread mode: computation and text. Whatever it does, rows are taken on time.

mod clock;
mod core_coupled_memory;
mod flash;
pub mod laser;
mod last_stop;
mod lights;
pub mod processor;
mod sensor_wires;
mod serial;
mod start_cause;
mod trigger_pin;
mod urgent;
mod watchdog;

use embassy_stm32::flash::Flash;
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::{bind_interrupts, dma, interrupt, peripherals};
use slitrange_device::protocol::info::{BrownOut, Clock};
use slitrange_device::protocol::status::StartCause;

pub use flash::CalibrationFlash;
pub use laser::Laser;
pub use lights::Lights;
pub use processor::{cycles, cycles_in_ns, reset, wait_until};
pub use sensor_wires::{
    Converter, MasterClock, Pins, has_lost_a_word, master_clock_rose, raise_icg_at, words_to_come,
};
pub use serial::{Lost, Receiver, SerialPort, Transmitter};
pub use trigger_pin::listen_to_trigger;
pub use urgent::start_urgent_executor;
pub use watchdog::Watchdog;

use crate::counters::COUNTERS;

/// The board's name.
pub const NAME: &str = "NUCLEO-F429ZI";

bind_interrupts!(struct Interrupts {
    DMA1_STREAM1 => dma::InterruptHandler<peripherals::DMA1_CH1>;
    DMA2_STREAM0 => dma::InterruptHandler<peripherals::DMA2_CH0>;
    DMA2_STREAM3 => dma::InterruptHandler<peripherals::DMA2_CH3>;
    FLASH => embassy_stm32::flash::InterruptHandler;
});

/// The switching output.
pub type Switch = Output<'static>;

/// The board, ready.
pub struct Board {
    /// The wires to the sensor head: the converter, the other pins at their rest, and the running clock.
    pub sensor: (Converter, Pins, MasterClock),
    /// The serial line.
    pub serial: SerialPort,
    /// The switching output of the setting `limits`.
    pub switch: Switch,
    /// Where the store keeps the configuration.
    pub flash: CalibrationFlash,
    /// The watchdog. It runs already: if the start hangs before the first pet, the board starts again.
    pub watchdog: Watchdog,
    /// What made the board start.
    pub started_by: StartCause,
    /// Whether the button was held: the way back from a format, a rate or an address that nobody knows.
    pub starts_plain: bool,
    /// What times the rows and the serial line.
    pub clock: Clock,
    /// What the chip does while its supply is too low.
    pub brown_out: BrownOut,
    /// What stopped the firmware last, since the power came.
    pub last_stop: Option<&'static str>,
    /// LD1 to LD3.
    pub lights: Lights,
}

/// Sets up clocks and peripherals, with the sensor head's two clocks. Call once, first.
pub fn init(master_clock_hz: u32, sclk_hz: u32) -> Board {
    watchdog::start();
    processor::set_up();
    let clock = clock::start();
    let p = clock::init_chip(clock);
    clock::enable_flash_accelerator();
    clock::watch(clock);
    let started_by = start_cause::start_cause();
    let (stops, last_stop) = last_stop::read(started_by);
    COUNTERS.stops.set(stops.into());
    defmt::info!(
        "slitrange started by {}",
        defmt::Display2Format(&started_by)
    );

    for (interrupt, priority) in [
        (interrupt::TIM5, Priority::P1),
        (interrupt::UART4, Priority::P2),
        (serial::INTERRUPT, Priority::P3),
        (interrupt::TIM4, Priority::P3),
        (interrupt::FLASH, Priority::P4),
        (interrupt::EXTI3, Priority::P4),
    ] {
        interrupt.set_priority(priority);
    }
    let watchdog = watchdog::set_timeout(p.IWDG);
    let master_clock = sensor_wires::start_master_clock(p.TIM1, p.PE9, master_clock_hz);
    let converter =
        sensor_wires::connect_converter(sclk_hz, p.SPI1, p.PA5, p.PA6, p.DMA2_CH3, p.DMA2_CH0);
    let laser = Laser::new(p.TIM4, p.PD15);
    let pins = Pins {
        icg: Output::new(p.PF12, Level::High, Speed::VeryHigh),
        sh: Output::new(p.PF13, Level::Low, Speed::VeryHigh),
        chip_select: Output::new(p.PD14, Level::High, Speed::VeryHigh),
        laser,
    };
    let serial = serial::open(p.USART3, p.PD9, p.PD8, p.PD12, p.DMA1_CH1);
    trigger_pin::watch_trigger(p.PA3);
    flash::keep_pa12_low(p.PA12);
    let flash = Flash::new(p.FLASH, Interrupts).into_regions();

    Board {
        sensor: (converter, pins, master_clock),
        serial,
        switch: Output::new(p.PE11, Level::Low, Speed::Low),
        flash: CalibrationFlash::new(flash.bank2_region1),
        watchdog,
        started_by,
        starts_plain: Input::new(p.PC13, Pull::Down).is_high(),
        clock,
        brown_out: start_cause::brown_out(),
        last_stop,
        lights: Lights::new(p.PB0, p.PB7, p.PB14),
    }
}
