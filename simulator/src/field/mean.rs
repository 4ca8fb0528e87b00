//! The mean over all surfaces: every scatterer's light added up without interference.

use super::laser::Laser;
use super::lens::{LensAperture, Pupil, reach};
use super::slit::SlitAperture;
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
    let along = slit.along(&lit, laser, rows).row_sums();
    let (mean, density) = slit.mean_at_centre(&lit, laser, &places);
    let row = |row| (across.iter()).map(move |column| (row * column / mean) as f32);
    let light = along.into_iter().flat_map(row).collect();
    Image {
        columns: columns.len(),
        light,
        density,
    }
}

/// The mean of [`super::lens_image`] over all surfaces without texture, at the pixels' middles. It takes a
/// second for 50 x 50 of them: each is a sum over all light.
pub fn lens_mean(
    laser: &Laser,
    scattering: &Scattering,
    view: &View,
    lens: &LensAperture,
    field: f64,
    columns: &[f64],
    rows: &[f64],
) -> Image {
    let lit = Lit::new(laser, scattering, view);
    let pupil = Pupil::new(&lit, laser, lens, field, reach(columns, rows));
    let (mean, density) = pupil.mean_at_centre();
    let row = |&y: &f64| columns.iter().map(move |&x| (x, y));
    let places: Vec<(f64, f64)> = rows.iter().flat_map(row).collect();
    let light = pupil.mean_at(&places);
    Image {
        columns: columns.len(),
        light: light.iter().map(|light| (light / mean) as f32).collect(),
        density,
    }
}
