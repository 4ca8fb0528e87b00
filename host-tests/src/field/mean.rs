//! The mean over all surfaces: every scatterer's light added up without interference.

use super::laser::Laser;
use super::slit::{SlitAperture, mean_along};
use super::source::Lit;
use super::{Image, Scattering, View};

/// The mean of [`super::slit_image`] over all surfaces without texture.
pub fn slit_mean(
    laser: &Laser,
    scattering: &Scattering,
    view: &View,
    slit: &SlitAperture,
    columns: &[f64],
    rows: &[f64],
) -> Image {
    let lit = Lit::new(laser, scattering, view);
    let places = slit.places(&lit, laser, columns);
    let across = slit.mean_across(&lit, &places, &slit.across(&lit, laser, &places, columns));
    let along = mean_along(&slit.along(&lit, laser, rows));
    let (mean, density) = slit.mean_at_centre(&lit, laser, &places);
    let light = along
        .iter()
        .flat_map(|row| {
            across[..columns.len()]
                .iter()
                .map(move |column| (row * column / mean) as f32)
        })
        .collect();
    Image {
        columns: columns.len(),
        light,
        density,
    }
}
