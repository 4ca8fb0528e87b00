//! Every estimator is asked for a row's centre: alone, with the check that follows, and as the whole
//! measurement that turns rows into readings.

use slitrange::centre::spot_shape::SpotShape;
use slitrange::centre::{self, WidthClass};
use slitrange::distance::eq1::Eq1;
use slitrange::measurement::centre_of_spot;
use slitrange::reading::uncertainty::{FittedErrors, FittedSurface};
use slitrange::spot;
use slitrange::{
    BlackLevel, Calibration, CalibrationErrors, Counts, Estimator, Fault, Geometry, Mean,
    Measurement, Micrometres, Options, Pixels, Polarity, Reading, RowCentre, Surface,
};

/// Rows that make a reading.
pub const ROWS: u16 = 2;

/// The most words that a row is answered with: for each estimator two centres or faults, and a reading.
pub const MOST_WORDS: usize = Estimator::ALL.len() * (2 * 8 + 14);

/// A measurement for each estimator, with the row before in it. They take 85 KB. On the chip they are a
/// static variable, because the stack has no room to move them.
pub struct Estimators {
    geometry: Geometry,
    measurements: [Option<Measurement>; Estimator::ALL.len()],
}

impl Estimators {
    /// Has no measurements yet.
    pub const fn new() -> Self {
        Self {
            geometry: geometry(0, 0, 0),
            measurements: [const { None }; Estimator::ALL.len()],
        }
    }

    /// Starts new measurements, for rows of so many pixels that see light, of a converter of so many bits.
    pub fn start(&mut self, pixels: usize, bits: u8, shot_variance_per_count_q16: u16) {
        self.geometry = geometry(pixels, bits, shot_variance_per_count_q16);
        for (estimator, place) in Estimator::ALL.into_iter().zip(&mut self.measurements) {
            let options = Options {
                rows: ROWS,
                mean: Mean::Weighted,
                estimator,
                black_level: BlackLevel::Frame,
                ..Options::default()
            };
            start_one(place, &self.geometry, options);
        }
    }

    /// Asks every estimator, in the order of [`Estimator::ALL`], and says its words. Says nothing before
    /// [`start`](Self::start).
    pub fn ask(&mut self, light: &mut [u16], mut say: impl FnMut(Estimator, u32)) {
        let (calibration, errors) = (every_centre(), some_errors());
        for (estimator, measurement) in Estimator::ALL.into_iter().zip(&mut self.measurements) {
            let Some(measurement) = measurement else {
                return;
            };
            let mut say = |word| say(estimator, word);
            let found = self.geometry.row(light).map_err(|_| Fault::SensorSilent);
            let found = found.and_then(|row| Ok((row, spot::find(&row)?)));
            let alone = found.and_then(|(row, (spot, _))| {
                centre::centre(estimator, &row, &spot, None, &self.geometry)
            });
            say_centre(alone, &mut say);
            let checked = found.and_then(|(row, (spot, budget))| {
                centre_of_spot(estimator, &row, &spot, None, &self.geometry, None, budget)
            });
            say_centre(checked, &mut say);
            if let Some(result) = measurement.row(light) {
                let result = result.and_then(|measured| {
                    measured.reading(calibration.as_ref(), &errors, Surface::Auto)
                });
                say_reading(result, &mut say);
            }
        }
    }
}

impl Default for Estimators {
    fn default() -> Self {
        Self::new()
    }
}

/// Makes a measurement. Inlined, it would leave a copy of 15 KB on the chip's stack for each estimator.
#[inline(never)]
fn start_one(place: &mut Option<Measurement>, geometry: &Geometry, options: Options) {
    *place = Some(Measurement::new(geometry.clone(), options));
}

/// Rows whose pixels all see light.
const fn geometry(pixels: usize, bits: u8, shot_variance_per_count_q16: u16) -> Geometry {
    Geometry {
        words: pixels,
        shielded: 0..0,
        light: 0..pixels,
        polarity: Polarity::Rising,
        bits,
        shot_variance_per_count_q16,
        saturation: slitrange::row::LARGEST_COUNT,
    }
}

/// Eq. (1) with a distance for every centre on a row: of 1 m at pixel 0, 0.52 m at pixel 3680.
fn every_centre() -> Option<Calibration> {
    let valid = Pixels::from_int(-1)..=Pixels::from_int(4096);
    // 4e9 um px over 4000 px from the pole.
    let curve = Eq1::new(
        Micrometres::from_int(0),
        4_000_000_000 << 16,
        Pixels::from_int(-4000),
        valid,
    );
    curve.ok().map(Calibration::Eq1)
}

/// Errors that differ from place to place.
fn some_errors() -> CalibrationErrors {
    let rising = |step: i32| core::array::from_fn(|place| 5000 + step * place as i32);
    CalibrationErrors::Fitted(FittedErrors {
        curve: rising(777).map(Micrometres::from_bits),
        surface: Some(FittedSurface {
            deviation: rising(9999).map(Micrometres::from_bits),
            height: rising(55_555).map(Counts::from_bits),
        }),
    })
}

fn say_centre(answer: Result<RowCentre, Fault>, say: &mut impl FnMut(u32)) {
    match answer {
        Ok(RowCentre {
            centre,
            uncertainty,
            amplitude,
            width,
            class,
            shape,
            misfit,
        }) => {
            let WidthClass { set, table, block } = class;
            say(0);
            for bits in [
                centre.to_bits(),
                uncertainty.to_bits(),
                amplitude.to_bits(),
                width.to_bits(),
            ] {
                say(bits as u32);
            }
            say(u32::from_le_bytes([set, table, block, u8::from(misfit)]));
            let SpotShape {
                components,
                width,
                noise,
                rest,
            } = shape;
            for bits in components.into_iter().chain([width, noise, rest]) {
                say(bits.to_bits() as u32);
            }
        }
        Err(fault) => say_fault(fault, say),
    }
}

fn say_reading(answer: Result<Reading, Fault>, say: &mut impl FnMut(u32)) {
    match answer {
        Ok(Reading {
            distance,
            uncertainty,
            centre,
            centre_uncertainty,
            amplitude,
            exposure: _,
            width,
            rows_used,
            rows,
            slits_used,
            black_level,
            estimator: _,
            misfits,
            correlated,
            parts,
            is_nominal: _,
            has_other_settings: _,
        }) => {
            say(0);
            for (_, part) in parts.named() {
                say(part.to_bits() as u32);
            }
            for bits in [
                distance.to_bits(),
                uncertainty.to_bits(),
                centre.to_bits(),
                centre_uncertainty.to_bits(),
                amplitude.to_bits(),
                width.to_bits(),
                black_level.to_bits(),
            ] {
                say(bits as u32);
            }
            for number in [rows_used, rows, misfits, slits_used.into()] {
                say(u32::from(number));
            }
            say(correlated.map_or(u32::MAX, u32::from));
        }
        Err(fault) => say_fault(fault, say),
    }
}

fn say_fault(fault: Fault, say: &mut impl FnMut(u32)) {
    say(1 + fault.kind() as u32);
    let bits = match fault {
        Fault::SensorSilent => [0, 0],
        Fault::NoSpot { amplitude } => [amplitude.to_bits(), 0],
        Fault::TooDim { amplitude, needed } => [amplitude.to_bits(), needed.to_bits()],
        Fault::Saturated { pixels } => [i32::from(pixels), 0],
        Fault::SpotAtEdge { centre } | Fault::OutOfRange { centre } => [centre.to_bits(), 0],
        Fault::TwoSpots { centre, other } => [centre.to_bits(), other.to_bits()],
        Fault::Unsteady { scatter } => [scatter.to_bits(), 0],
        Fault::NotCalibrated {
            centre,
            uncertainty,
        } => [centre.to_bits(), uncertainty.to_bits()],
        Fault::FewSlits { found, needed } => [found.into(), needed.into()],
        Fault::SlitsUnclear { images, other } => [images.into(), other.into()],
        Fault::DimAtLongest {
            amplitude,
            exposure,
        } => [amplitude.to_bits(), exposure.us().into()],
        Fault::SaturatedAtShortest { pixels, exposure } => [pixels.into(), exposure.us().into()],
        Fault::LaserOff => [0, 0],
        Fault::Spike { step } => [step.to_bits(), 0],
    };
    for bits in bits {
        say(bits as u32);
    }
}
