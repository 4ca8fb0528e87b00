//! The board: the processor, its crystal and supply, the sensor head and the serial line.

use std::num::{NonZeroU32, NonZeroU64};
use std::sync::{Arc, Mutex};

use anyhow::{Context, Result};
use rigless::cpu;
use rigless::machine::{Board, Target, armv7m};
use rigless::mcu::{Mcu, Operate};
use rigless::snapshot::store;

use crate::base::{CLOCK_HZ, Nanos};
use crate::burst::Timing;
use crate::flash::SharedFlash;
use crate::flash_times::{FlashTimes, SHORTEST_ERASE};
use crate::jumpers::Jumpers;
use crate::pins::{self, Pins};
use crate::serial_line::{FarEnd, SERIAL_PORT, SerialLine};
use crate::stm32f429::{SUPPLY_MILLIVOLTS, Stm32f429};
use crate::watched_core::{self, Watched};

/// Instructions that the emulated core executes in a second of virtual time. One for each clock, so that the
/// cycle counter (`DWT_CYCCNT`) counts instructions exactly. Silicon needs more clocks.
pub const INSTRUCTIONS_PER_SECOND: u64 = CLOCK_HZ;

/// The NUCLEO's 8 MHz clock from its ST-LINK, Hz.
const HSE_HZ: u64 = 8_000_000;
/// No 32 kHz crystal is used.
const LSE_HZ: u64 = 0;

/// A NUCLEO-F429ZI with the sensor head on its connectors.
#[derive(Debug)]
pub struct Nucleo {
    /// The processor with all its peripherals.
    pub processor: Stm32f429,
    watched: Watched,
    instructions_per_second: u64,
}
store! { Nucleo { values: [], parts: [processor], built: [watched, instructions_per_second] } }

/// What a board may be like.
#[derive(Clone, Debug)]
pub struct Conditions {
    /// The flash. If it is another board's, drop that board first: it could still write.
    pub flash: SharedFlash,
    /// Whether the words of a row take their time ([`crate::sensor_head`]).
    pub has_rate_limit: bool,
    /// Instructions that the core executes in a second. Silicon executes fewer than it has clocks, because
    /// it waits for flash. The environment variable `SLITRANGE_MIPS` changes the default, in millions:
    /// `SLITRANGE_MIPS=84 cargo test firmware::` runs all tests on a slower core.
    pub instructions_per_second: u64,
    /// Whether the ST-LINK gives its clock.
    pub has_clock: bool,
    /// Whether the option bytes have the brown-out reset on, at level 3, until the next reset.
    pub has_brown_out_reset: bool,
    /// How many times as fast as its clock TIM5 counts, the firmware's clock.
    pub row_timer_speed: f64,
    /// The most core cycles from the end of a word until DMA has counted it. Each word takes a random part.
    pub most_dma_latency: u64,
    /// The clock of the watchdog in Hz, 17,000 to 47,000 (data sheet of the STM32F429, LSI).
    pub watchdog_hz: u64,
    /// How long a word of flash takes to program, ns: 16 us, at most 100 us (data sheet of the STM32F429).
    pub flash_word: Nanos,
    /// How long a sector of flash takes to erase, ns: 400 ms or more, at most 800 ms (the same data sheet).
    pub flash_erase: Nanos,
    /// The wires of `cargo silicon-check`, which take the converter's place.
    pub jumpers: Option<Jumpers>,
}

impl Default for Conditions {
    fn default() -> Self {
        Self {
            flash: SharedFlash::default(),
            has_rate_limit: true,
            instructions_per_second: default_speed(),
            has_clock: true,
            has_brown_out_reset: false,
            row_timer_speed: 1.0,
            most_dma_latency: 40,
            watchdog_hz: 32_000,
            flash_word: 16_000,
            flash_erase: SHORTEST_ERASE,
            jumpers: None,
        }
    }
}

/// [`INSTRUCTIONS_PER_SECOND`], or what `SLITRANGE_MIPS` says.
///
/// # Panics
/// The variable is not a number from 1 to 168.
fn default_speed() -> u64 {
    let Ok(millions) = std::env::var("SLITRANGE_MIPS") else {
        return INSTRUCTIONS_PER_SECOND;
    };
    let millions: Option<u64> = millions.parse().ok().filter(|it| (1..=168).contains(it));
    1_000_000 * millions.expect("SLITRANGE_MIPS is 1 to 168")
}

impl Nucleo {
    pub(crate) fn new(
        pins: &Arc<Pins>,
        line: Arc<Mutex<SerialLine>>,
        watched: Watched,
        conditions: &Conditions,
    ) -> Result<Self> {
        let timing = Timing {
            most_latency: conditions.most_dma_latency,
            gap: None,
        };
        let longer = conditions.flash_erase.saturating_sub(SHORTEST_ERASE);
        let flash = FlashTimes::new(longer, SUPPLY_MILLIVOLTS);
        let mut processor = Stm32f429::new(&pins.head, conditions.row_timer_speed, timing, flash)
            .context("putting the emulated STM32F427 together")?;
        processor.part.rcc.attach_crystals(HSE_HZ, LSE_HZ);
        processor.part.rcc.calibrate_lsi(conditions.watchdog_hz);
        processor.part.set_supply(SUPPLY_MILLIVOLTS.get());
        if conditions.has_brown_out_reset {
            processor.set_brown_out_level(0);
        }
        pins::attach(&mut processor, pins);
        pins::attach_driver(&mut processor, Arc::clone(&line));
        processor.part.usart[SERIAL_PORT].attach(FarEnd { line });
        Ok(Self {
            processor,
            watched,
            instructions_per_second: conditions.instructions_per_second,
        })
    }
}

impl Board for Nucleo {
    fn name(&self) -> &'static str {
        "nucleo-f429zi"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["stm32f427"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.processor)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let speed = NonZeroU64::new(self.instructions_per_second);
        let lines = u32::from(Operate::cpu(&self.processor).interrupt_lines);
        let mut spec = armv7m::Core {
            variant: armv7m::Variant::M4,
            clock_hz: NonZeroU64::new(CLOCK_HZ).expect("not zero"),
            interrupt_lines: NonZeroU32::new(lines).expect("the part has interrupt lines"),
            priority_bits: 4,
            // SysTick's other clock is HCLK / 8 (RM0090 section 6.2).
            refclk_divider: NonZeroU32::new(8).expect("8 is not 0"),
            instructions_per_second: speed.expect("a rate is not zero"),
            boot: "flash",
        }
        .spec_with_parts(
            &cpu::armv7m::windows(Mcu::bus(&self.processor)),
            armv7m::Fpu::FpV4Sp,
            armv7m::MpuRegions::Eight,
        );
        watched_core::wrap(&mut spec, self.watched.clone());
        vec![Target::new("stm32f427", &mut self.processor, spec)]
    }
}
