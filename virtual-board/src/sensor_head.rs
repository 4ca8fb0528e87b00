//! The sensor head: a TCD1304DG line sensor and a 12-bit converter (TI ADC122S101, continuous conversion), as
//! seen from the pins that the firmware drives.
//!
//! | pin | what |
//! |---|---|
//! | PE9 (TIM1 channel 1) | fM, the sensor's master clock |
//! | PF12 | ICG, low while the charge is moved and high while it is read out |
//! | PF13 | SH, high while the photodiodes hand over their charge |
//! | PD14 | the converter's chip select, active low |
//! | PA5, PA6 (SPI1) | the converter's SCLK and DOUT; its DIN is at ground |
//! | PD15 (TIM4 channel 4) | the laser, on while high |
//!
//! [`SensorHead`] is the state machine. It does not need the emulator: it takes edges and words with their
//! instants, and gives words. The module `pins` connects it to the emulated processor.
//!
//! **Exposure.** SH high moves the photodiodes' charge to the shift register, so an exposure lasts from the
//! end of one SH pulse to the end of the next. The exposure that ends while ICG is low is read out.
//!
//! **Read-out.** From ICG's rise at t0, pixel n is at the output from t0 + 4n / fM to t0 + 4(n + 1) / fM;
//! outside a read-out the output is unlit. The converter is not synchronised with the pixels: it holds its
//! input 3.5 SCLK after the start of each word. So the pixel that a word shows depends on when the firmware
//! starts the burst.
//!
//! **Without a rate limit.** If `Conditions::has_rate_limit` is false, the words after word 3 come all at
//! once. This tests which rate of rows the firmware sustains. Each word shows the pixel that it
//! would show at the clocks' speed, and all limits stay.
//!
//! **Polarity.** The TCD1304's output falls with light, so a word is 4095 minus the counts of light.

use std::collections::VecDeque;
use std::fmt;
use std::ops::{Range, RangeInclusive};
use std::sync::{Arc, Mutex};

use crate::base::Nanos;
use crate::random;
use crate::violations::Violations;

pub mod limits;

pub use limits::PIXELS;
pub use rigless::device::Level;

/// Full scale of the 12-bit converter, counts.
pub const FULL_SCALE: u16 = 4095;

/// How many of the last rows are kept, unless `keeps_all_rows` keeps all.
pub const ROWS_KEPT: usize = 64;

/// How many pulses of the laser are kept. No exposure has more.
const PULSES_KEPT: usize = 64;

/// The time in which the light of a row was gathered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Exposure {
    /// The end of the SH pulse before; 0 for the first exposure.
    pub start: Nanos,
    /// The end of the SH pulse that handed the charge over.
    pub end: Nanos,
    /// For how long the laser was on meanwhile, ns.
    pub laser: Nanos,
}

impl Exposure {
    /// How long it lasted, ns.
    pub fn duration(&self) -> Nanos {
        self.end - self.start
    }
}

/// Gives the [`PIXELS`] outputs of a row in counts (0 to [`FULL_SCALE`]): more light is more counts, with
/// black level and noise, not yet quantised. Called at the begin of each read-out.
pub type LightSource = Box<dyn FnMut(&Exposure) -> Vec<f32> + Send>;

/// A row that was read out.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// 0 for the first row since power-on.
    pub number: u64,
    /// When its light was gathered.
    pub exposure: Exposure,
    /// ICG's rise, t0.
    pub read_out: Nanos,
    /// The end of its last word.
    pub last_word: Nanos,
    /// How many words were sent before the one that shows pixel 0: word `n + lead_in` shows pixel n. Negative
    /// if the burst came so late that the first pixels were missed.
    pub lead_in: i64,
    /// The part of a pixel's time after which the converter held it, 0 to 1: least and greatest over the row.
    pub phase: (f64, f64),
    /// [`PIXELS`] counts by pixel, light positive; a pixel that no word shows is unlit.
    pub counts: Vec<u16>,
    /// The words as they were sent: [`FULL_SCALE`] minus the counts, in the order of the burst.
    pub words: Vec<u16>,
}

/// What happens at the head's wires.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Edge {
    /// ICG has this level from now on.
    Icg(Level),
    /// SH has this level from now on.
    Sh(Level),
    /// Chip select has this level from now on.
    ChipSelect(Level),
    /// fM rose. Known at each rise of ICG only.
    MasterClockRose,
    /// The last bit of a word was sent.
    WordEnded,
}

/// The clocks that the processor gives the head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clocks {
    /// fM, Hz; 0 if it does not run.
    pub master_hz: f64,
    /// SCLK, Hz.
    pub serial_hz: f64,
}

impl Clocks {
    /// How long a pixel stays at the sensor's output, ns.
    fn pixel_time(&self) -> f64 {
        limits::MASTER_CLOCKS_PER_PIXEL * 1e9 / self.master_hz
    }

    /// How long a word takes, ns; 0 if SCLK does not run.
    fn word_time(&self) -> f64 {
        match self.serial_hz {
            hz if hz > 0.0 => f64::from(limits::WORD_BITS) * 1e9 / hz,
            _ => 0.0,
        }
    }
}

/// What SPI1 reads if the converter is not connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OpenLine {
    /// Ones: the pull-up of the processor's pin.
    Ones,
    /// Zeros: a short to ground.
    Zeros,
    /// Random bits: no pull-up, and a line that catches noise.
    Noise,
    /// No pull-up, and a line that catches the mains: zeros for 10 ms, then ones for 10 ms.
    Mains,
    /// A clock of a quarter of SCLK's rate.
    Clock,
    /// Such a clock, of which a bit slips each millisecond.
    SlippingClock,
    /// Such a clock, of which the last bit of each word is as the one before.
    StaleClock,
}

impl OpenLine {
    /// All kinds without a clock.
    pub const ALL: [Self; 4] = [Self::Ones, Self::Zeros, Self::Noise, Self::Mains];

    fn word(self, now: Nanos) -> u16 {
        match self {
            Self::Ones => u16::MAX,
            Self::Zeros => 0,
            Self::Noise => random::mixed(now) as u16,
            Self::Mains => (now / 10_000_000 % 2) as u16 * u16::MAX,
            Self::Clock => 0x6666,
            Self::SlippingClock => 0x6666_u16.rotate_left((now / 1_000_000 % 4) as u32),
            Self::StaleClock => 0x6667,
        }
    }
}

/// A pin, with the times of its last rise and fall.
#[derive(Debug)]
struct Pin {
    level: Level,
    rose: Option<Nanos>,
    fell: Option<Nanos>,
}

impl Pin {
    const fn resting(level: Level) -> Self {
        Self {
            level,
            rose: None,
            fell: None,
        }
    }

    /// Sets the level. True if this is an edge.
    fn moves(&mut self, level: Level, now: Nanos) -> bool {
        if self.level == level {
            return false;
        }
        self.level = level;
        match level {
            Level::High => self.rose = Some(now),
            Level::Low => self.fell = Some(now),
        }
        true
    }
}

#[derive(Debug)]
struct ReadOut {
    exposure: Exposure,
    began: Nanos,
    counts: Vec<u16>,
    /// True if a fault of the clocks was already reported for this row.
    clocks_reported: bool,
}

/// The words while chip select is low.
#[derive(Debug, Default)]
struct Burst {
    words: Vec<u16>,
    counts: Vec<Option<u16>>,
    /// The pixel that word 0 of the burst shows. Known when the first word shows a pixel.
    first_pixel: Option<i64>,
    phase: Option<(f64, f64)>,
    odd_bits: Option<u8>,
    unclocked: bool,
    first_word: Nanos,
    last_word: Nanos,
}

/// The head, shared by its pins and the code that runs the board. A light source that panics ends the run,
/// but the head's rows can still be read.
pub(crate) type SharedHead = Arc<Mutex<SensorHead>>;

/// The sensor head.
pub struct SensorHead {
    /// Lights the sensor from the next read-out on.
    pub light: LightSource,
    icg: Pin,
    sh: Pin,
    chip_select: Pin,
    clocks: Option<Clocks>,
    /// The exposure whose charge was moved while ICG is low.
    handed_over: Option<Exposure>,
    read_out: Option<ReadOut>,
    burst: Option<Burst>,
    /// When the laser is on: the last pulses, [`PULSES_KEPT`] of them.
    laser: VecDeque<Range<Nanos>>,
    /// For how long the laser was on in the pulses before these.
    laser_before: Nanos,
    /// Whether the laser's pin is the timer's output. Otherwise the laser is off.
    pub(crate) laser_pin: bool,
    /// What the output shows outside a read-out, counts of light: the last row's shielded pixels.
    unlit: u16,
    rows: VecDeque<Row>,
    /// How many rows were read since power-on.
    pub row_count: u64,
    /// Whether all rows are kept from now on (15 KB each).
    pub keeps_all_rows: bool,
    pub(crate) has_rate_limit: bool,
    edges: Option<Vec<(Nanos, Edge)>>,
    /// What SPI1 reads from the next word on; `None` if the converter is connected.
    pub open_line: Option<OpenLine>,
    wiring_checked: bool,
    /// The firmware's violations since power-on.
    pub violations: Violations,
}

impl fmt::Debug for SensorHead {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("SensorHead")
            .field("row_count", &self.row_count)
            .field("violations", &self.violations)
            .finish_non_exhaustive()
    }
}

impl SensorHead {
    /// A sensor head at power-on, lit by `light`.
    pub fn new(light: LightSource) -> Self {
        Self {
            light,
            icg: Pin::resting(Level::High),
            sh: Pin::resting(Level::Low),
            chip_select: Pin::resting(Level::High),
            clocks: None,
            handed_over: None,
            read_out: None,
            burst: None,
            laser: VecDeque::new(),
            laser_before: 0,
            laser_pin: false,
            unlit: 0,
            rows: VecDeque::new(),
            row_count: 0,
            keeps_all_rows: false,
            has_rate_limit: true,
            edges: None,
            open_line: None,
            wiring_checked: false,
            violations: Violations::default(),
        }
    }

    /// The rows that are kept, oldest first: the last [`ROWS_KEPT`], or all.
    pub fn rows(&self) -> impl DoubleEndedIterator<Item = &Row> + ExactSizeIterator {
        self.rows.iter()
    }

    /// The row that was read last.
    pub fn last_row(&self) -> Option<&Row> {
        self.rows.back()
    }

    /// Records the edges at the head's wires from now on: some 4000 a row.
    pub fn record_edges(&mut self) {
        self.edges = Some(Vec::new());
    }

    /// The edges that were recorded, in the order in which they were seen. Ends the recording.
    pub fn take_edges(&mut self) -> Vec<(Nanos, Edge)> {
        self.edges.take().unwrap_or_default()
    }

    fn record(&mut self, at: Nanos, edge: Edge) {
        if let Some(edges) = &mut self.edges {
            edges.push((at, edge));
        }
    }

    /// Sets ICG to `level`.
    pub fn icg(&mut self, level: Level, now: Nanos) {
        if !self.icg.moves(level, now) {
            return;
        }
        self.record(now, Edge::Icg(level));
        match level {
            Level::Low => self.charge_is_to_be_moved(now),
            Level::High => self.charge_is_moved(now),
        }
    }

    fn charge_is_to_be_moved(&mut self, now: Nanos) {
        if self.sh.level == Level::High {
            let limit = sh_after_icg();
            self.violated(now, format!("ICG fell while SH was high; {limit}"));
        }
        if let (Some(_), Some(burst)) = (&self.read_out, &self.burst)
            && burst.first_pixel.is_some()
            && burst.words.len() < PIXELS
        {
            let words = burst.words.len();
            let what = format!(
                "ICG fell after word {words} of {PIXELS}: the row is cut short (TCD1304 timing chart 1)"
            );
            self.violated(now, what);
        }
        self.read_out = None;
        self.handed_over = None;
    }

    fn charge_is_moved(&mut self, now: Nanos) {
        let limit = icg_after_sh();
        if self.sh.level == Level::High {
            self.violated(now, format!("ICG rose while SH was high; {limit}"));
        }
        // ICG without SH clears the shift register and starts no read-out.
        let Some(exposure) = self.handed_over.take() else {
            return;
        };
        let gap = now - exposure.end;
        if gap < limits::ICG_AFTER_SH {
            self.violated(now, format!("ICG rose {gap} ns after SH fell; {limit}"));
        }
        let light = (self.light)(&exposure);
        if light.len() != PIXELS {
            let pixels = light.len();
            let what = format!("the light source gave {pixels} pixels, and a row has {PIXELS}");
            self.violated(now, what);
        }
        let mut counts: Vec<u16> = light.into_iter().map(quantised).collect();
        counts.resize(PIXELS, 0);
        let shielded = counts[limits::SHIELDED].iter();
        let shielded: u32 = shielded.map(|&counts| u32::from(counts)).sum();
        self.unlit = (shielded / limits::SHIELDED.len() as u32) as u16;
        self.read_out = Some(ReadOut {
            exposure,
            began: now,
            counts,
            clocks_reported: false,
        });
    }

    /// Sets SH to `level`.
    pub fn sh(&mut self, level: Level, now: Nanos) {
        let last_fall = self.sh.fell;
        if !self.sh.moves(level, now) {
            return;
        }
        self.record(now, Edge::Sh(level));
        match level {
            Level::High => {
                if let (Level::Low, Some(fell)) = (self.icg.level, self.icg.fell) {
                    let delay = now - fell;
                    if !limits::SH_AFTER_ICG.contains(&delay) {
                        let limit = sh_after_icg();
                        self.violated(now, format!("SH rose {delay} ns after ICG fell; {limit}"));
                    }
                }
            }
            Level::Low => {
                let high = now - self.sh.rose.unwrap_or(now);
                if high < limits::SH_HIGH {
                    let least = limits::SH_HIGH;
                    let what = format!("SH was high for {high} ns; at least {least} (TCD1304 t3)");
                    self.violated(now, what);
                }
                let start = last_fall.unwrap_or(0);
                let exposure = Exposure {
                    start,
                    end: now,
                    laser: self.laser_within(start..now),
                };
                if last_fall.is_some() && exposure.duration() < limits::EXPOSURE {
                    let (lasted, least) = (exposure.duration(), limits::EXPOSURE);
                    let what =
                        format!("the exposure was {lasted} ns; at least {least} (TCD1304 tINT)");
                    self.violated(now, what);
                }
                if self.icg.level == Level::Low {
                    self.handed_over = Some(exposure);
                }
            }
        }
    }

    /// The laser is to be on in this time. A later word about the same pulse counts.
    pub fn laser_pulse(&mut self, rise: Nanos, fall: Nanos) {
        if !self.laser_pin {
            return;
        }
        if let Some(pulse) = self.laser.back_mut().filter(|it| it.start == rise) {
            pulse.end = fall;
            return;
        }
        if self.laser.len() == PULSES_KEPT
            && let Some(pulse) = self.laser.pop_front()
        {
            self.laser_before += pulse.end - pulse.start;
        }
        self.laser.push_back(rise..fall);
    }

    /// The last pulses of the laser, oldest first.
    pub fn laser_pulses(&self) -> impl DoubleEndedIterator<Item = &Range<Nanos>> {
        self.laser.iter()
    }

    /// For how long the laser was on from power-on until now.
    pub fn laser_time(&self, now: Nanos) -> Nanos {
        self.laser_before + self.laser_within(0..now)
    }

    /// The laser goes off, if it is on.
    pub fn laser_off(&mut self, now: Nanos) {
        for pulse in &mut self.laser {
            pulse.end = pulse.end.min(now).max(pulse.start);
        }
    }

    /// For how long the laser was on in this time, by the last pulses.
    fn laser_within(&self, time: Range<Nanos>) -> Nanos {
        let of_pulse = |pulse: &Range<Nanos>| {
            let (start, end) = (pulse.start.max(time.start), pulse.end.min(time.end));
            end.saturating_sub(start)
        };
        self.laser.iter().map(of_pulse).sum()
    }

    /// Sets the converter's chip select to `level`.
    pub fn chip_select(&mut self, level: Level, now: Nanos) {
        if !self.chip_select.moves(level, now) {
            return;
        }
        self.record(now, Edge::ChipSelect(level));
        if level == Level::Low {
            self.burst = Some(Burst {
                counts: vec![None; PIXELS],
                ..Burst::default()
            });
        } else if let Some(burst) = self.burst.take() {
            self.finish(burst, now);
        }
    }

    /// Clocks a word of `bits` bits that ends now. Gives the word that the converter sends.
    pub fn word(&mut self, bits: u8, now: Nanos) -> u16 {
        let Some(burst) = &mut self.burst else {
            self.violated(now, "a word was clocked with chip select high");
            return 0;
        };
        if bits != limits::WORD_BITS {
            burst.odd_bits = Some(bits);
        }
        if burst.words.is_empty() {
            burst.first_word = now;
        }
        let now = match self.clocks {
            Some(clocks) if !self.has_rate_limit => {
                // When the word would end at SCLK's speed.
                let words = burst.words.len() as f64;
                burst.first_word + (words * clocks.word_time()).round() as Nanos
            }
            _ => now,
        };
        burst.last_word = now;
        let mut counts = self.unlit;
        match (&self.read_out, self.clocks) {
            (Some(read_out), Some(clocks)) if clocks.master_hz > 0.0 && clocks.serial_hz > 0.0 => {
                let held =
                    now as f64 - (f64::from(bits) - limits::HOLD_AFTER) * 1e9 / clocks.serial_hz;
                let position = (held - read_out.began as f64) / clocks.pixel_time();
                let pixel = position.floor();
                if (0.0..PIXELS as f64).contains(&pixel) {
                    counts = read_out.counts[pixel as usize];
                    burst.counts[pixel as usize] = Some(counts);
                    burst
                        .first_pixel
                        .get_or_insert(pixel as i64 - burst.words.len() as i64);
                    let phase = position - pixel;
                    let (least, greatest) = burst.phase.unwrap_or((phase, phase));
                    burst.phase = Some((least.min(phase), greatest.max(phase)));
                }
            }
            (Some(_), _) => burst.unclocked = true,
            (None, _) => {}
        }
        let word = (self.open_line).map_or(FULL_SCALE - counts, |line| line.word(now));
        burst.words.push(word);
        self.record(now, Edge::WordEnded);
        word
    }

    /// How many words were clocked since chip select fell, and when the first and the last of them ended.
    pub(crate) fn clocked(&self) -> (usize, Nanos, Nanos) {
        self.burst.as_ref().map_or((0, 0, 0), |burst| {
            (burst.words.len(), burst.first_word, burst.last_word)
        })
    }

    /// As [`SensorHead::word`], but gives 0 if chip select is high: then the converter does not answer.
    pub(crate) fn converted(&mut self, bits: u8, now: Nanos) -> u16 {
        match self.chip_select.level {
            Level::Low => self.word(bits, now),
            Level::High => 0,
        }
    }

    /// ICG has risen when this part of fM's period had passed since fM rose. The rise at the start, when the
    /// pin is set up, ends no pulse.
    pub fn icg_rose_at(&mut self, part: f64, now: Nanos) {
        if let Some(clocks) = self.clocks {
            let since = (part * 1e9 / clocks.master_hz).round() as Nanos;
            self.record(now.saturating_sub(since), Edge::MasterClockRose);
        }
        if self.icg.fell.is_some() && !limits::ICG_RISES.contains(&part) {
            let found = part * 100.0;
            let [least, most] = percent(limits::ICG_RISES);
            let what = format!(
                "ICG rose at {found:.0} % of fM's period; within {least} % to {most} %, \
                 while fM is high (TCD1304 t4)"
            );
            self.violated(now, what);
        }
    }

    /// Whether the pins must be checked now: once, at the first row.
    pub(crate) fn wants_wiring(&mut self) -> bool {
        let is_due = self.burst.is_some() && !self.wiring_checked;
        self.wiring_checked |= is_due;
        is_due
    }

    /// Sets the clocks. Call it after each edge of ICG and of chip select.
    pub fn clocks(&mut self, clocks: Clocks, now: Nanos) {
        self.clocks = Some(clocks);
        if let Some(read_out) = &mut self.read_out
            && !read_out.clocks_reported
        {
            let faults = clock_faults(clocks);
            read_out.clocks_reported = !faults.is_empty();
            for fault in faults {
                self.violated(now, fault);
            }
        }
    }

    /// Checks the address of a DMA buffer for the converter.
    pub fn dma_address(&mut self, address: u64, now: Nanos) {
        if limits::CORE_COUPLED_RAM.contains(&address) {
            let what = format!(
                "a DMA buffer is at {address:#010x}, in core-coupled RAM that no DMA reaches (RM0090 2.3.1)"
            );
            self.violated(now, what);
        }
    }

    /// The processor restarted and no longer drives its pins. The head's resistors pull them to rest.
    pub fn restarted(&mut self, now: Nanos) {
        self.laser_off(now);
        // A resistor at the laser's driver keeps the laser off.
        self.laser_pin = false;
        self.icg = Pin::resting(Level::High);
        self.chip_select = Pin::resting(Level::High);
        // The photodiodes still gather light, so the end of the last pulse stays.
        self.sh.level = Level::Low;
        self.handed_over = None;
        self.read_out = None;
        self.burst = None;
    }

    fn finish(&mut self, burst: Burst, now: Nanos) {
        let words = burst.words.len();
        if words != PIXELS {
            let what = format!("chip select was low for {words} words; a row is exactly {PIXELS}");
            self.violated(now, what);
        }
        if let Some(bits) = burst.odd_bits {
            let right = limits::WORD_BITS;
            let what =
                format!("a word had {bits} bits; a conversion takes {right} SCLK (ADC122S101)");
            self.violated(now, what);
        }
        if burst.unclocked {
            let what = "words were clocked during a read-out without the master clock fM";
            self.violated(now, what);
        }
        let (Some(read_out), Some(first_pixel), Some(phase)) =
            (&self.read_out, burst.first_pixel, burst.phase)
        else {
            let what = format!(
                "{words} words were clocked and none showed a pixel: no read-out was under way \
                 (ICG rises first)"
            );
            self.violated(now, what);
            return;
        };
        let counts = burst.counts.into_iter();
        let row = Row {
            number: self.row_count,
            exposure: read_out.exposure,
            read_out: read_out.began,
            last_word: burst.last_word,
            lead_in: -first_pixel,
            phase,
            counts: counts.map(|it| it.unwrap_or(self.unlit)).collect(),
            words: burst.words,
        };
        if !(limits::HOLD_PHASE.contains(&phase.0) && limits::HOLD_PHASE.contains(&phase.1)) {
            let [least, greatest] = percent(limits::HOLD_PHASE);
            let (first, last) = (phase.0 * 100.0, phase.1 * 100.0);
            let what = format!(
                "the converter held pixels at {first:.1} % to {last:.1} % of their time; \
                 within {least} % to {greatest} %, \
                 where the output has settled: move the burst against ICG's rise"
            );
            self.violated(now, what);
        }
        if !self.keeps_all_rows && self.rows.len() >= ROWS_KEPT {
            self.rows.pop_front();
        }
        self.rows.push_back(row);
        self.row_count += 1;
    }

    pub(crate) fn violated(&mut self, at: Nanos, what: impl Into<String>) {
        self.violations.add(at, what);
    }
}

fn sh_after_icg() -> String {
    let (least, greatest) = (limits::SH_AFTER_ICG.start(), limits::SH_AFTER_ICG.end());
    format!("SH has to rise {least} to {greatest} ns after ICG falls (TCD1304 t2)")
}

fn icg_after_sh() -> String {
    let least = limits::ICG_AFTER_SH;
    format!("ICG has to rise at least {least} ns after SH falls (TCD1304 t1)")
}

fn percent(limit: RangeInclusive<f64>) -> [f64; 2] {
    [limit.start() * 100.0, limit.end() * 100.0]
}

/// Rounds `counts` as the converter does; NaN becomes 0.
fn quantised(counts: f32) -> u16 {
    counts.round().clamp(0.0, f32::from(FULL_SCALE)) as u16
}

fn clock_faults(clocks: Clocks) -> Vec<String> {
    let mut faults = Vec::new();
    let (master_hz, serial_hz) = (clocks.master_hz, clocks.serial_hz);
    if master_hz <= 0.0 {
        let what = "the master clock fM does not run during a read-out (TCD1304 timing chart)";
        return vec![what.to_owned()];
    }
    for (name, hz, limit, source) in [
        ("fM", master_hz, limits::MASTER_CLOCK, "TCD1304"),
        ("SCLK", serial_hz, limits::SERIAL_CLOCK, "ADC122S101"),
    ] {
        if !limit.contains(&hz) {
            let [least, greatest, mhz] = [*limit.start(), *limit.end(), hz].map(|hz| hz / 1e6);
            let within = format!("within {least} to {greatest} MHz ({source})");
            faults.push(format!("{name} is {mhz} MHz; {within}"));
        }
    }
    let pixel = clocks.pixel_time();
    let conversion = f64::from(limits::WORD_BITS) * 1e9 / serial_hz;
    let most = limits::RATE_MISMATCH;
    if (pixel / conversion - 1.0).abs() > most {
        faults.push(format!(
            "a pixel lasts {pixel:.3} ns (4 / fM) and a conversion {conversion:.3} ns (16 / SCLK); \
             they may differ by {most}"
        ));
    }
    faults
}

#[cfg(test)]
mod tests;
