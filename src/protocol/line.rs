//! Readings and faults as lines, without their line ends.
//!
//! A reading is `d 800.1234 mm u 0.0035 x 1823.12345 a 1830 n 16/16 b 312.3`: distance and its standard uncertainty in
//! millimetres, centre in pixels, amplitude in counts, rows used of the frame's, black level in counts. A fault is
//! `f too dim: 35.2 counts, needs 60.1`. No line is longer than 64 bytes with its end (for distances that
//! are positive and uncertainties below a metre), so that 115200 baud carries a line for every row.

use core::fmt;

use crate::reading::{Fault, Reading};
use crate::units::AsMillimetres;

impl fmt::Display for Reading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "d {} mm u {} x {:.5} a {:.0} n {}/{} b {:.1}",
            AsMillimetres(self.distance),
            AsMillimetres(self.uncertainty),
            self.centre,
            self.amplitude,
            self.rows_used,
            self.rows,
            self.black_level
        )
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "f {}", self.name())?;
        match self {
            Self::SensorSilent => Ok(()),
            Self::NoSpot { amplitude } => write!(f, ": {amplitude:.1} counts at most"),
            Self::TooDim { amplitude, needed } => {
                write!(f, ": {amplitude:.1} counts, needs {needed:.1}")
            }
            Self::Saturated { pixels } => write!(f, ": {pixels} pixels"),
            Self::SpotAtEdge { centre } => write!(f, ": x {centre:.1}"),
            Self::Unsteady { scatter } => write!(f, ": rows scatter by {scatter:.2} px"),
            Self::OutOfRange { centre } => write!(f, ": x {centre:.5}"),
            Self::NotCalibrated {
                centre,
                uncertainty,
            } => write!(f, ": x {centre:.5} u {uncertainty:.5}"),
        }
    }
}

impl core::error::Error for Fault {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::{Counts, Micrometres, Pixels};

    #[test]
    fn lines_are_as_documented_and_short_enough_for_a_line_a_row() {
        let reading = Reading {
            distance: Micrometres::from_int(800_123),
            uncertainty: Micrometres::from_int(35),
            centre: Pixels::from_f32(1823.125),
            centre_uncertainty: Pixels::from_f32(0.001),
            amplitude: Counts::from_f32(1830.25),
            width: Pixels::from_int(9),
            rows_used: 16,
            rows: 16,
            black_level: Counts::from_f32(312.25),
        };
        assert_eq!(
            reading.to_string(),
            "d 800.1230 mm u 0.0350 x 1823.12500 a 1830 n 16/16 b 312.3"
        );
        let longest = Reading {
            distance: Micrometres::from_int(8_000_000),
            uncertainty: Micrometres::from_int(999_999),
            centre: Pixels::from_int(3647),
            amplitude: Counts::from_int(4095),
            rows_used: 64,
            rows: 64,
            black_level: Counts::from_int(4095),
            ..reading
        };
        assert!(longest.to_string().len() + 2 <= 64, "{longest}");
        let dim = Fault::TooDim {
            amplitude: Counts::from_f32(35.2),
            needed: Counts::from_f32(60.1),
        };
        assert_eq!(dim.to_string(), "f too dim: 35.2 counts, needs 60.1");
    }
}
