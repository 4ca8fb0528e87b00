//! What the firmware counts. `status` shows most of it, and the watchdog sees by two counters who lives.

use core::sync::atomic::{AtomicU32, Ordering};

use slitrange_device::protocol::status::{SerialErrors, Vitals};

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
    result_is_fault: Counter::new(),
    results: Counter::new(),
    row_cycles: Counter::new(),
    slowest_row_cycles: Counter::new(),
    lines_dropped: Counter::new(),
    stops: Counter::new(),
    serial_noise: Counter::new(),
    serial_framing: Counter::new(),
    serial_parity: Counter::new(),
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
    /// 1 if the latest result is a fault, otherwise 0.
    pub result_is_fault: Counter,
    /// Signs of life of measuring and the serial line: readings and faults that the serial line took, changes
    /// of settings that measuring took, lines of a row, and operations of a save on the flash.
    pub results: Counter,
    /// Core cycles that the latest row took to compute, interrupts included.
    pub row_cycles: Counter,
    /// The most core cycles that a row took to compute, interrupts included.
    pub slowest_row_cycles: Counter,
    /// Readings and faults that never became a line.
    pub lines_dropped: Counter,
    /// Panics, HardFaults and lost clocks, since the power came.
    pub stops: Counter,
    /// Characters received with noise.
    pub serial_noise: Counter,
    /// Characters received without a stop bit.
    pub serial_framing: Counter,
    /// Characters received with a wrong parity.
    pub serial_parity: Counter,
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
            stops: self.stops.get(),
            triggers_missed: self.triggers_missed.get(),
            lines_dropped: self.lines_dropped.get(),
            serial_errors: SerialErrors {
                noise: self.serial_noise.get(),
                framing: self.serial_framing.get(),
                parity: self.serial_parity.get(),
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
