//! Results as comma-separated values: `format csv`.
//!
//! `800.1234,0.4372,0.0035,1770.1234,1011,16,16,1,5600,0,,0,0,0,0,`
//!
//! A line has the columns of the setting `output`, always in the same order, and then `z`, `h` and `fault`.
//! A column without a value is empty. [`Header`] names the columns, and docs/serial-line.md their values.

use core::fmt;

use super::line::{ResultLine, Short};
use crate::settings::columns::{Column, Columns};
use slitrange::base::units::{InUnits, Units};
use slitrange::reading::Reading;

/// The names of the columns, as a line.
#[derive(Clone, Copy, Debug)]
pub struct Header(pub Columns);

impl fmt::Display for Header {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for column in Column::ALL {
            if self.0.has(column) {
                f.write_str(names(column))?;
            }
        }
        f.write_str("z,h,fault")
    }
}

/// The names in [`Header`] of a column of `output`, each with the comma behind it.
const fn names(column: Column) -> &'static str {
    match column {
        Column::Counter => "number,",
        Column::Time => "us,",
        Column::Distance => "distance,",
        Column::Uncertainty => "u,",
        Column::Repeatability => "r,",
        Column::Centre => "centre,",
        Column::Height => "height,",
        Column::Rows => "used,rows,slits,",
        Column::Width => "width,",
        Column::Exposure => "exposure,",
        Column::Flags => "m,c,g,s,",
    }
}

/// A frame's result, as a line.
#[derive(Clone, Copy, Debug)]
pub struct CsvLine<'a>(pub &'a ResultLine<'a>);

impl fmt::Display for CsvLine<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = self.0;
        for column in Column::ALL {
            if !line.settings.output.has(column) {
                continue;
            }
            match (column, line.result) {
                (Column::Counter, _) => write!(f, "{},", line.number)?,
                (Column::Time, _) => write!(f, "{},", line.us)?,
                (_, Ok(reading)) => write_value(f, column, reading, line.settings.units)?,
                (_, Err(_)) => {
                    for _ in names(column).bytes().filter(|&byte| byte == b',') {
                        f.write_str(",")?;
                    }
                }
            }
        }
        match line.result {
            Ok(_) => write!(f, "{},{},", u8::from(line.is_difference), line.held),
            Err(fault) => write!(f, ",,{}", fault.name()),
        }
    }
}

/// Writes the values of a column, each with the comma behind it. Number and time belong to no reading.
fn write_value(
    f: &mut fmt::Formatter<'_>,
    column: Column,
    reading: &Reading,
    units: Units,
) -> fmt::Result {
    match column {
        Column::Counter | Column::Time => Ok(()),
        Column::Distance => write!(f, "{},", InUnits(reading.distance, units)),
        Column::Uncertainty => write!(f, "{},", Short(reading.uncertainty, units)),
        Column::Repeatability => write!(f, "{},", Short(reading.parts.noise, units)),
        Column::Centre => write!(f, "{:.4},", reading.centre),
        Column::Height => write!(f, "{:.0},", reading.amplitude),
        Column::Rows => write!(
            f,
            "{},{},{},",
            reading.rows_used, reading.rows, reading.slits_used
        ),
        Column::Width => write!(f, "{:.5},", reading.width),
        Column::Exposure => {
            if let Some(exposure) = reading.exposure {
                write!(f, "{}", exposure.us())?;
            }
            f.write_str(",")
        }
        Column::Flags => {
            write!(f, "{},", reading.misfits)?;
            if let Some(rows) = reading.correlated {
                write!(f, "{rows}")?;
            }
            let [g, s] = [reading.is_nominal, reading.has_other_settings].map(u8::from);
            write!(f, ",{g},{s},")
        }
    }
}
