//! Stands in for the lens of `crate::field` until that is merged.
#![allow(missing_docs)]
use crate::field::{Image, Surface, View};
pub struct LensAperture {
    pub diameter: f64,
    pub focal_length: f64,
    pub focus_distance: f64,
    pub coma: f64,
    pub full_field: f64,
    pub pixel: f64,
    pub samples: usize,
}
impl LensAperture {
    pub fn to_sensor(&self) -> f64 {
        1.0 / (1.0 / self.focal_length - 1.0 / self.focus_distance)
    }
}
fn wiggle(seed: u64, a: f64) -> f64 {
    (a * 1.7 + seed as f64).sin() + (a * 0.61 + 2.0 * seed as f64).cos()
}
pub fn lens_image(
    _: &Surface,
    v: &View,
    _: &LensAperture,
    columns: &[f64],
    rows: &[f64],
) -> anyhow::Result<Image> {
    let shift = 2e-6 * wiggle(1, v.distance * 300.0);
    let light = rows
        .iter()
        .flat_map(|y| {
            columns.iter().map(move |x| {
                (-0.5 * (((x - shift).powi(2) + y * y) / 24e-6f64.powi(2))).exp() as f32
            })
        })
        .collect();
    Ok(Image {
        columns: columns.len(),
        light,
        density: 1.0,
    })
}
