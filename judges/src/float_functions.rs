//! What an approximate exponential does to a centre.
//!
//! The fit computes e = exp(-u^2 / 2) at one pixel, and its ratio to the next. From these a recurrence gives
//! all other pixels, so that a relative error of the ratio grows with the distance. Here the same recurrence
//! and the same fit as in the core run with any function for the exponential.

use crate::accuracy::{Cell, centre_of};
use nalgebra::{Matrix4, Vector4};
use slitrange::spot;
use slitrange::{Estimator, Geometry, Row};
use statistics::rms;

/// Samples on either side of the spot: half of the window of `gauss-newton`.
const HALF_WINDOW: usize = 64;
/// Steps of the fit. Four steps are enough for each row here; the others change nothing.
const STEPS: usize = 8;
/// Widths in pixels. Samples of the fit are single pixels up to 12.8.
pub const WIDTHS: [f64; 6] = [0.8, 1.2, 2.0, 4.5, 8.6, 12.0];

/// Rows of a bright spot with shot and read noise. Each lies at another place within a pixel.
pub const fn cell(width: f64) -> Cell {
    Cell {
        width,
        amplitude: 2000.0,
        read_noise: 4.0,
        electrons_per_count: Some(5.0),
        rows: 200,
        seed: 17,
    }
}

/// An exponential.
pub type Exp = fn(f32) -> f32;

/// The places u and the values of e outwards from `u` in steps of `pitch`, as the core computes them.
fn outwards(exp: Exp, mut u: f32, pitch: f32) -> impl Iterator<Item = (f32, f32)> {
    let mut e = exp(-0.5 * u * u);
    let mut ratio = exp(-pitch * (u + 0.5 * pitch));
    let falls = exp(-pitch * pitch);
    std::iter::from_fn(move || {
        let this = (u, e);
        u += pitch;
        e *= ratio;
        ratio *= falls;
        Some(this)
    })
}

#[derive(Clone, Copy)]
struct Parameters {
    centre: f32,
    s: f32,
    amplitude: f32,
    level: f32,
}

/// The fit of `gauss-newton`, for widths whose samples are single pixels.
///
/// It starts from the core's centre. The sums are in f32 as in the core. The equations are solved in f64, so
/// that the exponential makes the difference between two fits.
pub fn fitted_centre(exp: Exp, geometry: &Geometry, light: &[u16]) -> Option<f64> {
    let found = centre_of(geometry, light, Estimator::GaussNewton).ok()?;
    let row = Row::new(light, &[], 4095).ok()?;
    let background = spot::find(&row).ok()?.0.background;
    let (noise, shot) = background.variances(geometry);
    let first = (found.centre.to_f64() as usize).saturating_sub(HALF_WINDOW);
    let end = (first + 2 * HALF_WINDOW).min(light.len());
    let level = background.level.to_f32();
    let light = light[first..end].iter();
    let samples: Vec<f32> = light.map(|&count| f32::from(count) - level).collect();
    let width = found.width.to_f32();
    let mut at = Parameters {
        centre: (found.centre.to_f64() - first as f64) as f32,
        s: (width * width + 1.0 / 12.0).sqrt(),
        amplitude: found.amplitude.to_f32(),
        level: 0.0,
    };
    for _ in 0..STEPS {
        at = step(exp, &samples, at, noise, shot)?;
    }
    Some(f64::from(at.centre) + first as f64)
}

fn step(exp: Exp, samples: &[f32], at: Parameters, noise: f32, shot: f32) -> Option<Parameters> {
    let middle = ((at.centre + 0.5) as usize).min(samples.len());
    let (left, right) = samples.split_at(middle);
    let pitch = 1.0 / at.s;
    let u = (middle as f32 - at.centre) * pitch;
    let right = right.iter().zip(outwards(exp, u, pitch));
    let left = left.iter().rev().zip(outwards(exp, u - pitch, -pitch));
    let (mut matrix, mut vector) = (Matrix4::<f32>::zeros(), Vector4::<f32>::zeros());
    for (&count, (u, e)) in right.chain(left) {
        let weight = 1.0 / (noise + shot * at.amplitude * e);
        let gradient = Vector4::new(1.0, e, u * u * e, u * e);
        let residual = (count - at.level) / at.amplitude - e;
        matrix += weight * gradient * gradient.transpose();
        vector += weight * residual * gradient;
    }
    let solved = matrix.cast::<f64>().cholesky()?;
    let solved = solved.solve(&vector.cast::<f64>());
    let [b, a, s, c] = [solved[0], solved[1], solved[2], solved[3]].map(|it| it as f32);
    Some(Parameters {
        centre: at.centre + c.clamp(-1.0, 1.0) * at.s,
        s: at.s * (1.0 + s.clamp(-0.5, 0.5)),
        amplitude: at.amplitude * (1.0 + a.clamp(-0.5, 0.5)),
        level: at.level + b * at.amplitude,
    })
}

/// The root mean square of what an exponential changes in the centres of a cell's rows, in pixels, compared
/// with those by another one.
pub fn change_of_centre(cell: &Cell, exp: Exp, other: Exp) -> f64 {
    let geometry = cell.scene().geometry();
    let changes: Vec<f64> = (0..cell.rows)
        .filter_map(|row| {
            let (light, _) = cell.light(cell.pixels(), row);
            let [a, b] = [exp, other].map(|exp| fitted_centre(exp, &geometry, &light));
            Some(a? - b?)
        })
        .collect();
    assert!(changes.len() as u64 == cell.rows, "each row has a centre");
    rms(changes)
}
