//! A target whose brightness changes, seen by a sensor with auto exposure: rows go in, exposures come out,
//! with the firmware's delay between them.

pub mod ambient;
pub mod jumps;
pub mod range;

use crate::frames::words;
use simulator::scene::{Exposure as Times, Scene, Simulation};
use simulator::with;
use slitrange::base::exposure::Exposure;
use slitrange::light::ambient::AmbientMode;
use slitrange::{Calibration, CalibrationErrors, Fault, Measured, Measurement, Options, Surface};
use std::collections::VecDeque;

/// Counts a second at the peak of the spot on the brightest target, with a reflectivity of 1: bright metal
/// that shines towards the slit. The shortest exposure then gives 3000 counts. White paper has a thousandth
/// of it (`scenes/quiet-paper.toml`), and black tape a ten thousandth.
pub const BRIGHTEST: f64 = 3e8;
/// Rows from the one that a new exposure follows from to the first one that has it. A row is computed while
/// the next one is read and the one after is exposed, and the laser's pulse for the next is started before
/// the computation ends.
pub const DELAY: usize = 3;
/// Seconds from row to row.
const ROW_PERIOD: f64 = 5.7e-3;

/// A sensor before a target of some reflectivity.
pub struct Sensor {
    simulation: Simulation,
    measurement: Measurement,
    /// The exposures of the next rows, in their order.
    chosen: VecDeque<Exposure>,
    row: u64,
    /// For how many seconds the laser shone on a target of reflectivity 1 in the row before.
    laser_before: f64,
    /// The target's distance in metres.
    distance: f64,
    /// Light that is not the laser's, added to the pixels that see light.
    lamp: fn(&mut [f32]),
}

impl Sensor {
    /// A sensor that sees this scene, in which the spot has [`BRIGHTEST`] for a reflectivity of 1.
    pub fn new(scene: Scene, options: Options) -> Self {
        let scene = scene.with_height(BRIGHTEST);
        let measurement = Measurement::new(scene.geometry(), options);
        let first = measurement.next_exposure();
        Self {
            distance: scene.distance,
            simulation: Simulation::new(scene),
            measurement,
            chosen: [first; DELAY].into(),
            row: 0,
            laser_before: 0.0,
            lamp: |_| (),
        }
    }

    /// The same sensor in the light of a lamp.
    pub fn with_lamp(self, lamp: fn(&mut [f32])) -> Self {
        Self { lamp, ..self }
    }

    /// Moves the target to a distance in metres.
    pub fn move_to(&mut self, distance: f64) {
        self.distance = distance;
    }

    /// Shows a row of a target of this reflectivity, 0 to 1, after a row with the laser off if the ambient
    /// light is subtracted. Gives the exposure, and the frame's result if the row ends a frame.
    pub fn row(&mut self, reflectivity: f64) -> (Exposure, Option<Result<Measured, Fault>>) {
        if self.measurement.options().ambient == AmbientMode::Subtract {
            let words = self.words(0.0);
            self.measurement.ambient_row(&words);
        }
        let exposure = self.chosen.pop_front().expect("as many as the delay");
        // The light is proportional to both.
        let mut words = self.words(f64::from(exposure.us()) * 1e-6 * reflectivity);
        let result = self.measurement.row_with(&mut words, Some(exposure), None);
        self.chosen.push_back(self.measurement.next_exposure());
        (exposure, result)
    }

    /// The words of the next row, in which the laser shone for so many seconds on a target of reflectivity 1.
    fn words(&mut self, laser: f64) -> Vec<u16> {
        self.row += 1;
        let times = Times {
            row: ROW_PERIOD,
            laser,
            laser_before: std::mem::replace(&mut self.laser_before, laser),
        };
        let geometry = self.simulation.scene().geometry();
        let mut light = self.simulation.row(self.row, self.distance, times);
        (self.lamp)(&mut light[geometry.light.clone()]);
        words(&light, &geometry)
    }

    /// Drops the frame under way.
    pub fn start_frame(&mut self) {
        self.measurement.start_frame();
    }

    /// Shows whole frames, and gives the results.
    pub fn frames(&mut self, reflectivity: f64, frames: usize) -> Vec<Result<Measured, Fault>> {
        let mut results = vec![];
        while results.len() < frames {
            results.extend(self.row(reflectivity).1);
        }
        results
    }

    /// The true centre in pixels.
    pub fn true_centre(&self) -> f64 {
        self.simulation.scene().optics.centre(self.distance)
    }

    /// Compares a frame with the truth.
    ///
    /// # Panics
    /// The centre is outside of the range of the nominal calibration.
    pub fn compare(&self, measured: &Measured) -> Comparison {
        let calibration = Calibration::nominal().expect("a curve");
        let errors = CalibrationErrors::Unknown;
        let reading = measured
            .reading(Some(&calibration), &errors, Surface::Off)
            .expect("a place in the middle of the range");
        let (_, um_per_pixel) = calibration.distance_at(reading.centre).expect("in range");
        let parts = reading.parts;
        let squares = [parts.noise, parts.shape, parts.motion].map(|it| it.to_f64().powi(2));
        let error = measured.frame.centre.to_f64() - self.true_centre();
        Comparison {
            error_um: error * f64::from(um_per_pixel),
            r_um: parts.noise.to_f64(),
            claim_um: squares.iter().sum::<f64>().sqrt(),
            u_um: reading.uncertainty.to_f64(),
            is_flagged: 2 * reading.misfits > reading.rows_used || reading.correlated.is_some(),
        }
    }
}

/// A frame compared with the truth, as distances in micrometres. The simulated target has no speckle, and the
/// simulated pixels are all alike.
#[derive(Clone, Copy, Debug)]
pub struct Comparison {
    /// The error.
    pub error_um: f64,
    /// The repeatability r.
    pub r_um: f64,
    /// What the rows claim: noise, shape and motion. The parts of u that have no counterpart here are left
    /// out, so this claim is stricter than u.
    pub claim_um: f64,
    /// u without the surface's part and without the calibration's. Its largest part is that of the pixels.
    pub u_um: f64,
    /// Whether the reading has the flag `m` for most of its rows, or the flag `c`.
    pub is_flagged: bool,
}

impl Comparison {
    /// The size of the error over the claim of the rows.
    pub fn error_over_claim(&self) -> f64 {
        (self.error_um / self.claim_um).abs()
    }

    /// The size of the error over u.
    pub fn error_over_u(&self) -> f64 {
        (self.error_um / self.u_um).abs()
    }
}

/// White paper's scene with a sensor that saturates: a well of 4000 counts, of which a tenth of the charge
/// beyond flows over (`scenes/saturated.toml`).
pub fn scene() -> Scene {
    let saturation = Scene::load("saturated").expect("a scene").saturation;
    with(Scene::white_paper(), |it| it.saturation = saturation)
}
