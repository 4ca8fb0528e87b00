//! What this sensor is: the banner and the answer to `info`.

use core::fmt;

use super::status::StartCause;
use crate::calibration::Calibration;
use crate::measurement::Settings;
use crate::row::{Geometry, Polarity};
use crate::units::AsMillimetres;

/// The version of the firmware.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// What the firmware runs on.
#[derive(Clone, Copy, Debug)]
pub struct Hardware {
    /// The board.
    pub board: &'static str,
    /// The sensor head.
    pub head: &'static str,
    /// From one row to the next, which is also the exposure, in microseconds.
    pub row_us: u32,
}

/// The line that is said once, at the start.
#[derive(Clone, Copy, Debug)]
pub struct Banner<'a>(pub &'a Hardware, pub StartCause);

impl fmt::Display for Banner<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(Hardware { board, head, .. }, cause) = self;
        write!(f, "slitrange {VERSION} {board} {head}, started by {cause}")
    }
}

/// The answer to `info`, lines parted by CR LF.
#[derive(Clone, Copy, Debug)]
pub struct Info<'a> {
    /// What the firmware runs on.
    pub hardware: &'a Hardware,
    /// What its rows are.
    pub geometry: &'a Geometry,
    /// What is set.
    pub settings: &'a Settings,
}

impl fmt::Display for Info<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Hardware {
            board,
            head,
            row_us,
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
        write!(f, "\r\ninfo rate a row every {row_us} us, exposed as long")?;
        write!(f, "\r\ninfo mean {}", self.settings.mean.name())?;
        write!(f, "\r\ninfo estimator {}", self.settings.estimator.name())?;
        let Some(calibration) = &self.settings.calibration else {
            return f.write_str("\r\ninfo calibration off");
        };
        let Calibration::Eq1(curve) = calibration;
        write!(f, "\r\ninfo calibration d = D + K/(x - xp)")?;
        write!(
            f,
            "\r\ninfo calibration D {} mm, K {} um px, xp {} px",
            AsMillimetres(curve.d()),
            curve.k() >> 16,
            curve.pole()
        )?;
        let (first, last) = curve.valid();
        write!(f, "\r\ninfo range x {first:.0} to {last:.0} px")?;
        if let (Ok((at_first, _)), Ok((at_last, _))) =
            (curve.distance_at(first), curve.distance_at(last))
        {
            write!(
                f,
                ", {} to {} mm",
                AsMillimetres(at_first.min(at_last)),
                AsMillimetres(at_first.max(at_last))
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::black_level::BlackLevel;
    use crate::frame::Mean;
    use crate::sensor_heads;

    #[test]
    fn banner_and_info_are_as_documented() {
        let hardware = Hardware {
            board: "NUCLEO-F429ZI",
            head: "TCD1304DG",
            row_us: 5700,
        };
        assert_eq!(
            Banner(&hardware, StartCause::PowerOn).to_string(),
            format!("slitrange {VERSION} NUCLEO-F429ZI TCD1304DG, started by power-on")
        );
        let mut settings = Settings {
            estimator: crate::estimator::Estimator::default(),
            rows: 16,
            mean: Mean::default(),
            black_level: BlackLevel::Shielded,
            calibration: Calibration::nominal(),
        };
        let geometry = sensor_heads::tcd1304dg();
        let info = Info {
            hardware: &hardware,
            geometry: &geometry,
            settings: &settings,
        }
        .to_string();
        assert_eq!(
            info.lines().last(),
            Some("info range x 1191 to 2654 px, 550.0874 to 1099.7177 mm"),
            "{info}"
        );
        assert!(
            info.split("\r\n")
                .all(|line| line.starts_with("info ") && line.len() <= 110),
            "{info}"
        );
        assert!(
            info.contains("\r\ninfo mean weighted\r\ninfo estimator phase-table\r\n"),
            "{info}"
        );
        settings.calibration = None;
        let info = Info {
            hardware: &hardware,
            geometry: &geometry,
            settings: &settings,
        }
        .to_string();
        assert!(info.ends_with("info calibration off"), "{info}");
    }
}
