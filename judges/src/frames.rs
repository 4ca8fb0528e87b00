//! Frames of simulated rows, and a frame that is made up.

use simulator::scene::{Simulation, quantise};
use slitrange::Polarity;
use slitrange::base::fault::Fault;
use slitrange::base::units::{Counts, Pixels};
use slitrange::centre::Estimator;
use slitrange::centre::spot_shape::SpotShape;
use slitrange::check::own_spot::Profile;
use slitrange::frame::FrameCentre;
use slitrange::measurement::{Measurement, Options};
use slitrange::reading::Measured;
use slitrange::row::Geometry;
use slitrange::row::pixels::PixelErrors;
use slitrange::row::pixels::map::PixelMap;

/// The words that a sensor's converter gives for light in counts.
pub fn words(light: &[f32], geometry: &Geometry) -> Vec<u16> {
    let full_scale = geometry.full_scale();
    let mut words = quantise(light, full_scale);
    if geometry.polarity == Polarity::Falling {
        words.iter_mut().for_each(|word| *word = full_scale - *word);
    }
    words
}

/// Measures a frame of a target at rest, at a distance in metres. The rows have the scene's exposure, and
/// numbers from `first` on: other numbers have other noise.
///
/// # Errors
/// The fault of the frame.
pub fn measure(
    simulation: &Simulation,
    options: Options,
    distance: f64,
    first: u64,
    map: Option<&PixelMap>,
) -> Result<Measured, Fault> {
    let scene = simulation.scene();
    let geometry = scene.geometry();
    let mut measurement = Measurement::new(geometry.clone(), options);
    (first..first + u64::from(options.rows))
        .find_map(|row| {
            let light = simulation.row(row, distance, scene.exposure);
            measurement.row_with(&mut words(&light, &geometry), None, map)
        })
        .unwrap_or(Err(Fault::SensorSilent))
}

/// Measures a frame of rows as they were read, with the profile of the sensor's own spot if there is one.
///
/// # Errors
/// The fault of the frame.
pub fn measure_rows(
    rows: &[Vec<u16>],
    geometry: &Geometry,
    options: Options,
    profile: Option<Profile>,
) -> Result<Measured, Fault> {
    let options = Options {
        rows: rows.len() as u16,
        ..options
    };
    let mut measurement = Measurement::new(geometry.clone(), options);
    measurement.set(options, profile);
    let frames = rows.iter().map(|row| measurement.row(&mut row.clone()));
    frames.flatten().last().unwrap_or(Err(Fault::SensorSilent))
}

/// A made-up frame of 16 rows whose centre is known exactly, on pixels that do not differ.
pub fn at_centre(centre: f64) -> Measured {
    Measured {
        frame: FrameCentre {
            centre: Pixels::from_bits((centre * 65536.0).round() as i32),
            uncertainty: Pixels::from_bits(1),
            amplitude: Counts::from_int(1000),
            exposure: None,
            width: Pixels::from_int(9),
            rows_used: 16,
            rows: 16,
            misfits: 0,
            shape: SpotShape::default(),
            correlated: None,
            spread: Pixels::default(),
            motion: Pixels::default(),
        },
        black_level: Counts::from_int(300),
        ambient: Counts::default(),
        estimator: Estimator::default(),
        by_shape: Pixels::default(),
        pixels: PixelErrors {
            response_q16: 0,
            offset: Counts::default(),
        },
        comb: None,
    }
}
