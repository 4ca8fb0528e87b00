//! Stands in for `crate::field` until that is merged.
#![allow(missing_docs)]
pub struct Laser { pub wavelength: f64, pub linewidth: f64, pub waist_diameter: f64, pub waist_distance: f64 }
pub struct Scattering { pub polarisations: usize, pub path_spread: f64 }
pub struct Surface { seed: u64 }
impl Surface { pub fn new(_: &Laser, _: &Scattering, seed: u64) -> Self { Self { seed } } }
pub struct View { pub distance: f64, pub baseline: f64, pub lateral: f64 }
pub struct SlitAperture { pub width: f64, pub height: f64, pub to_sensor: f64 }
pub struct LensAperture { pub diameter: f64, pub focal_length: f64, pub focus_distance: f64, pub coma: f64, pub full_field: f64 }
pub struct Image { pub columns: usize, pub light: Vec<f32> }
fn wiggle(seed: u64, a: f64) -> f64 { (a * 1.7 + seed as f64).sin() + (a * 0.61 + 2.0 * seed as f64).cos() }
pub fn slit_image(s: &Surface, v: &View, _: &SlitAperture, columns: &[f64], rows: &[f64]) -> Image {
    let mut light = vec![];
    for y in rows {
        let shift = 6e-6 * wiggle(s.seed, v.distance * 300.0 + y / 0.4e-3);
        let height = if y.abs() < 1.59e-3 { 1.0 + 0.5 * wiggle(s.seed + 7, v.distance * 300.0 + y / 0.4e-3) } else { 0.0 };
        light.extend(columns.iter().map(|x| (height.max(0.0) * (-0.5 * ((x - shift) / 64e-6f64).powi(2)).exp()) as f32));
    }
    Image { columns: columns.len(), light }
}
pub fn lens_image(s: &Surface, v: &View, _: &LensAperture, columns: &[f64], rows: &[f64]) -> Image {
    let shift = 2e-6 * wiggle(s.seed, v.distance * 300.0);
    let light = rows.iter().flat_map(|y| columns.iter().map(move |x| (-0.5 * (((x - shift).powi(2) + y * y) / 24e-6f64.powi(2))).exp() as f32)).collect();
    Image { columns: columns.len(), light }
}
