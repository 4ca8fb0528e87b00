//! Frames of simulated rows, a frame that is made up, and each kind of fault.

use simulator::scene::{Simulation, quantise};
use simulator::with;
use slitrange::base::exposure::Exposure;
use slitrange::centre::spot_shape::SpotShape;
use slitrange::check::own_spot::Profile;
use slitrange::frame::FrameCentre;
use slitrange::row::pixels::PixelErrors;
use slitrange::row::pixels::map::PixelMap;
use slitrange::{
    Counts, Estimator, Fault, Geometry, Measured, Measurement, Micrometres, Options, Pixels,
    Polarity,
};

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
    let options = with(options, |it| it.rows = rows.len() as u16);
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

/// Each kind of fault, with these numbers.
pub fn faults(bits: [i32; 2], [pixels, other_pixels]: [u16; 2]) -> [Fault; Fault::KINDS] {
    let [centre, other] = bits.map(Pixels::from_bits);
    let [amplitude, needed] = bits.map(Counts::from_bits);
    let (scatter, uncertainty, step) = (centre, other, Micrometres::from_bits(bits[0]));
    let (found, images) = (pixels, pixels);
    [
        Fault::SensorSilent,
        Fault::NoSpot { amplitude },
        Fault::TooDim { amplitude, needed },
        Fault::Saturated { pixels },
        Fault::SpotAtEdge { centre },
        Fault::TwoSpots { centre, other },
        Fault::Unsteady { scatter },
        Fault::OutOfRange { centre },
        Fault::NotCalibrated {
            centre,
            uncertainty,
        },
        Fault::FewSlits {
            found,
            needed: other_pixels,
        },
        Fault::SlitsUnclear {
            images,
            other: other_pixels,
        },
        Fault::DimAtLongest {
            amplitude,
            exposure: Exposure::LONGEST,
        },
        Fault::SaturatedAtShortest {
            pixels,
            exposure: Exposure::SHORTEST,
        },
        Fault::LaserOff,
        Fault::Spike { step },
    ]
}
