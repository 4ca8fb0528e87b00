//! The answer to `status`: why the firmware started, and what it counted since then.

use core::fmt;

use slitrange::base::fault::Fault;

/// What made the firmware start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartCause {
    /// Power came, or came back.
    PowerOn,
    /// The supply fell below the level of the brown-out reset, and came back.
    SupplyDip,
    /// A signal at the reset pin: the button, or a debug probe.
    ResetPin,
    /// The command `reset`, or a debug probe after flashing.
    Software,
    /// The watchdog: a part of the firmware had stopped.
    Watchdog,
}

impl fmt::Display for StartCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::PowerOn => "power-on",
            Self::SupplyDip => "supply dip",
            Self::ResetPin => "reset pin",
            Self::Software => "software",
            Self::Watchdog => "watchdog",
        })
    }
}

/// What the firmware counts since the start. Counts wrap at 2^32, which 175 rows a second reach after 284
/// days.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Vitals {
    /// Time since the start, in microseconds.
    pub uptime_us: u64,
    /// Results of frames, up to the one that an event brings: the lost ones count, too.
    pub results: u32,
    /// Time from the start to the end of the frame whose result an event brings, in microseconds.
    pub result_us: u64,
    /// Rows read.
    pub rows: u32,
    /// Rows not read, because all buffers were still in use.
    pub rows_lost: u32,
    /// Read-outs that did not complete.
    pub rows_failed: u32,
    /// Rows not used, because the program was too late for one of the sensor's edges, or SCLK had a gap.
    pub rows_late: u32,
    /// How far apart the rows since the start were sampled, in percent of a pixel's time, with the delays of
    /// the program's look at them. Rejected rows do not count.
    pub sampling_spread: u32,
    /// Core cycles from the words of the latest row in memory to its centre, with all interrupts meanwhile.
    /// The last row of a frame includes the frame's end.
    pub row_cycles: u32,
    /// The most core cycles that a row took since the start, counted as `row_cycles`.
    pub slowest_row_cycles: u32,
    /// Panics, HardFaults and lost clocks, since the power came.
    pub stops: u32,
    /// Triggers that came while a frame was under way.
    pub triggers_missed: u32,
    /// Lines of readings and faults that the serial line was too slow for.
    pub lines_dropped: u32,
    /// Bytes received with noise, with a wrong stop bit or parity, and lost because an earlier one was not
    /// fetched in time.
    pub serial_errors: SerialErrors,
}

/// The answer to `status`, lines parted by CR LF: every line is `status`, a name and a value.
#[derive(Clone, Copy, Debug)]
pub struct Status<'a> {
    /// What made the firmware start.
    pub started_by: StartCause,
    /// What the firmware counted.
    pub vitals: &'a Vitals,
    /// Frames that gave a distance.
    pub readings: u32,
    /// Frames that gave none, in the order of [`Fault::NAMES`].
    pub faults: [u32; Fault::KINDS],
    /// Whether the switching output is on.
    pub is_within_limits: bool,
}

/// What went wrong on the serial line's receiving side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SerialErrors {
    /// Bytes whose samples disagreed.
    pub noise: u32,
    /// Bytes without a stop bit.
    pub framing: u32,
    /// Bytes with a wrong parity.
    pub parity: u32,
    /// Bytes lost because an earlier one was not fetched in time.
    pub overrun: u32,
}

impl fmt::Display for Status<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let vitals = self.vitals;
        write!(f, "status start {}\r\n", self.started_by)?;
        write!(f, "{}\r\n", Uptime(vitals.uptime_us))?;
        for (name, count) in [
            ("rows read", vitals.rows),
            ("row cycles", vitals.row_cycles),
            ("slowest row cycles", vitals.slowest_row_cycles),
        ] {
            write!(f, "status {name} {count}\r\n")?;
        }
        write!(f, "status sampling spread {} %\r\n", vitals.sampling_spread)?;
        write!(f, "status readings {}\r\n", self.readings)?;
        let limits = if self.is_within_limits { "on" } else { "off" };
        write!(f, "status limits {limits}\r\n")?;
        let (vitals, faults) = (self.vitals, &self.faults);
        Errors { vitals, faults }.fmt(f)
    }
}

/// The answer to `uptime`: the time since the start in microseconds, as the line that `status` has of it.
#[derive(Clone, Copy, Debug)]
pub struct Uptime(pub u64);

impl fmt::Display for Uptime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (seconds, ms) = (self.0 / 1_000_000, self.0 / 1000 % 1000);
        write!(f, "status uptime {seconds}.{ms:03} s")
    }
}

/// The answer to `errors`: the last lines of `status`, which count what went wrong.
#[derive(Clone, Copy, Debug)]
pub struct Errors<'a> {
    /// What the firmware counted.
    pub vitals: &'a Vitals,
    /// As in [`Status`].
    pub faults: &'a [u32; Fault::KINDS],
}

impl fmt::Display for Errors<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (vitals, serial) = (self.vitals, &self.vitals.serial_errors);
        for (name, count) in [
            ("rows lost", vitals.rows_lost),
            ("rows failed", vitals.rows_failed),
            ("rows late", vitals.rows_late),
        ] {
            write!(f, "status {name} {count}\r\n")?;
        }
        for (name, count) in Fault::NAMES.iter().zip(self.faults) {
            write!(f, "status fault {name} {count}\r\n")?;
        }
        for (name, count) in [
            ("stops", vitals.stops),
            ("triggers missed", vitals.triggers_missed),
            ("lines dropped", vitals.lines_dropped),
            ("serial noise", serial.noise),
            ("serial framing", serial.framing),
            ("serial parity", serial.parity),
        ] {
            write!(f, "status {name} {count}\r\n")?;
        }
        write!(f, "status serial overrun {}", serial.overrun)
    }
}
