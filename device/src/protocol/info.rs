//! The banner and the answer to `info`: what this sensor is.

use core::fmt;

use super::flat::Remaining;
use super::status::StartCause;
use crate::record::Record;
use crate::settings::Settings;
use slitrange::base::exposure::Exposure;
use slitrange::base::units::{InUnits, Micrometres, Units};
use slitrange::distance::eq1::Eq1;
use slitrange::distance::knots::Knots;
use slitrange::frame::comb::Slits;
use slitrange::row::front_end::{Estimate, FrontEnd};
use slitrange::row::pixels::PixelErrors;
use slitrange::{Calibration, CalibrationErrors, Geometry, Polarity, Surface};

/// The version of the firmware.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// What the firmware runs on.
#[derive(Clone, Copy, Debug)]
pub struct Hardware {
    /// The board.
    pub board: &'static str,
    /// The sensor head.
    pub head: &'static str,
    /// Microseconds from one row to the next: the exposure to all light but the laser's.
    pub row_us: u32,
    /// The longest time of the laser in a row.
    pub longest_exposure: Exposure,
    /// What times the rows and the serial line.
    pub clock: Clock,
    /// What the chip does while its supply is too low.
    pub brown_out: BrownOut,
    /// What stopped the firmware last, since the power came.
    pub last_stop: Option<&'static str>,
}

/// What times the rows and the serial line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// A clock from outside the chip.
    External,
    /// The chip's own oscillator, because no clock came from outside.
    Internal,
}

/// The supply below which the chip resets itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BrownOut {
    /// In millivolts, at least.
    Below(u16),
    /// Nobody switched it on: a write to flash at a low supply may go wrong.
    Off,
}

impl fmt::Display for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::External => "external",
            // STM32F429 data sheet, HSI: 1 % at 25 C, up to 8 % from -40 to 105 C.
            Self::Internal => {
                "internal, 1 % wrong at 25 C and more elsewhere: no external clock came"
            }
        })
    }
}

impl fmt::Display for BrownOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Below(mv) => write!(f, "below {mv} mV"),
            Self::Off => f.write_str("off: set level 3 with the programmer"),
        }
    }
}

/// The line that the firmware sends once, at the start.
#[derive(Clone, Copy, Debug)]
pub struct Banner<'a>(pub &'a Hardware, pub StartCause);

impl fmt::Display for Banner<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(hardware, cause) = self;
        let Hardware { board, head, .. } = hardware;
        write!(f, "slitrange {VERSION} {board} {head}, started by {cause}")?;
        match hardware.clock {
            Clock::External => Ok(()),
            Clock::Internal => f.write_str(", without its external clock"),
        }
    }
}

/// The answer to `info`, lines parted by CR LF.
#[derive(Clone, Copy, Debug)]
pub struct Info<'a> {
    /// What the firmware runs on.
    pub hardware: &'a Hardware,
    /// The geometry of its rows, with what was measured of the front end.
    pub geometry: &'a Geometry,
    /// The settings in use.
    pub settings: &'a Settings,
    /// The calibration in use, if there is one.
    pub record: Option<&'a Record>,
    /// Whether frames become distances.
    pub is_calibration_on: bool,
    /// How far the pixels differ, as corrected.
    pub pixels: PixelErrors,
}

impl fmt::Display for Info<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Hardware { board, head, .. } = *self.hardware;
        let geometry = self.geometry;
        let (light, shielded) = (&geometry.light, &geometry.shielded);
        let polarity = match geometry.polarity {
            Polarity::Rising => "rise",
            Polarity::Falling => "fall",
        };
        write!(f, "info firmware slitrange {VERSION}\r\n")?;
        write!(f, "info board {board}\r\ninfo sensor head {head}\r\n")?;
        write!(f, "info row {} words: ", geometry.words)?;
        write!(f, "light {}..{}, ", light.start, light.end)?;
        write!(f, "shielded {}..{}; 0 to ", shielded.start, shielded.end)?;
        let full_scale = geometry.full_scale();
        write!(f, "{full_scale} counts that {polarity} with light")?;
        let front_end = self.record.and_then(|record| record.front_end.as_ref());
        match front_end {
            Some(front_end) => write_front_end(front_end, f)?,
            None => write!(
                f,
                "\r\ninfo front end assumed, not measured: {:.2} electrons a count, saturated from {} counts",
                geometry.electrons_per_count(),
                geometry.saturated_from()
            )?,
        }
        let hardware = self.hardware;
        write!(f, "\r\ninfo rate a row every {} us, ", hardware.row_us)?;
        let [least, most] = [Exposure::SHORTEST, hardware.longest_exposure].map(Exposure::us);
        write!(f, "in which the laser is on for {least} to {most} us")?;
        write!(f, "\r\ninfo clock {}", hardware.clock)?;
        write!(f, "\r\ninfo brown-out reset {}", hardware.brown_out)?;
        if let Some(why) = hardware.last_stop {
            write!(f, "\r\ninfo last stop {why}")?;
        }
        write!(f, "\r\ninfo mean {}", self.settings.mean.name())?;
        write!(f, "\r\ninfo estimator {}", self.settings.estimator.name())?;
        if self.settings.slits == Slits::Comb {
            write!(f, "\r\ninfo slits {}", self.settings.slits.name())?;
        }
        let Some(record) = self.record else {
            return f.write_str("\r\ninfo calibration none");
        };
        if !record.is_nominal() {
            let (number, date) = (record.serial_number, record.date);
            write!(f, "\r\ninfo serial number {number}, calibrated {date}")?;
        }
        if !self.is_calibration_on {
            return f.write_str("\r\ninfo calibration off");
        }
        let (calibration, units) = (&record.calibration, self.settings.units);
        match calibration {
            Calibration::Eq1(curve) => write_curve(curve, units, f)?,
            Calibration::Table(table) => write_table("a table of distances", table.knots(), f)?,
            Calibration::Corrected(corrected) => {
                write_curve(corrected.curve(), units, f)?;
                write_table("plus a table of residuals", corrected.residuals(), f)?;
            }
        }
        let (first, last) = calibration.valid();
        write!(f, "\r\ninfo range x {first:.0} to {last:.0} px")?;
        if let Ok(distances) = calibration.distances() {
            write!(
                f,
                ", {}",
                Range(&[*distances.start(), *distances.end()], units)
            )?;
        }
        self.write_parts(record, f)
    }
}

impl Info<'_> {
    /// Writes a line for each part of u: how large it is as far as that is known beforehand, and where it
    /// comes from.
    fn write_parts(&self, record: &Record, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const PART: &str = "\r\ninfo uncertainty";
        let of_each_frame = "of each frame, from its rows";
        write!(f, "{PART} noise: {of_each_frame}; this part alone is r")?;
        let source = if self.pixels == PixelErrors::TCD1304DG {
            "as the data sheet allows"
        } else {
            "left by the map of the pixels"
        };
        write!(f, "{PART} pixels: {}, {source}", Remaining(self.pixels))?;
        let (mut of_points, units) = (None, self.settings.units);
        write!(f, "{PART} calibration: ")?;
        match &record.errors {
            CalibrationErrors::Fitted(fitted) => {
                write!(f, "{}, from its fit", Range(&fitted.curve, units))?;
                of_points = fitted.surface.as_ref();
            }
            CalibrationErrors::Nominal => f.write_str("0, see geometry")?,
            CalibrationErrors::Unknown => {
                f.write_str("unknown, so not in u: fit again from the points")?;
            }
        }
        write!(f, "{PART} surface: ")?;
        let is_comb = self.settings.slits == Slits::Comb;
        if is_comb && self.settings.surface != Surface::Off {
            f.write_str("of each frame, from its slits")?;
        }
        let (and, shared) = match is_comb {
            true => (", and ", " that they share"),
            false => ("", ""),
        };
        let of_points = of_points.map(|surface| Range(&surface.deviation, units));
        match (self.settings.surface, of_points) {
            (Surface::Off, _) => f.write_str("off")?,
            (Surface::Fixed(length), _) => {
                let (length, unit) = (InUnits(length, units), units.name());
                write!(f, "{and}{length} {unit}{shared}, set by hand")?;
            }
            (Surface::Auto, Some(of_points)) if is_comb => write!(f, "{and}{of_points}{shared}")?,
            (Surface::Auto, None) if is_comb => {}
            (Surface::Auto, Some(of_points)) => {
                write!(f, "{of_points}, from the calibration's points")?;
            }
            (Surface::Auto, None) => {
                f.write_str("an estimate, for a laser spot of 1 mm on metal")?;
            }
        }
        write!(f, "{PART} geometry: ")?;
        f.write_str(match &record.errors {
            CalibrationErrors::Nominal => "tolerances of a head that was never calibrated (flag g)",
            _ => "0, the calibration holds it",
        })?;
        write!(f, "{PART} motion: {of_each_frame}")
    }
}

/// Writes the front end as it was measured, in three lines.
fn write_front_end(front_end: &FrontEnd, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    const PART: &str = "\r\ninfo front end";
    let Estimate { value, u } = front_end.gain;
    write!(f, "{PART} gain {value} electrons a count, u {u}")?;
    let Estimate { value, u } = front_end.read_noise;
    write!(f, "{PART} read noise {value:.2} counts, u {u:.2}; ")?;
    let Estimate { value, u } = front_end.black_level;
    write!(f, "black level {value:.2} counts, u {u:.2}")?;
    match front_end.saturation {
        Some(Estimate { value, u }) => write!(f, "{PART} saturation {value:.1} counts, u {u:.1}"),
        None => write!(f, "{PART} saturation not measured: the target was too dim"),
    }
}

/// The least and the largest of some lengths.
pub(crate) struct Range<'a>(pub &'a [Micrometres], pub Units);

impl fmt::Display for Range<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let least = self.0.iter().min().copied().unwrap_or_default();
        let largest = self.0.iter().max().copied().unwrap_or_default();
        let [least, largest] = [least, largest].map(|length| InUnits(length, self.1));
        write!(f, "{least} to {largest} {}", self.1.name())
    }
}

/// Writes eq. (1) with its numbers, in two lines.
fn write_curve(curve: &Eq1, units: Units, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let k_um_px = curve.k() >> 16;
    let (sign, size) = (if k_um_px < 0 { "-" } else { "" }, k_um_px.unsigned_abs());
    let (k_mm_px, decimals) = (size / 1000, size % 1000);
    let (d, unit, pole) = (InUnits(curve.d(), units), units.name(), curve.pole());
    f.write_str("\r\ninfo calibration d = D + K/(x - xp)\r\ninfo calibration ")?;
    write!(f, "D {d} {unit}, K {sign}")?;
    match units {
        Units::Millimetres => write!(f, "{k_mm_px}.{decimals:03}")?,
        Units::Micrometres => write!(f, "{size}")?,
    }
    write!(f, " {unit} px, ")?;
    write!(f, "xp {pole} px")
}

fn write_table(kind: &str, knots: &Knots, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let knots = knots.len();
    write!(f, "\r\ninfo calibration {kind} at {knots} knots, ")?;
    f.write_str("monotone cubics between them")
}
