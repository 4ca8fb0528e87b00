//! The core of slitrange for Python: `slitrange._core`. The package's `rows.py` checks the arguments and
//! gives the results their names.
#![forbid(unsafe_code)]

use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use slitrange::base::units::{Counts, Electrons, Pixels};
use slitrange::centre::spot_shape::COMPONENTS;
use slitrange::measurement::Measurement;
use slitrange::reading::Measured;
use slitrange::{BlackLevel, Estimator, Fault, Geometry, Options, Polarity, sensor_heads};

/// A sensor's geometry, as Python holds it: words, light, shielded, falling, bits, electrons per count, and
/// the count from which a pixel is saturated.
type Layout = (usize, (usize, usize), (usize, usize), bool, u8, f64, u16);

/// The numbers of a frame: centre, the parts noise and shape of its u, height in counts, width, and the
/// components of the asymmetry; all others in pixels.
const NUMBERS: usize = 5 + COMPONENTS;

/// The results of all frames, one list for each number. Then rows used, rows with the flag misfit, and the
/// number of the fault or -1.
#[derive(Default)]
struct Columns {
    numbers: [Vec<f64>; NUMBERS],
    rows: [Vec<u16>; 2],
    fault: Vec<i8>,
}

impl Columns {
    fn add(&mut self, result: &Result<Measured, Fault>) {
        let (mut numbers, mut rows, mut kind) = ([f64::NAN; NUMBERS], [0, 0], -1);
        match result {
            Ok(Measured {
                frame, by_shape, ..
            }) => {
                let (own, components) = numbers.split_at_mut(5);
                let pixels = [frame.centre, frame.uncertainty, *by_shape].map(Pixels::to_f64);
                own[..3].copy_from_slice(&pixels);
                own[3..].copy_from_slice(&[frame.amplitude.to_f64(), frame.width.to_f64()]);
                // Without a width, the check had too little of the spot to tell its shape.
                if frame.shape.width > Pixels::default() {
                    components.copy_from_slice(&frame.shape.components.map(Pixels::to_f64));
                }
                rows = [frame.rows_used, frame.misfits];
            }
            // There are 15 kinds.
            Err(fault) => kind = fault.kind() as i8,
        }
        for (list, number) in self.numbers.iter_mut().zip(numbers) {
            list.push(number);
        }
        for (list, rows) in self.rows.iter_mut().zip(rows) {
            list.push(rows);
        }
        self.fault.push(kind);
    }
}

/// The columns as numpy arrays.
type Arrays<'py> = (
    [Bound<'py, PyArray1<f64>>; NUMBERS],
    [Bound<'py, PyArray1<u16>>; 2],
    Bound<'py, PyArray1<i8>>,
);

/// Measures the rows of a two-dimensional array, a row for each of its rows. Each `frame` rows are a frame.
/// `black_level` is a number of counts, "shielded" or "frame".
#[pyfunction]
fn centres<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, u16>,
    estimator: &str,
    layout: Layout,
    black_level: &str,
    frame: u16,
) -> PyResult<Arrays<'py>> {
    let estimator = Estimator::named(estimator)
        .ok_or_else(|| PyValueError::new_err(format!("there is no estimator {estimator}")))?;
    let options = Options {
        rows: frame,
        estimator,
        black_level: black_level_of(black_level)?,
        ..Options::default()
    };
    let geometry = geometry_of(layout);
    let rows = rows.as_array();
    let columns = py.detach(|| {
        let mut measurement = Measurement::new(geometry, options);
        let mut words = Vec::new();
        let mut columns = Columns::default();
        for row in rows.rows() {
            // The core takes the words of a row in a place where it may correct them.
            words.clear();
            words.extend(row);
            if let Some(result) = measurement.row(&mut words) {
                columns.add(&result);
            }
        }
        columns
    });
    let Columns {
        numbers,
        rows,
        fault,
    } = columns;
    Ok((
        numbers.map(|it| PyArray1::from_vec(py, it)),
        rows.map(|it| PyArray1::from_vec(py, it)),
        PyArray1::from_vec(py, fault),
    ))
}

fn black_level_of(name: &str) -> PyResult<BlackLevel> {
    match name {
        "shielded" => Ok(BlackLevel::Shielded),
        "frame" => Ok(BlackLevel::Frame),
        counts => match counts.parse() {
            Ok(counts) => Ok(BlackLevel::Fixed(Counts::from_f32(counts))),
            Err(_) => Err(PyValueError::new_err(format!(
                "there is no black level {counts}"
            ))),
        },
    }
}

fn geometry_of(layout: Layout) -> Geometry {
    let (words, light, shielded, falling, bits, electrons_per_count, saturation) = layout;
    Geometry {
        words,
        shielded: shielded.0..shielded.1,
        light: light.0..light.1,
        polarity: match falling {
            true => Polarity::Falling,
            false => Polarity::Rising,
        },
        bits,
        // One electron a count, the least gain, is 65536. `as` saturates, and makes 0 of an infinite gain.
        shot_variance_per_count_q16: (65_536.0 / electrons_per_count).round() as u16,
        saturation,
    }
}

/// The layout of the TCD1304DG's rows, as the core knows it.
#[pyfunction]
fn tcd1304dg() -> Layout {
    let head = sensor_heads::tcd1304dg();
    let electrons: Electrons = head.electrons_per_count();
    (
        head.words,
        (head.light.start, head.light.end),
        (head.shielded.start, head.shielded.end),
        head.polarity == Polarity::Falling,
        head.bits,
        electrons.to_f64(),
        head.saturation,
    )
}

/// The module `slitrange._core`.
#[pymodule]
mod _core {
    #[pymodule_export]
    use super::{centres, tcd1304dg};

    use pyo3::prelude::*;
    use slitrange::row::{LARGEST_COUNT, MAX_PIXELS};
    use slitrange::spot::MIN_PIXELS;
    use slitrange::{Estimator, Fault, frame};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("ESTIMATORS", Estimator::ALL.map(Estimator::name))?;
        module.add("FAULTS", Fault::NAMES)?;
        module.add("LARGEST_COUNT", LARGEST_COUNT)?;
        module.add("MIN_PIXELS", MIN_PIXELS)?;
        module.add("MAX_PIXELS", MAX_PIXELS)?;
        module.add("MAX_ROWS", frame::MAX_ROWS)
    }
}
