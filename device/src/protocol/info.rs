//! The banner and the answer to `info`: what this sensor is.

use core::fmt;

use super::flat::Remaining;
use super::status::StartCause;
use crate::record::Record;
use crate::settings::Settings;
use slitrange::base::exposure::Exposure;
use slitrange::base::units::{AsMillimetres, Micrometres};
use slitrange::distance::Calibration;
use slitrange::distance::eq1::Eq1;
use slitrange::distance::knots::Knots;
use slitrange::frame::comb::Slits;
use slitrange::reading::uncertainty::{CalibrationErrors, Surface};
use slitrange::row::front_end::FrontEnd;
use slitrange::row::pixels::PixelErrors;
use slitrange::row::{Geometry, Polarity};

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
        let Hardware {
            board,
            head,
            row_us,
            longest_exposure,
            clock,
            brown_out,
        } = *self.hardware;
        let Geometry {
            words,
            shielded,
            light,
            polarity,
            ..
        } = self.geometry;
        let full_scale = self.geometry.full_scale();
        let polarity = match polarity {
            Polarity::Rising => "rise",
            Polarity::Falling => "fall",
        };
        write!(
            f,
            "info firmware slitrange {VERSION}\r\ninfo board {board}\r\ninfo sensor head {head}"
        )?;
        write!(
            f,
            "\r\ninfo row {words} words: light {}..{}, ",
            light.start, light.end
        )?;
        write!(
            f,
            "shielded {}..{}; 0 to {full_scale} counts that {polarity} with light",
            shielded.start, shielded.end
        )?;
        let front_end = self.record.and_then(|record| record.front_end.as_ref());
        match front_end {
            Some(front_end) => write!(f, "{}", MeasuredFrontEnd(front_end))?,
            None => write!(
                f,
                "\r\ninfo front end assumed, not measured: {:.2} electrons a count, saturated from {} counts",
                self.geometry.electrons_per_count(),
                self.geometry.saturated_from()
            )?,
        }
        write!(
            f,
            "\r\ninfo rate a row every {row_us} us, in which the laser is on for {} to {} us",
            Exposure::SHORTEST.us(),
            longest_exposure.us()
        )?;
        write!(f, "\r\ninfo clock {clock}")?;
        write!(f, "\r\ninfo brown-out reset {brown_out}")?;
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
        let calibration = &record.calibration;
        match calibration {
            Calibration::Eq1(curve) => write!(f, "{}", Curve(curve))?,
            Calibration::Table(table) => {
                f.write_str("\r\ninfo calibration a table of distances")?;
                write!(f, "{}", KindOfTable(table.knots()))?;
            }
            Calibration::Corrected(corrected) => {
                write!(f, "{}", Curve(corrected.curve()))?;
                f.write_str("\r\ninfo calibration plus a table of residuals")?;
                write!(f, "{}", KindOfTable(corrected.residuals()))?;
            }
        }
        let (first, last) = calibration.valid();
        write!(f, "\r\ninfo range x {first:.0} to {last:.0} px")?;
        if let Ok(distances) = calibration.distances() {
            write!(
                f,
                ", {} to {} mm",
                AsMillimetres(*distances.start()),
                AsMillimetres(*distances.end())
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
        let fitted = match &record.errors {
            CalibrationErrors::Fitted(fitted) => Some(fitted),
            CalibrationErrors::Unknown | CalibrationErrors::Nominal => None,
        };
        match (&record.errors, fitted) {
            (_, Some(fitted)) => {
                write!(
                    f,
                    "{PART} calibration: {}, from its fit",
                    Range(&fitted.curve)
                )?;
            }
            (CalibrationErrors::Nominal, _) => {
                write!(f, "{PART} calibration: 0 um, see geometry")?;
            }
            _ => write!(
                f,
                "{PART} calibration: unknown, so not in u: fit again from the points"
            )?,
        }
        let of_points = fitted.and_then(|fitted| fitted.surface);
        match (self.settings.surface, of_points) {
            (Surface::Off, _) => write!(f, "{PART} surface: off")?,
            (Surface::Fixed(um), _) if self.settings.slits == Slits::Comb => write!(
                f,
                "{PART} surface: of each frame, from its slits, and {um} um that they share, set by hand"
            )?,
            (Surface::Fixed(um), _) => write!(f, "{PART} surface: {um} um, set by hand")?,
            (Surface::Auto, Some(surface)) if self.settings.slits == Slits::Comb => write!(
                f,
                "{PART} surface: of each frame, from its slits, and {} that they share",
                Range(&surface.deviation)
            )?,
            (Surface::Auto, None) if self.settings.slits == Slits::Comb => {
                write!(f, "{PART} surface: of each frame, from its slits")?;
            }
            (Surface::Auto, Some(surface)) => write!(
                f,
                "{PART} surface: {}, from the calibration's points",
                Range(&surface.deviation)
            )?,
            (Surface::Auto, None) => write!(
                f,
                "{PART} surface: an estimate, for a laser spot of 1 mm on metal"
            )?,
        }
        match &record.errors {
            CalibrationErrors::Nominal => write!(
                f,
                "{PART} geometry: tolerances of a head that was never calibrated (flag g)"
            )?,
            _ => write!(f, "{PART} geometry: 0 um, the calibration holds it")?,
        }
        write!(f, "{PART} motion: {of_each_frame}")
    }
}

/// The front end as it was measured, in three lines.
struct MeasuredFrontEnd<'a>(&'a FrontEnd);

impl fmt::Display for MeasuredFrontEnd<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const PART: &str = "\r\ninfo front end";
        let FrontEnd {
            gain,
            read_noise,
            saturation,
            black_level,
            polarity: _,
        } = self.0;
        write!(
            f,
            "{PART} gain {} electrons a count, u {}",
            gain.value, gain.u
        )?;
        write!(
            f,
            "{PART} read noise {:.2} counts, u {:.2}; black level {:.2} counts, u {:.2}",
            read_noise.value, read_noise.u, black_level.value, black_level.u
        )?;
        match saturation {
            Some(saturation) => write!(
                f,
                "{PART} saturation {:.1} counts, u {:.1}",
                saturation.value, saturation.u
            ),
            None => write!(f, "{PART} saturation not measured: the target was too dim"),
        }
    }
}

/// The least and the largest of some uncertainties.
struct Range<'a>(&'a [Micrometres]);

impl fmt::Display for Range<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let least = self.0.iter().min().copied().unwrap_or_default();
        let largest = self.0.iter().max().copied().unwrap_or_default();
        write!(f, "{least} to {largest} um")
    }
}

/// Eq. (1) with its numbers, in two lines.
struct Curve<'a>(&'a Eq1);

impl fmt::Display for Curve<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let k_um_px = self.0.k() >> 16;
        let (sign, size) = (if k_um_px < 0 { "-" } else { "" }, k_um_px.unsigned_abs());
        write!(
            f,
            "\r\ninfo calibration d = D + K/(x - xp)\r\n\
             info calibration D {} mm, K {sign}{}.{:03} mm px, xp {} px",
            AsMillimetres(self.0.d()),
            size / 1000,
            size % 1000,
            self.0.pole()
        )
    }
}

/// The kind of a table, as the rest of a line.
struct KindOfTable<'a>(&'a Knots);

impl fmt::Display for KindOfTable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            " at {} knots, monotone cubics between them",
            self.0.len()
        )
    }
}
