//! What the tasks pass to each other, and what they count.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_time::Instant;
use slitrange::base::exposure::Exposure;
use slitrange::base::fault::Fault;
use slitrange::light::ambient::AmbientMode;
use slitrange::reading::Measured;
use slitrange::row::pixels::flat_field::{FlatField, Kind, TakeError, Taken};
use slitrange_device::protocol::packet::Window;
use slitrange_device::protocol::status::{SerialErrors, Vitals};
use slitrange_device::session::Applied;
use slitrange_device::settings::trigger::Trigger;

use super::heads::WORDS;

/// A row's memory. While one is read into, another is computed on, and the others wait. The task that has the
/// reference owns the row.
pub type Buffer = &'static mut [u16; WORDS];

/// Rows in use at a time. With two, a row may take twice the row's period before a row is lost. The first row
/// of a frame takes several times as long as the others, so a fast sensor needs more.
pub const BUFFERS: usize = 6;

/// Buffers to read into. Holds all there are, so that sending never waits.
pub static FREE: Channel<CriticalSectionRawMutex, Buffer, BUFFERS> = Channel::new();

/// A row that was read.
pub struct ExposedRow {
    /// Its words.
    pub words: Buffer,
    /// For how long the laser was on; `None` if it was off.
    pub exposure: Option<Exposure>,
    /// When its words were in memory.
    pub at: Instant,
    /// The rows read since the start, with this one.
    pub number: u32,
    /// The pulses since the start, with the one that ended this row's exposure.
    pub pulses: u32,
}

/// Rows to compute on. Holds all there are, so that sending never waits.
pub static FULL: Channel<CriticalSectionRawMutex, ExposedRow, BUFFERS> = Channel::new();

/// For how long the laser is to be on in the rows to come. It is off until the settings are known.
pub static LASER: LaserOrder = LaserOrder(AtomicU32::new(0));

/// See [`LASER`]. Microseconds, or 0 if the laser is off; [`LaserOrder::EVERY_SECOND_ROW`] may be added.
pub struct LaserOrder(AtomicU32);

impl LaserOrder {
    /// The laser is on in every second row only.
    const EVERY_SECOND_ROW: u32 = 1 << 31;

    /// Sets the exposure of the rows to come: of every second row, if the ambient light is to be subtracted.
    pub fn set(&self, exposure: Option<Exposure>, ambient: AmbientMode) {
        let us = u32::from(exposure.map_or(0, Exposure::us));
        let rows = match ambient {
            AmbientMode::Off => 0,
            AmbientMode::Subtract => Self::EVERY_SECOND_ROW,
        };
        // Relaxed: this orders nothing.
        self.0.store(us | rows, Ordering::Relaxed);
    }

    /// The exposure of the row that follows one with the exposure `before`. `None` if the laser is off.
    pub fn exposure_after(&self, before: Option<Exposure>) -> Option<Exposure> {
        let order = self.0.load(Ordering::Relaxed);
        if order & Self::EVERY_SECOND_ROW != 0 && before.is_some() {
            return None;
        }
        let us = order & !Self::EVERY_SECOND_ROW;
        u16::try_from(us).ok().and_then(Exposure::from_us)
    }
}

/// What starts frames.
pub static FRAMES: Frames = Frames(Mutex::new(Cell::new((
    Trigger::Continuous,
    TriggeredFrame::None,
))));

/// See [`FRAMES`].
pub struct Frames(Mutex<CriticalSectionRawMutex, Cell<(Trigger, TriggeredFrame)>>);

/// The frame that a trigger started.
#[derive(Clone, Copy)]
enum TriggeredFrame {
    /// There is none.
    None,
    /// No row of it has come yet. So many pulses were given before the trigger.
    Triggered { pulses: u32 },
    /// Some of its rows have come.
    Begun,
}

impl Frames {
    /// Changes what starts frames. A frame that the trigger before started is dropped.
    pub fn set_trigger(&self, trigger: Trigger) {
        self.update(|state| {
            if state.0 != trigger {
                *state = (trigger, TriggeredFrame::None);
            }
        });
    }

    /// Starts a frame at a command, unless frames start by themselves.
    pub fn start(&self) {
        self.start_if(|trigger| trigger != Trigger::Continuous);
    }

    /// Starts a frame at an edge, if edges start frames.
    pub fn take_edge(&self) {
        self.start_if(|trigger| trigger == Trigger::Pin);
    }

    fn start_if(&self, is_trigger: impl Fn(Trigger) -> bool) {
        // Read first: a pulse in between makes the frame late rather than early.
        let pulses = COUNTERS.pulses.get();
        self.update(|(trigger, frame)| match *frame {
            _ if !is_trigger(*trigger) => {}
            TriggeredFrame::None => *frame = TriggeredFrame::Triggered { pulses },
            _ => COUNTERS.triggers_missed.add(),
        });
    }

    /// Whether a triggered frame begins with a row, which ended with the pulse of this number.
    pub fn begins_with(&self, pulses: u32) -> bool {
        self.update(|(_, frame)| match *frame {
            // The row began with the pulse before, which must have come after the trigger. A difference of
            // numbers that wrap.
            TriggeredFrame::Triggered { pulses: before }
                if (pulses.wrapping_sub(before) as i32) >= 2 =>
            {
                *frame = TriggeredFrame::Begun;
                true
            }
            _ => false,
        })
    }

    /// Whether the result of the frame that ends now is wanted.
    pub fn end(&self) -> bool {
        self.update(|(trigger, frame)| match (*trigger, *frame) {
            (Trigger::Continuous, _) => true,
            (_, TriggeredFrame::Begun) => {
                *frame = TriggeredFrame::None;
                true
            }
            _ => false,
        })
    }

    /// Whether a result is wanted although the sensor brings no rows. A frame that waits for its first row
    /// ends.
    pub fn end_in_silence(&self) -> bool {
        self.update(|(_, frame)| {
            if let TriggeredFrame::Triggered { .. } = frame {
                *frame = TriggeredFrame::Begun;
            }
        });
        self.end()
    }

    fn update<T>(&self, change: impl FnOnce(&mut (Trigger, TriggeredFrame)) -> T) -> T {
        self.0.lock(|cell| {
            let mut state = cell.get();
            let result = change(&mut state);
            cell.set(state);
            result
        })
    }
}

/// Set by measuring while it has no result to send, because no trigger came: its sign of life, and the serial
/// line's once that has taken it.
pub static IDLE: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Results for the serial line. Holds 91 ms of results at the highest rate, a row a frame, so that the answer
/// to `status` (about 45 ms) loses none. All its bytes are zero at first, as `.ccm` wants it: no DMA reaches
/// it, and the stack has the room.
#[unsafe(link_section = ".ccm.results")]
pub static RESULTS: Channel<CriticalSectionRawMutex, FrameEnd, 16> = Channel::new();

/// The result of a frame.
pub struct FrameEnd {
    /// Its number since the start, from 1. Lost results have numbers, too.
    pub number: u32,
    /// The centre, or why there is none.
    pub result: Result<Measured, Fault>,
    /// When the words of the frame's last row were in memory. If no row came: when the firmware noticed it.
    pub at: Instant,
}

/// Set while the pixels around the spot are to be sent.
pub static SENDS_WINDOWS: AtomicBool = AtomicBool::new(false);

/// The pixels around the spots, for the results of the same [`FrameEnd::at`]. Holds 46 ms of them, more than
/// most answers take at the rate that carries them all. In core-coupled memory, as [`RESULTS`].
#[unsafe(link_section = ".ccm.windows")]
pub static WINDOWS: Channel<CriticalSectionRawMutex, (Instant, Window), 8> = Channel::new();

/// Changed settings, with what the calibration knows of the sensor. Only the last change matters.
pub static SETTINGS: Signal<CriticalSectionRawMutex, Applied> = Signal::new();

/// While this is set, no reading is due: rows are taken and dropped. It is set from the start until the flash
/// has been read, and during each save, each job with the map of the pixels, and while a row is sent.
pub static PAUSED: AtomicBool = AtomicBool::new(true);

/// The map of the pixels, with the sums of rows for another one. The task that has the reference owns them.
pub type Flat = &'static mut FlatField;

/// What measuring does between two rows.
pub enum Request {
    /// Use this map, or only hold it.
    Use(Flat, bool),
    /// Take rows for a map. The answer comes by [`TAKEN`].
    Take(Kind),
    /// Give the map away, by [`GIVEN`].
    Give,
    /// Measure the next row by itself, and give it away by [`ROW_TO_SEND`].
    MeasureAlone,
}

/// Requests to measuring. Holds one, because the serial line waits for the answer to each.
pub static REQUESTS: Channel<CriticalSectionRawMutex, Request, 1> = Channel::new();

/// How the rows of a map were taken.
pub static TAKEN: Channel<CriticalSectionRawMutex, Result<Taken, TakeError>, 1> = Channel::new();

/// The map that measuring gives away.
pub static GIVEN: Channel<CriticalSectionRawMutex, Flat, 1> = Channel::new();

/// A row for the serial line, and what measuring makes of it. No row if the sensor is silent.
pub static ROW_TO_SEND: Channel<
    CriticalSectionRawMutex,
    (Option<ExposedRow>, Result<Measured, Fault>),
    1,
> = Channel::new();

/// What is counted since the start.
pub static COUNTERS: Counters = Counters {
    pulses: Counter::new(),
    rows: Counter::new(),
    rows_lost: Counter::new(),
    rows_failed: Counter::new(),
    triggers_missed: Counter::new(),
    rows_late: Counter::new(),
    sampled_earliest: Counter::new(),
    sampled_latest: Counter::new(),
    frames: Counter::new(),
    results: Counter::new(),
    row_cycles: Counter::new(),
    slowest_row_cycles: Counter::new(),
    lines_dropped: Counter::new(),
    serial_noise: Counter::new(),
    serial_framing: Counter::new(),
    serial_overrun: Counter::new(),
};

/// See [`COUNTERS`].
pub struct Counters {
    /// Times that the sensor was pulsed: the acquisition's sign of life.
    pub pulses: Counter,
    /// Rows read.
    pub rows: Counter,
    /// Rows not read because no buffer was free.
    pub rows_lost: Counter,
    /// Read-outs that failed.
    pub rows_failed: Counter,
    /// Triggers while a frame was under way.
    pub triggers_missed: Counter,
    /// Rows of which an edge was late, or whose words had a gap.
    pub rows_late: Counter,
    /// When the earliest row was sampled, in percent of a pixel's time. Too small by the time that the
    /// program takes to see word 0. 0 before the first row.
    pub sampled_earliest: Counter,
    /// The same of the latest row.
    pub sampled_latest: Counter,
    /// Results of frames.
    pub frames: Counter,
    /// Signs of life of measuring and the serial line: readings and faults that the serial line took, changes
    /// of settings that measuring took, lines of a row, and operations of a save on the flash.
    pub results: Counter,
    /// Core cycles that the latest row took to compute, interrupts included.
    pub row_cycles: Counter,
    /// The most core cycles that a row took to compute, interrupts included.
    pub slowest_row_cycles: Counter,
    /// Readings and faults that never became a line.
    pub lines_dropped: Counter,
    /// Characters received with noise.
    pub serial_noise: Counter,
    /// Characters received without a stop bit.
    pub serial_framing: Counter,
    /// Characters lost because the one before was not fetched in time.
    pub serial_overrun: Counter,
}

impl Counters {
    /// The counts that `status` shows.
    pub fn vitals(&self, uptime_us: u64) -> Vitals {
        Vitals {
            uptime_us,
            rows: self.rows.get(),
            rows_lost: self.rows_lost.get(),
            rows_failed: self.rows_failed.get(),
            rows_late: self.rows_late.get(),
            sampling_spread: (self.sampled_latest.get())
                .saturating_sub(self.sampled_earliest.get()),
            row_cycles: self.row_cycles.get(),
            slowest_row_cycles: self.slowest_row_cycles.get(),
            triggers_missed: self.triggers_missed.get(),
            lines_dropped: self.lines_dropped.get(),
            serial_errors: SerialErrors {
                noise: self.serial_noise.get(),
                framing: self.serial_framing.get(),
                overrun: self.serial_overrun.get(),
            },
            ..Vitals::default()
        }
    }
}

/// A number that any task or interrupt may count up and read.
pub struct Counter(AtomicU32);

impl Counter {
    const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// Counts one.
    pub fn add(&self) {
        // Relaxed: a counter orders nothing; channels hand over what must be in order.
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts one if it happened.
    pub fn add_if(&self, happened: bool) {
        if happened {
            self.add();
        }
    }

    /// Notes a number instead of a count.
    pub fn set(&self, number: u32) {
        self.0.store(number, Ordering::Relaxed);
    }

    /// Notes a number if it is smaller than all numbers before, or the first.
    pub fn set_if_smaller(&self, number: u32) {
        let before = self.get();
        if before == 0 || number < before {
            self.set(number);
        }
    }

    /// Notes a number if it is larger than all numbers before.
    pub fn set_if_larger(&self, number: u32) {
        self.0.fetch_max(number, Ordering::Relaxed);
    }

    /// The count.
    pub fn get(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }
}
