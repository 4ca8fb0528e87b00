//! The answer to `selftest`: what the sensor can check by itself.

use core::fmt;

use crate::protocol::calibration::FlashStatus;
use crate::protocol::line::FaultLine;
use crate::protocol::status::StartCause;
use slitrange::row::front_end::FrontEnd;
use slitrange::spot::region::Region;
use slitrange::{Counts, Fault, Measured, Row};

/// What a row says of the sensor head, in counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowTest {
    /// The mean of the shielded pixels. `None` if the sensor has none.
    black: Option<f32>,
    /// The standard deviation of the shielded pixels. `None` with fewer than two.
    noise: Option<f32>,
    /// The height of the spot, or why there is none.
    light: Result<Counts, Fault>,
}

impl RowTest {
    /// Looks at a row. `measured` is a frame of this row alone. `None` if the words are not those of a
    /// sensor.
    pub fn of(row: &Row<'_>, measured: &Result<Measured, Fault>) -> Option<Self> {
        if *measured == Err(Fault::SensorSilent) {
            return None;
        }
        let pixels = row.shielded();
        let mean = |sum: f32, count: usize| (count > 0).then(|| sum / count as f32);
        let counts = || pixels.iter().map(f32::from);
        let black = mean(counts().sum(), pixels.len());
        let squares = |black: f32| counts().map(|it| (it - black) * (it - black)).sum();
        let variance = black.and_then(|black| mean(squares(black), pixels.len().saturating_sub(1)));
        Some(Self {
            black,
            noise: variance.map(libm::sqrtf),
            light: match measured {
                Ok(measured) => Ok(measured.frame.amplitude),
                Err(fault) => Err(*fault),
            },
        })
    }
}

/// The answer to `selftest`, lines parted by CR LF. Each is `selftest`, what is checked, `pass` or `fail`,
/// and the value. The last line is `selftest pass`, or `selftest fail` and how many checks failed.
#[derive(Clone, Copy, Debug)]
pub struct Selftest<'a> {
    /// The state of flash.
    pub flash: FlashStatus,
    /// What made the firmware start.
    pub started_by: StartCause,
    /// Ten times the rows a second since the start.
    pub row_rate_tenths: u64,
    /// The front end, if it was measured.
    pub front_end: Option<&'a FrontEnd>,
    /// Where the spot was searched.
    pub region: Region,
    /// A row. `None` if none came.
    pub row: Option<RowTest>,
}

/// The least and the largest plausible black level in counts. Nearer to zero, the converter cuts the noise
/// off. Above, a third of the converter's range is lost.
const BLACK: (f32, f32) = (10.0, 1400.0);

/// The largest plausible noise of a pixel without light, in counts. No noise at all is that of a wire which
/// is not connected.
const LARGEST_NOISE: f32 = 30.0;

/// The noise of nine pixels is off by a factor of 4 in one of 7,500 rows (chi squared of 8 degrees below
/// 8 / 16).
const NOISE_FACTOR: f32 = 4.0;

/// The rounding of the converter, as a standard deviation in counts. A read noise does not contain it.
const ROUNDING: f32 = 0.3;

impl fmt::Display for Selftest<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut failed = 0u8;
        let mut check = |name: &str, passes: bool, value: &dyn fmt::Display| {
            failed = failed.saturating_add(u8::from(!passes));
            let word = if passes { "pass" } else { "fail" };
            write!(f, "selftest {name} {word} {value}\r\n")
        };
        let (is_readable, state) = match self.flash {
            FlashStatus::Nothing => (true, "nothing was saved"),
            FlashStatus::Record(_) => (true, "the last save"),
            FlashStatus::Older(_) => (false, "the save before the last one"),
            FlashStatus::Damaged => (false, "damaged"),
            FlashStatus::Later(_) => (false, "of later firmware"),
            FlashStatus::OtherSensor => (false, "of another sensor head"),
        };
        check("flash", is_readable, &state)?;
        let (hertz, tenth) = (self.row_rate_tenths / 10, self.row_rate_tenths % 10);
        match self.row {
            Some(_) => check("rows", true, &format_args!("{hertz}.{tenth} Hz"))?,
            None => check("rows", false, &FaultLine(&Fault::SensorSilent, self.region))?,
        }
        if let Some(RowTest {
            black,
            noise,
            light,
        }) = self.row
        {
            if let Some(black) = black {
                let passes = BLACK.0 <= black && black <= BLACK.1;
                let black = Counts::from_f32(black);
                check("black", passes, &format_args!("{black:.1} counts"))?;
            }
            if let Some(noise) = noise {
                let (least, most) = match self.front_end {
                    Some(front_end) => {
                        let expected = front_end.read_noise.value.to_f32();
                        (expected / NOISE_FACTOR, expected * NOISE_FACTOR)
                    }
                    None => (0.0, LARGEST_NOISE),
                };
                let passes = noise > 0.0 && least <= noise + ROUNDING && noise <= most + ROUNDING;
                let noise = Counts::from_f32(noise);
                check("noise", passes, &format_args!("{noise:.2} counts"))?;
            }
            match light {
                Ok(height) => check("light", true, &format_args!("{height:.0} counts"))?,
                Err(fault) => check("light", false, &FaultLine(&fault, self.region))?,
            }
        }
        let is_usual = match self.started_by {
            StartCause::PowerOn | StartCause::ResetPin | StartCause::Software => true,
            StartCause::SupplyDip | StartCause::Watchdog => false,
        };
        check("start", is_usual, &self.started_by)?;
        match failed {
            0 => f.write_str("selftest pass"),
            failed => write!(f, "selftest fail {failed}"),
        }
    }
}
