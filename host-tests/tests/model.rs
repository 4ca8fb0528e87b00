//! The core's fixed-point algorithms in f64. Nothing is rounded here, so a difference shows what the core's
//! rounding costs.

use crate::support::*;
pub mod phase_table;

/// Eq. (1) as D + K/(x - xp), in micrometres.
pub fn distance(curve: &Eq1, centre: f64) -> f64 {
    // K in Q48.16 is below 2^55: an f64 holds all but two bits of it.
    curve.d().to_f64() + curve.k() as f64 / 65536.0 / (centre - curve.pole().to_f64())
}

/// [`Estimator::Centroid`], eq. (2) over a window that moves with the centroid: of a spot that the core's
/// coarse search found, above its black level. `None` where the window reaches over the sensor's edge or does
/// not come to rest.
pub fn centroid(light: &[u16], spot: &Spot) -> Option<f64> {
    let width = half_width::width(light.into(), spot, None).ok()?;
    let half_window = 3.0 * width.to_f64();
    let level = spot.black_level.to_f64();
    let ambient = (spot.background.level.to_f64() - level) * 2.0 * half_window;
    let mut at = spot.centre as f64;
    for _ in 0..6 {
        let [first, last] = [at - half_window - 0.5, at + half_window + 0.5];
        let (first, last) = (first.ceil(), last.floor());
        if first < 0.0 || last > light.len() as f64 - 1.0 {
            return None;
        }
        let (mut gathered, mut moment) = (0.0, 0.0);
        let counts = light.iter().enumerate().take(last as usize + 1);
        for (i, &count) in counts.skip(first as usize) {
            // The window's ends cover part of a pixel.
            let weight = (half_window + 0.5 - (i as f64 - at).abs()).clamp(0.0, 1.0);
            let above = weight * (f64::from(count) - level);
            gathered += above;
            moment += above * (i as f64 - at);
        }
        // The steps are those of the spot's own light.
        let step = (moment / (gathered - ambient)).clamp(-half_window, half_window);
        at += step;
        if step.abs() <= 1.0 / 256.0 {
            return Some(at);
        }
    }
    None
}
