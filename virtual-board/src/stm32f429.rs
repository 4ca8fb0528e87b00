//! The processor: rigless's STM32F427 with faster models of TIM1, SPI1 and DMA2, a TIM4 that switches the
//! laser (module `laser`), a TIM5 whose speed can be chosen, and a flash interface whose times can be chosen.
//! SPI1 and DMA2 move a read-out's words in batches (module `burst`).
//!
//! TIM1 makes the sensor's master clock. rigless wakes a timer at each event of its counter: here five
//! million times a virtual second, which took eight times as long as all else together. No pin of the model
//! carries the clock, so these events have no effect. `LazyTimer` skips them. An access to a register first
//! catches up with all skipped events, so the firmware sees no difference. A read of the counter, which a
//! firmware may do for each row, is computed without them.
//!
//! TIM5 is the firmware's clock. It says when a row is due. `RowTimer` can make it count faster, so that the
//! same firmware takes more rows a second: see [`crate::row_rate`].

use std::num::NonZeroU32;
use std::sync::Arc;

use rigless::device::{
    Device, DeviceContext as Context, ErasedDevice, RegisterFile as Registers, RequestChange,
    ResetCause,
};
use rigless::edge::Pulse;
use rigless::mcu::Mcu;
use rigless::snapshot::store;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32f427::generated::tim1::{Register as Tim1, cr1, cr2, smcr};
use rigless::soc::stm32f427::generated::tim2::Register as Tim5;
use rigless::soc::stm32f427::generated::{dbg, flash};
use rigless::soc::stm32f427::peripherals::dma::Dma;
use rigless::soc::stm32f427::peripherals::gpio::Pin;
use rigless::soc::stm32f427::peripherals::rcc;
use rigless::soc::stm32f427::peripherals::spi::Spi;
use rigless::soc::stm32f427::peripherals::tim::{Advanced, Channel, Counter, General, Tim};
use rigless::soc::{Bus, Error, RegisterSpec};
use rigless::time::{EventId, VirtualNanos};

use crate::base::Nanos;
use crate::burst::{self, BurstDma, BurstSpi, DMA2, Timing};
use crate::flash_times::FlashTimes;
use crate::forward::forward;
use crate::laser::LaserTimer;
use crate::sensor_head::SharedHead;
use crate::trigger::Trigger;

/// The board's processor.
#[derive(Debug)]
pub struct Stm32f429 {
    /// rigless's model. Its own TIM1 (`advanced[0]`), SPI1 (`spi[0]`) and DMA2 (`dma[1]`) are not used.
    pub part: Stm32f427,
    head: SharedHead,
    spi1: BurstSpi,
    dma2: BurstDma,
    /// Whether each word of a read-out moves by itself, from the next read-out on, as rigless does. This is
    /// ten times slower than batches. Tests compare the batches with it.
    pub word_by_word: bool,
    tim1: LazyTimer,
    laser: LaserTimer,
    tim5: RowTimer,
    trigger: Trigger,
    flash: FlashTimes,
    /// The slots of [`MODELS`] on the bus.
    slots: [usize; MODELS.len()],
}

/// The supply of the processor.
pub(crate) const SUPPLY_MILLIVOLTS: NonZeroU32 = NonZeroU32::new(3300).expect("not zero");

/// The peripherals whose models here take the place of rigless's.
const MODELS: [&str; 7] = ["SPI1", "DMA2", "TIM1", "TIM4", "TIM5", "EXTI", "FLASH"];
const TIM1: usize = 2;
const EXTI: usize = 5;
const FLASH: usize = 6;

impl Stm32f429 {
    /// A processor whose TIM5 counts `row_timer_speed` times as fast as its clock.
    pub(crate) fn new(
        head: &SharedHead,
        row_timer_speed: f64,
        timing: Timing,
        flash: FlashTimes,
    ) -> Result<Self, Error> {
        let mut part = Stm32f427::new()?;
        // A debugger was there before: it told all timers to stop with the core. No reset clears that.
        let debug = part.bus().slot("DBG")?;
        let (registers, _) = part.bus_mut().drive(VirtualNanos(0), debug);
        registers.set(dbg::Register::DbgmcuApb1Fz, u64::from(u32::MAX));
        let mut slots = [0; MODELS.len()];
        for (slot, name) in slots.iter_mut().zip(MODELS) {
            *slot = part.bus().slot(name)?;
        }
        let (spi1, dma2) = burst::pair(take_dma2(&mut part), head, timing);
        Ok(Self {
            part,
            head: Arc::clone(head),
            spi1,
            dma2,
            word_by_word: false,
            tim1: LazyTimer::new(),
            laser: LaserTimer::new(head),
            tim5: RowTimer::new(row_timer_speed),
            trigger: Trigger::default(),
            flash,
            slots,
        })
    }

    /// SPI1, to which the converter is connected.
    pub fn converter_bus(&mut self) -> &mut Spi {
        &mut self.spi1.spi
    }

    /// The registers of SPI1.
    pub fn converter_registers(&mut self) -> &mut Registers {
        let slot = self.slots[0];
        self.part.bus_mut().drive(VirtualNanos(0), slot).0
    }

    pub(crate) fn drive_trigger(&mut self, high: bool, at: VirtualNanos) {
        let (registers, mut context) = self.part.bus_mut().drive(at, self.slots[EXTI]);
        self.trigger.drive(high, registers, &mut context);
    }

    /// Drives PC13 high or, by the board's own resistor, low.
    pub(crate) fn drive_button(&mut self, high: bool, at: VirtualNanos) {
        let pin = Pin::new(13).expect("one of sixteen");
        // Port C in rigless's order.
        self.part.drive_port(at, 2, |port, registers, context| {
            port.drive(pin, Some(high.into()), registers, context);
        });
    }

    /// Pauses SCLK after a word of each read-out to come, from 0, for some time in ns.
    pub(crate) fn pause_words(&mut self, gap: Option<(u64, Nanos)>) {
        self.spi1.timing(|timing| timing.gap = gap);
    }

    /// The number of words on SPI1 that two chips answered.
    pub(crate) fn contentions(&self) -> u32 {
        self.spi1.spi.contentions()
    }

    /// Sets the bits BOR_LEV of the option bytes.
    pub(crate) fn set_brown_out_level(&mut self, level: u64) {
        let (registers, _) = (self.part.bus_mut()).drive(VirtualNanos(0), self.slots[FLASH]);
        let options = registers.get(flash::Register::Optcr);
        registers.set(
            flash::Register::Optcr,
            flash::optcr::BOR_LEV.set(options, level),
        );
    }

    pub(crate) fn flash_interface(&self) -> &Registers {
        self.registers(FLASH)
    }

    fn registers(&self, model: usize) -> &Registers {
        self.part.bus().slots()[self.slots[model]].registers()
    }

    pub(crate) fn word_ends(&mut self, at: Nanos, now: Nanos) {
        let slot = self.slots[FLASH];
        let (_, mut context) = self.part.bus_mut().drive(VirtualNanos(now), slot);
        self.flash.word_ends(at, &mut context);
    }

    /// The part of the master clock's period that has passed since its rise; `None` if it does not run.
    pub(crate) fn part_of_master_clock(&self, now: Nanos) -> Option<f64> {
        let period = self.master_clock()?;
        let registers = self.registers(TIM1);
        Some(self.tim1.slept_count(registers, VirtualNanos(now))? as f64 / period as f64)
    }

    /// The period of TIM1's channel 1 in timer clocks; `None` if it gives no pulses.
    pub(crate) fn master_clock(&self) -> Option<u64> {
        let registers = self.registers(TIM1);
        let pulse = Channel::new(1).and_then(|channel| self.tim1.timer.pulse(channel, registers));
        let Pulse { width, period } = pulse?;
        (width.0 > 0 && width < period).then(|| period_clocks(registers))
    }
}

fn take_dma2(part: &mut Stm32f427) -> Dma {
    std::mem::replace(&mut part.dma[DMA2], Dma::new(&[], &[], true))
}

fn period_clocks(registers: &Registers) -> u64 {
    (registers.get(Tim1::Psc) + 1) * (registers.get(Tim1::Arr) + 1)
}

impl Mcu for Stm32f429 {
    fn bus(&self) -> &Bus {
        self.part.bus()
    }

    fn bus_mut(&mut self) -> &mut Bus {
        self.part.bus_mut()
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let model: &mut dyn ErasedDevice = match self.slots.iter().position(|&it| it == slot) {
            Some(0) => &mut self.spi1,
            Some(1) => {
                let has_one_chip = self.spi1.spi.peers().count() == 1;
                self.dma2.shortens = has_one_chip && !self.word_by_word;
                &mut self.dma2
            }
            Some(TIM1) => &mut self.tim1,
            Some(3) => &mut self.laser,
            Some(4) => &mut self.tim5,
            Some(EXTI) => &mut self.trigger,
            Some(FLASH) => &mut self.flash,
            _ => return self.part.split(slot),
        };
        (self.part.bus_mut(), Some(model))
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.part.reset(at, cause);
        self.tim1 = LazyTimer::new();
        self.laser = LaserTimer::new(&self.head);
        self.tim5 = RowTimer::new(self.tim5.speed);
        self.trigger = Trigger::default();
        self.flash = FlashTimes::new(self.flash.longer, SUPPLY_MILLIVOLTS);
        let timing = self.spi1.timing(|_| ());
        let (mut spi1, dma2) = burst::pair(take_dma2(&mut self.part), &self.head, timing);
        // The connected chips stay.
        spi1.spi.inherit(&mut self.spi1.spi);
        (self.spi1, self.dma2) = (spi1, dma2);
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.part.poll(now);
    }
}

// No snapshot of this board is ever taken, so a snapshot need not be complete.
store! { Stm32f429 {
    values: [],
    parts: [part],
    built: [head, spi1, dma2, word_by_word, tim1, laser, tim5, trigger, flash, slots],
} }

/// How long after a write all events are served, ns: some periods of a fast counter, because a new period or
/// duty takes effect when the counter wraps.
const AWAKE_AFTER_WRITE: u64 = 100_000;

/// A counter that needs more timer clocks than this to wrap is cheap, and does not sleep (100 us at 168 MHz).
const SLOW: u64 = 16_800;

/// TIM1. It skips its counter's events while they change only its own state.
#[derive(Debug)]
struct LazyTimer {
    timer: Tim<Advanced>,
    awake_until: u64,
}

impl LazyTimer {
    fn new() -> Self {
        // As rigless makes it.
        let timer =
            Tim::with_clock(rcc::HSI_HZ, Counter::Narrow).breaks_on("RCC", rcc::CLOCK_FAILURE);
        Self {
            timer,
            awake_until: 0,
        }
    }

    /// Whether events are skipped. They are not if one of them has an effect: an interrupt, a DMA request,
    /// the end of a single pulse, or another timer.
    fn sleeps(&self, registers: &Registers, now: VirtualNanos) -> bool {
        now.0 >= self.awake_until
            && period_clocks(registers) < SLOW
            && registers.get(Tim1::Dier) == 0
            && !cr1::OPM.is_set(registers.get(Tim1::Cr1))
            && cr2::MMS.get(registers.get(Tim1::Cr2)) == 0
            && smcr::SMS.get(registers.get(Tim1::Smcr)) == 0
    }

    /// The counter's value while its wraps are skipped; `None` if it cannot be computed. A counter that
    /// counts up then wraps at 2^16, so its value modulo a period that divides 2^16 is right.
    fn slept_count(&self, registers: &Registers, now: VirtualNanos) -> Option<u64> {
        let control = registers.get(Tim1::Cr1);
        let counts_up = !cr1::DIR.is_set(control) && cr1::CMS.get(control) == 0;
        let period = registers.get(Tim1::Arr) + 1;
        if !(counts_up && period.is_power_of_two()) {
            return None;
        }
        Device::peek(&self.timer, Tim1::Cnt, registers, now).map(|count| count % period)
    }
}

impl Device for LazyTimer {
    type Register = Tim1;

    fn on_event(&mut self, event: EventId, registers: &mut Registers, context: &mut Context<'_>) {
        if !self.sleeps(registers, context.now()) {
            Device::on_event(&mut self.timer, event, registers, context);
        }
    }

    fn read(&mut self, what: Tim1, at: &mut Registers, context: &mut Context<'_>) -> Option<u64> {
        if what == Tim1::Cnt
            && self.sleeps(at, context.now())
            && let Some(count) = self.slept_count(at, context.now())
        {
            return Some(count);
        }
        Device::read(&mut self.timer, what, at, context)
    }

    fn write(&mut self, what: Tim1, value: u64, at: &mut Registers, context: &mut Context<'_>) {
        self.awake_until = context.now().0 + AWAKE_AFTER_WRITE;
        Device::write(&mut self.timer, what, value, at, context);
    }

    forward! { Device for timer:
        fn peek(&self, register: Tim1, registers: &Registers, now: VirtualNanos) -> Option<u64>;
        fn layout(&self) -> &'static [RegisterSpec];
    }

    forward! { Device for timer:
        fn on_request(&mut self, change: RequestChange, at: &mut Registers, context: &mut Context<'_>);
        fn on_clock(&mut self, hz: u64, registers: &mut Registers, context: &mut Context<'_>);
        fn reset(&mut self);
        fn reset_line(&mut self, registers: &mut Registers, context: &mut Context<'_>);
    }
}

/// TIM5, which counts `speed` times as fast as its clock.
#[derive(Debug)]
struct RowTimer {
    timer: Tim<General>,
    speed: f64,
}

impl RowTimer {
    fn new(speed: f64) -> Self {
        Self {
            // As rigless makes it.
            timer: Tim::with_clock(faster(rcc::HSI_HZ, speed), Counter::Wide),
            speed,
        }
    }
}

fn faster(hz: u64, speed: f64) -> u64 {
    (hz as f64 * speed).round() as u64
}

impl Device for RowTimer {
    type Register = Tim5;

    fn on_clock(&mut self, hz: u64, registers: &mut Registers, context: &mut Context<'_>) {
        Device::on_clock(&mut self.timer, faster(hz, self.speed), registers, context);
    }

    forward! { Device for timer:
        fn peek(&self, register: Tim5, registers: &Registers, now: VirtualNanos) -> Option<u64>;
        fn layout(&self) -> &'static [RegisterSpec];
    }

    forward! { Device for timer:
        fn on_event(&mut self, event: EventId, registers: &mut Registers, context: &mut Context<'_>);
        fn read(&mut self, what: Tim5, at: &mut Registers, context: &mut Context<'_>) -> Option<u64>;
        fn write(&mut self, what: Tim5, value: u64, at: &mut Registers, context: &mut Context<'_>);
        fn on_request(&mut self, change: RequestChange, at: &mut Registers, context: &mut Context<'_>);
        fn reset(&mut self);
        fn reset_line(&mut self, registers: &mut Registers, context: &mut Context<'_>);
    }
}
