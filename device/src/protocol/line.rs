//! Readings and faults as lines, without their line ends.
//!
//! A reading is `d 800.1234 mm u 0.4372 r 0.0035 x 1823.1234 a 1830 n 16/16`, a fault
//! `f too dim: 35.2 counts, needs 60.1`, and the centre of a frame, calibrated or not,
//! `x 1823.12341 u 0.00195 a 1830 n 16/16 b 312 e t w 7.62131 o 0.00012 -0.00310 0.01203 0.00010 -0.00020`.
//! docs/serial-line.md says what each part means, and which of them `output`, `units` and a comb change.
//!
//! 115200 baud carries 65.6 bytes in the 5.7 ms of a row, so a frame's line may have that many bytes for each
//! of its rows. The longest line of a frame of one row is 65 bytes with its end, for distances that are
//! positive and below 10 m, u below 1 m and r below 10 mm. To fit, the centre has four decimals, which are
//! 0.02 to 0.07 um of distance and so as fine as the distance's own, and u has two from 10 mm on. The flag
//! `c` comes only with frames of eight rows or more, whose line has eight times the room. A comb's line is
//! five bytes longer, and so is a line with an exposure, by up to seven bytes. With frames of one row the
//! longest of these lines do not fit, and the firmware drops some.

use core::fmt;

use crate::settings::Settings;
use crate::settings::columns::{Column, Columns};
use slitrange::base::exposure::Exposure;
use slitrange::base::units::{InUnits, Micrometres, Units};
use slitrange::reading::uncertainty::Parts;
use slitrange::spot::region::Region;
use slitrange::{Fault, Measured, Reading};

/// The line of a reading by the factory's settings.
#[derive(Clone, Copy, Debug)]
pub struct ReadingLine<'a>(pub &'a Reading);

impl fmt::Display for ReadingLine<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_reading(f, "d", self.0, Columns::default(), Units::default())
    }
}

/// The line of a fault, with the region in which the spot was searched.
#[derive(Clone, Copy, Debug)]
pub struct FaultLine<'a>(pub &'a Fault, pub Region);

impl fmt::Display for FaultLine<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(fault, region) = self;
        write!(f, "f {fault}")?;
        match fault {
            Fault::NoSpot { .. } if *region != Region::ALL => {
                write!(f, " in region {} {}", region.first(), region.last())
            }
            _ => Ok(()),
        }
    }
}

/// The line of a frame's result, with the columns that `output` sets.
#[derive(Clone, Copy, Debug)]
pub struct ResultLine<'a> {
    /// The number of the result since the start.
    pub number: u32,
    /// The time of the result since the start, in microseconds.
    pub us: u64,
    /// The reading, or why there is none.
    pub result: &'a Result<Reading, Fault>,
    /// Whether the reading is relative to `zero`.
    pub is_difference: bool,
    /// The results for which the reading has been held after faults; 0 for the reading of this frame.
    pub held: u16,
    /// The columns, the unit of distance, u and r, and what else the line shows of the settings.
    pub settings: &'a Settings,
}

impl fmt::Display for ResultLine<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Settings {
            units,
            output: columns,
            ..
        } = *self.settings;
        if columns.has(Column::Counter) {
            write!(f, "# {} ", self.number)?;
        }
        if columns.has(Column::Time) {
            write!(f, "@ {} ", self.us)?;
        }
        match self.result {
            Ok(reading) => {
                let letter = if self.is_difference { "z" } else { "d" };
                write_reading(f, letter, reading, columns, units)?;
                match self.held {
                    0 => Ok(()),
                    // Whatever the columns are: nobody may take it for a new reading.
                    results => write!(f, " h {results}"),
                }
            }
            Err(Fault::Spike { step }) => {
                let (step, unit) = (InUnits(*step, units), units.name());
                write!(f, "f spike: {step} {unit} from the last good reading")
            }
            Err(fault) => FaultLine(fault, self.settings.searched()).fmt(f),
        }
    }
}

/// Writes the columns of a reading that follow number and time. The letter and the unit come always.
fn write_reading(
    f: &mut fmt::Formatter<'_>,
    letter: &str,
    reading: &Reading,
    columns: Columns,
    units: Units,
) -> fmt::Result {
    f.write_str(letter)?;
    if columns.has(Column::Distance) {
        write!(f, " {}", InUnits(reading.distance, units))?;
    }
    write!(f, " {}", units.name())?;
    if columns.has(Column::Uncertainty) {
        write!(f, " u {}", Short(reading.uncertainty, units))?;
    }
    if columns.has(Column::Repeatability) {
        write!(f, " r {}", Short(reading.parts.noise, units))?;
    }
    if columns.has(Column::Centre) {
        write!(f, " x {:.4}", reading.centre)?;
    }
    if columns.has(Column::Height) {
        write!(f, " a {:.0}", reading.amplitude)?;
    }
    if columns.has(Column::Rows) {
        write!(f, " n {}/{}", reading.rows_used, reading.rows)?;
    }
    if columns.has(Column::Width) {
        write!(f, " w {:.5}", reading.width)?;
    }
    if columns.has(Column::Exposure) {
        write_exposure(f, reading.exposure)?;
    }
    if columns.has(Column::Rows) && reading.slits_used > 1 {
        write!(f, " k {}", reading.slits_used)?;
    }
    if columns.has(Column::Flags) {
        flags(f, reading.misfits, reading.correlated)?;
        if reading.is_nominal {
            f.write_str(" g")?;
        }
        if reading.has_other_settings {
            f.write_str(" s")?;
        }
    }
    Ok(())
}

/// An uncertainty to a tenth of a micrometre below 10 mm. From there on in millimetres with two decimals, or
/// in whole micrometres.
pub(super) struct Short(pub Micrometres, pub Units);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Nearer to 10 mm than to 9.9999 mm.
        if self.0 < Micrometres::from_bits(199_999 * 256 / 20) {
            return InUnits(self.0, self.1).fmt(f);
        }
        if self.1 == Units::Micrometres {
            return write!(f, "{:.0}", self.0);
        }
        let hundredths = (i64::from(self.0.to_bits()) + 5 * 256) / (10 * 256);
        write!(f, "{}.{:02}", hundredths / 100, hundredths % 100)
    }
}

/// The parts of an uncertainty, a line for each, parted by CR LF.
#[derive(Clone, Copy, Debug)]
pub struct PartsOf<'a>(pub &'a Parts, pub Units);

impl fmt::Display for PartsOf<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut end = "";
        for (name, part) in self.0.named() {
            let part = InUnits(part, self.1);
            write!(f, "{end}uncertainty {name} {part} {}", self.1.name())?;
            end = "\r\n";
        }
        Ok(())
    }
}

/// The line of a frame's centre, and a second one for the images of a comb.
#[derive(Clone, Copy, Debug)]
pub struct CentreLine<'a>(pub &'a Measured);

impl fmt::Display for CentreLine<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (frame, comb) = (&self.0.frame, &self.0.comb);
        let (centre, u, height) = (frame.centre, frame.uncertainty, frame.amplitude);
        write!(f, "x {centre:.5} u {u:.5} a {height:.0} ")?;
        write!(f, "n {}/{} ", frame.rows_used, frame.rows)?;
        let (black, letter) = (self.0.black_level, self.0.estimator.letter());
        write!(f, "b {black:.0} e {letter}")?;
        write!(f, " w {:.5} o", frame.shape.width)?;
        for component in frame.shape.components {
            write!(f, " {component:.5}")?;
        }
        write_exposure(f, frame.exposure)?;
        if let Some(comb) = comb {
            write!(f, " k {}", comb.used)?;
        }
        flags(f, frame.misfits, frame.correlated)?;
        let Some(comb) = comb else { return Ok(()) };
        f.write_str("\r\nslits")?;
        for slit in &comb.centres {
            match slit {
                Some(slit) if slit.rows.get() >= frame.rows_used.div_ceil(2) => {
                    write!(f, " {:.5}/{}", slit.centre, slit.height)?;
                }
                _ => f.write_str(" -")?,
            }
        }
        Ok(())
    }
}

/// Writes the exposure, unless it is the longest or not known.
fn write_exposure(f: &mut fmt::Formatter<'_>, exposure: Option<Exposure>) -> fmt::Result {
    match exposure {
        Some(exposure) if exposure != Exposure::LONGEST => write!(f, " t {}", exposure.us()),
        _ => Ok(()),
    }
}

/// Writes the flags that end a frame's line.
fn flags(f: &mut fmt::Formatter<'_>, misfits: u16, correlated: Option<u16>) -> fmt::Result {
    if misfits > 0 {
        write!(f, " m {misfits}")?;
    }
    match correlated {
        Some(rows) => write!(f, " c {rows}"),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use slitrange::frame::FEWEST_INDEPENDENT;
    use slitrange::{Counts, Estimator, Pixels};

    /// The longest line of a frame, in bytes with its end.
    fn longest(rows: u16) -> usize {
        let longest = Reading {
            distance: Micrometres::from_f32(8_388_000.0),
            uncertainty: Micrometres::from_int(999_994),
            parts: Parts {
                noise: Micrometres::from_int(9_999),
                ..Parts::default()
            },
            centre: Pixels::from_f32(3646.9),
            centre_uncertainty: Pixels::from_int(16),
            amplitude: Counts::from_int(4095),
            exposure: None,
            width: Pixels::from_int(130),
            rows_used: rows,
            rows,
            slits_used: 1,
            black_level: Counts::from_int(4095),
            estimator: Estimator::GaussNewton,
            misfits: rows,
            correlated: (rows >= FEWEST_INDEPENDENT).then_some(FEWEST_INDEPENDENT - 1),
            is_nominal: true,
            has_other_settings: false,
        };
        let line = ReadingLine(&longest).to_string();
        println!("{line}");
        line.len() + 2
    }

    #[test]
    fn the_line_carries_every_frame() {
        assert_eq!((longest(1), longest(64)), (65, 72));
        // 115200 baud, ten bits a byte, a row in 5.7 ms.
        let bytes_a_row = 11_520.0 * 5.7e-3;
        for rows in [1, 2, 7, 8, 64] {
            assert!(longest(rows) as f64 <= f64::from(rows) * bytes_a_row);
        }
    }
}
