//! The jumper wires: three timers capture the edges that the firmware's driver gives.
//!
//! | from | to | what captures it |
//! |---|---|---|
//! | PE9, fM (D6) | PC7 (D21) | TIM8 channel 2, both edges one after the other, between the rows |
//! | PF12, ICG (D8) | PC6 (D16) | TIM8 channel 1, rises; channel 2, falls |
//! | PF13, SH (D7) | PC8 (D43) | TIM8 channel 3, rises; channel 4, falls |
//! | PA5, SCLK (D13) | PA0 (D32) | TIM2 channel 1: its first rise starts the counter |
//! | PD14, chip select (D10) | PB5 (D22) | TIM3 channel 2, falls; channel 1, rises |
//! | PB13 (D18) | PA6, MISO (D12) | nothing: PB13 is driven low, high, by TIM1 as fM inverted, or not |
//!
//! TIM8 counts the core's cycles, and wraps after 65,536 of them: a multiple of fM's period of 64. So fM's
//! edges always come at the same counts modulo 64, which are measured once, and the count at which ICG rises
//! says how long after fM it rose.
//!
//! TIM3 counts TIM2's captures, and so SCLK's rises. A row has 59,104, so 16 bits are enough.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::pac;
use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::gpio::vals::{Moder, Ospeedr};
use embassy_stm32::pac::timer::vals::{CcmrInputCcs, Mms, Sms, Ts};

use crate::board;
use crate::heads::CYCLES_A_MASTER_CLOCK;

/// The alternate functions: TIM8 on port C, TIM2 on PA0, TIM3 on PB5 (STM32F429 data sheet, table 12).
const TIM8_FUNCTION: u8 = 3;
const TIM2_FUNCTION: u8 = 1;
const TIM3_FUNCTION: u8 = 2;

/// Also the complement of TIM1's channel 1, fM, by this function.
const MISO_DRIVER: usize = 13;
const TIM1_FUNCTION: u8 = 1;

/// TIM2 counts at 84 MHz: every second cycle of the core.
pub const TICKS_A_BIT: u32 = 8;

/// An input's own channel, and the other channel of its pair.
const OWN: CcmrInputCcs = CcmrInputCcs::TI4;
const OTHER: CcmrInputCcs = CcmrInputCcs::TI3;

/// The least and the greatest of the numbers that came.
pub struct Range {
    least: AtomicU32,
    greatest: AtomicU32,
}

impl Range {
    const fn new() -> Self {
        Self {
            least: AtomicU32::new(u32::MAX),
            greatest: AtomicU32::new(0),
        }
    }

    fn reset(&self) {
        self.least.store(u32::MAX, Ordering::Relaxed);
        self.greatest.store(0, Ordering::Relaxed);
    }

    fn take(&self, number: u32) {
        self.least.fetch_min(number, Ordering::Relaxed);
        self.greatest.fetch_max(number, Ordering::Relaxed);
    }

    pub fn get(&self) -> (u32, u32) {
        (
            self.least.load(Ordering::Relaxed),
            self.greatest.load(Ordering::Relaxed),
        )
    }
}

/// What the wires showed since [`start`].
pub struct Seen {
    /// From the fall of SH to the rise of ICG, core cycles.
    pub t1: Range,
    /// From the fall of ICG to the rise of SH, core cycles.
    pub t2: Range,
    /// From the rise of SH to its fall, core cycles.
    pub t3: Range,
    /// From the rise of fM to the rise of ICG, core cycles, modulo fM's period.
    pub t4: Range,
    pub pulses: AtomicU32,
    /// Rises of ICG before which one of the other three edges was missing.
    pub incomplete: AtomicU32,
    /// Rises of ICG before which an edge came twice.
    pub doubled: AtomicU32,
    /// SCLK's rises while chip select is low.
    pub edges: Range,
    /// From SCLK's first rise to its last, in steps of two core cycles.
    pub duration: Range,
    pub rows: AtomicU32,
}

pub static SEEN: Seen = Seen {
    t1: Range::new(),
    t2: Range::new(),
    t3: Range::new(),
    t4: Range::new(),
    pulses: AtomicU32::new(0),
    incomplete: AtomicU32::new(0),
    doubled: AtomicU32::new(0),
    edges: Range::new(),
    duration: Range::new(),
    rows: AtomicU32::new(0),
};

/// The count, modulo fM's period, at which fM rises.
static MASTER_CLOCK_RISES: AtomicU32 = AtomicU32::new(0);

/// Set until the first interrupt after [`start`], whose pulse or row may have begun before.
static SKIPS_PULSE: AtomicBool = AtomicBool::new(true);
static SKIPS_ROW: AtomicBool = AtomicBool::new(true);

/// Sets the timers and their pins up. The interrupts are below all of the firmware's.
pub fn init() {
    pac::RCC.apb2enr().modify(|enable| enable.set_tim8en(true));
    pac::RCC.apb1enr().modify(|enable| {
        enable.set_tim2en(true);
        enable.set_tim3en(true);
    });
    for pin in [6, 7, 8] {
        connect(pac::GPIOC, pin, TIM8_FUNCTION);
    }
    connect(pac::GPIOA, 0, TIM2_FUNCTION);
    connect(pac::GPIOB, 5, TIM3_FUNCTION);

    let timer = pac::TIM8;
    timer.arr().write(|reload| reload.set_arr(0xFFFF));
    timer.ccmr_input(0).write(|mode| mode.set_ccs(0, OWN));
    timer.ccmr_input(1).write(|mode| {
        mode.set_ccs(0, OWN);
        mode.set_ccs(1, OTHER);
    });
    timer.cr1().modify(|control| control.set_cen(true));

    let timer = pac::TIM2;
    timer.arr().write_value(u32::MAX);
    timer.ccmr_input(0).write(|mode| mode.set_ccs(0, OWN));
    timer.ccer().write(|enable| enable.set_cce(0, true));
    // Each capture of channel 1 is a pulse for TIM3.
    timer
        .cr2()
        .write(|control| control.set_mms(Mms::COMPARE_PULSE));
    timer.smcr().write(|slave| {
        slave.set_ts(Ts::TI1FP1);
        slave.set_sms(Sms::TRIGGER_MODE);
    });

    let timer = pac::TIM3;
    timer.arr().write(|reload| reload.set_arr(0xFFFF));
    timer.ccmr_input(0).write(|mode| {
        mode.set_ccs(0, OTHER);
        mode.set_ccs(1, OWN);
    });
    timer.ccer().write(|enable| {
        enable.set_cce(0, true);
        enable.set_cce(1, true);
        enable.set_ccp(1, true);
    });
    // RM0090 table 98: TIM3's internal trigger 1 is TIM2.
    timer.smcr().write(|slave| {
        slave.set_ts(Ts::ITR1);
        slave.set_sms(Sms::EXT_CLOCK_MODE);
    });
    timer.cr1().modify(|control| control.set_cen(true));

    for interrupt in [interrupt::TIM8_CC, interrupt::TIM3] {
        interrupt.set_priority(Priority::P5);
        // SAFETY: the handlers below need nothing that is not ready.
        unsafe { interrupt.enable() };
    }
}

fn connect(port: Gpio, pin: usize, function: u8) {
    port.afr(pin / 8)
        .modify(|functions| functions.set_afr(pin % 8, function));
    port.moder()
        .modify(|modes| modes.set_moder(pin, Moder::ALTERNATE));
}

pub fn drive_miso(level: Option<bool>) {
    let port = pac::GPIOB;
    let mode = match level {
        Some(_) => Moder::OUTPUT,
        None => Moder::INPUT,
    };
    port.bsrr().write(|pins| match level {
        Some(false) => pins.set_br(MISO_DRIVER, true),
        _ => pins.set_bs(MISO_DRIVER, true),
    });
    port.ospeedr()
        .modify(|speeds| speeds.set_ospeedr(MISO_DRIVER, Ospeedr::LOW_SPEED));
    port.moder()
        .modify(|modes| modes.set_moder(MISO_DRIVER, mode));
}

/// SCLK has four periods in one of fM, so each word is then two ones and two zeros again and again.
pub fn drive_miso_by_master_clock() {
    pac::TIM1.ccer().modify(|enable| enable.set_ccne(0, true));
    connect(pac::GPIOB, MISO_DRIVER, TIM1_FUNCTION);
}

pub struct MasterClock {
    /// By how many cycles its rises came earlier or later than multiples of 64 cycles.
    pub spread: u32,
    /// For how long it is high, core cycles.
    pub high: (u32, u32),
}

/// Measures fM at the wire. `None`: no edge came.
pub fn measure_master_clock() -> Option<MasterClock> {
    const EDGES: u32 = 64;
    let period = CYCLES_A_MASTER_CLOCK;
    let mut first = None;
    let (mut spread, mut high) = (0, (u32::MAX, 0));
    for _ in 0..EDGES {
        let rise = edge_of_master_clock(false)?;
        let fall = edge_of_master_clock(true)?;
        let off = rise.wrapping_sub(*first.get_or_insert(rise)) % period;
        spread = spread.max(off.min(period - off));
        let pulse = fall.wrapping_sub(rise) % period;
        high = (high.0.min(pulse), high.1.max(pulse));
    }
    MASTER_CLOCK_RISES.store(first? % period, Ordering::Relaxed);
    Some(MasterClock { spread, high })
}

/// Captures an edge of fM. `None`: none came within 100 us.
fn edge_of_master_clock(falls: bool) -> Option<u32> {
    let timer = pac::TIM8;
    timer.ccer().modify(|enable| enable.set_cce(1, false));
    timer.ccmr_input(0).modify(|mode| mode.set_ccs(1, OWN));
    timer.ccer().modify(|enable| enable.set_ccp(1, falls));
    timer.ccer().modify(|enable| enable.set_cce(1, true));
    timer.sr().write(|flags| {
        flags.0 = u32::MAX;
        flags.set_ccif(1, false);
    });
    let start = board::cycles();
    while board::cycles().wrapping_sub(start) < board::cycles_in_ns(100_000) {
        if timer.sr().read().ccif(1) {
            return Some(timer.ccr(1).read().ccr().into());
        }
    }
    None
}

/// Begins to note what the wires show.
pub fn start() {
    let seen = &SEEN;
    for range in [
        &seen.t1,
        &seen.t2,
        &seen.t3,
        &seen.t4,
        &seen.edges,
        &seen.duration,
    ] {
        range.reset();
    }
    for counter in [&seen.pulses, &seen.incomplete, &seen.doubled, &seen.rows] {
        counter.store(0, Ordering::Relaxed);
    }
    SKIPS_PULSE.store(true, Ordering::Relaxed);
    SKIPS_ROW.store(true, Ordering::Relaxed);
    let timer = pac::TIM8;
    timer.ccer().write(|_| ());
    timer.ccmr_input(0).modify(|mode| mode.set_ccs(1, OTHER));
    timer.ccer().write(|enable| {
        for channel in 0..4 {
            enable.set_cce(channel, true);
        }
        enable.set_ccp(1, true);
        enable.set_ccp(3, true);
    });
    timer.sr().write(|_| ());
    timer.dier().write(|enable| enable.set_ccie(0, true));
    pac::TIM3.sr().write(|_| ());
    pac::TIM3.dier().write(|enable| enable.set_ccie(0, true));
}

pub fn stop() {
    pac::TIM8.dier().write(|_| ());
    pac::TIM3.dier().write(|_| ());
}

/// ICG rose: all edges of a pulse are captured.
#[interrupt]
fn TIM8_CC() {
    let timer = pac::TIM8;
    let flags = timer.sr().read();
    let [icg_rose, icg_fell, sh_rose, sh_fell] =
        [0, 1, 2, 3].map(|channel| u32::from(timer.ccr(channel).read().ccr()));
    timer.sr().write(|_| ());
    if SKIPS_PULSE.swap(false, Ordering::Relaxed) {
        return;
    }
    SEEN.pulses.fetch_add(1, Ordering::Relaxed);
    if (0..4).any(|channel| !flags.ccif(channel)) {
        SEEN.incomplete.fetch_add(1, Ordering::Relaxed);
        return;
    }
    if (0..4).any(|channel| flags.ccof(channel)) {
        SEEN.doubled.fetch_add(1, Ordering::Relaxed);
        return;
    }
    let since = |end: u32, start: u32| end.wrapping_sub(start) & 0xFFFF;
    SEEN.t1.take(since(icg_rose, sh_fell));
    SEEN.t2.take(since(sh_rose, icg_fell));
    SEEN.t3.take(since(sh_fell, sh_rose));
    let master_clock_rises = MASTER_CLOCK_RISES.load(Ordering::Relaxed);
    SEEN.t4
        .take(icg_rose.wrapping_sub(master_clock_rises) % CYCLES_A_MASTER_CLOCK);
}

/// Chip select rose: the row has ended.
#[interrupt]
fn TIM3() {
    let timer = pac::TIM3;
    let [rose, fell] = [0, 1].map(|channel| u32::from(timer.ccr(channel).read().ccr()));
    let duration = pac::TIM2.ccr(0).read();
    timer.sr().write(|_| ());
    // Until SCLK's next rise.
    pac::TIM2.cr1().modify(|control| control.set_cen(false));
    pac::TIM2.cnt().write_value(0);
    if SKIPS_ROW.swap(false, Ordering::Relaxed) {
        return;
    }
    SEEN.rows.fetch_add(1, Ordering::Relaxed);
    SEEN.edges.take(rose.wrapping_sub(fell) & 0xFFFF);
    SEEN.duration.take(duration);
}
