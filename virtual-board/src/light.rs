//! What falls on the sensor head: a scene's rows for the exposures that the firmware gives, or a photograph's.

use std::sync::{Arc, Mutex, PoisonError};

use host_tests::photograph::Photograph;
use host_tests::scene::Scene;

use crate::{Exposure, FULL_SCALE, LightSource, PIXELS};

/// The target, which whoever holds a clone can move.
#[derive(Clone, Debug)]
pub struct Target(Arc<Mutex<f64>>);

impl Target {
    /// A target at a distance in metres.
    pub fn at(distance: f64) -> Self {
        Self(Arc::new(Mutex::new(distance)))
    }

    /// Moves it.
    pub fn move_to(&self, distance: f64) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = distance;
    }

    /// Where it is, in metres.
    pub fn distance(&self) -> f64 {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A scene's rows. The target stands still during an exposure: it is where it was found at the end.
pub fn of_scene(scene: Scene, target: Target) -> LightSource {
    let mut row = 0;
    Box::new(move |exposure: &Exposure| {
        row += 1;
        scene.row(row, target.distance(), exposure.duration() as f64 * 1e-9)
    })
}

/// A photograph's row as the sensor sees it: white is full scale, in the middle of the light range. Beside the picture go on
/// the noise and the level of its outermost [`BORDER`] pixels. A picture wider than the light range loses its sides.
///
/// Gives the pixels of the light range, and the pixel on which the picture begins (negative where its side is lost).
pub fn of_photograph_row(photograph: &Photograph, y: usize) -> Option<(Vec<f32>, i64)> {
    let row = photograph.row(y)?;
    let first = (LIGHT.len() as i64 - row.len() as i64) / 2;
    let counts =
        |x: usize| f32::from(row[x]) / f32::from(photograph.white()) * f32::from(FULL_SCALE);
    let border = BORDER.min(row.len());
    let light = (0..LIGHT.len() as i64)
        .map(|pixel| {
            let beyond = pixel - first - row.len() as i64;
            match usize::try_from(pixel - first) {
                Ok(x) if x < row.len() => counts(x),
                Ok(_) => counts(row.len() - 1 - beyond as usize % border),
                Err(_) => counts((first - pixel - 1) as usize % border),
            }
        })
        .collect();
    Some((light, first))
}

/// Pixels at either side of a photograph that are repeated beside it.
pub const BORDER: usize = 32;

/// The outputs of the sensor that see light.
pub const LIGHT: std::ops::Range<usize> = 32..3680;

/// All of the sensor's outputs for the pixels of its light range; the others are as dark as `level` counts.
pub fn outputs(light: &[f32], level: f32) -> Vec<f32> {
    let mut outputs = vec![level; PIXELS];
    for (output, &count) in outputs[LIGHT].iter_mut().zip(light) {
        *output = count;
    }
    outputs
}
