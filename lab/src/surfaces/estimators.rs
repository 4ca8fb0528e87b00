//! What each estimator's distances are worth on rough surfaces and on a quiet one, with one slit and with a
//! comb of slits.
//!
//! Eq. (1) is fitted to each estimator's own centres, as the paper does. So the errors are those of the
//! surface's light and of the noise. A calibration adds none.

use calibration::fit::eq1;
use judges::frames;
use slitrange::Options;

use crate::prelude::*;
use crate::surfaces::{MATERIALS, ROWS, TABLE, distance_within};
use crate::table;

/// Surfaces of each material. The relative standard error of an RMS of normal errors is then 1/sqrt(2000) =
/// 2.2 %. All estimators see the same rows, so their errors compare better than that.
pub const SURFACES: u64 = 1000;

/// A target without speckle and texture: what noise alone does.
const QUIET: (&str, &str) = ("quiet paper", "quiet-paper");

/// The scene whose mask has several slits.
const COMB: &str = "comb";

/// The first surface. No sensor of [`super::Study`] sees these.
const FIRST: u64 = 60_000_000;

/// A material seen through one slit or a comb: the RMS errors of rows and of frames in micrometres.
pub struct Study {
    name: &'static str,
    slits: Slits,
    errors: [[f64; 2]; Estimator::ALL.len()],
    without_distance: usize,
}

/// The centres of one surface: for each estimator that of a row and that of a frame.
type Centres = [[Option<f64>; 2]; Estimator::ALL.len()];

impl Study {
    fn run((name, scene): (&'static str, &str), slits: Slits, surfaces: u64) -> Result<Self> {
        let mut scene = Scene::load(scene)?;
        if slits == Slits::Comb {
            scene.comb = Scene::load(COMB)?.comb;
        }
        let seen: Vec<(f64, Centres)> = (FIRST..FIRST + surfaces)
            .into_par_iter()
            .map(|number| {
                let distance = distance_within(TABLE, number);
                (distance, centres(&scene, slits, number, distance))
            })
            .collect();
        let mut errors = [[f64::NAN; 2]; Estimator::ALL.len()];
        let mut without_distance = 0;
        for (i, errors) in errors.iter_mut().enumerate() {
            for (j, error) in errors.iter_mut().enumerate() {
                let points: Vec<(f64, f64)> = (seen.iter())
                    .filter_map(|(distance, centres)| Some((centres[i][j]?, *distance)))
                    .collect();
                without_distance += seen.len() - points.len();
                let curve = eq1::fit(&points).context(name)?.curve;
                let errors = (points.iter()).map(|&(x, d)| 1e6 * (curve.distance(x) - d));
                *error = rms(errors);
            }
        }
        Ok(Self {
            name,
            slits,
            errors,
            without_distance,
        })
    }
}

fn centres(scene: &Scene, slits: Slits, surface: u64, distance: f64) -> Centres {
    let simulation = Simulation::on_surface(scene.clone(), surface);
    let geometry = scene.geometry();
    let rows: Vec<Vec<u16>> = (0..u64::from(ROWS))
        .map(|row| {
            let number = u64::from(ROWS) * surface + row;
            frames::words(&simulation.row(number, distance, scene.exposure), &geometry)
        })
        .collect();
    Estimator::ALL.map(|estimator| {
        let options = with(Options::default(), |it| {
            (it.estimator, it.slits) = (estimator, slits)
        });
        [&rows[..1], &rows].map(|rows| {
            let measured = frames::measure_rows(rows, &geometry, options, None);
            Some(measured.ok()?.frame.centre.to_f64())
        })
    })
}

/// Studies all materials through one slit, and then through a comb.
pub fn measure() -> Result<Vec<Study>> {
    let names = || [QUIET].into_iter().chain(MATERIALS);
    let both = [Slits::One, Slits::Comb].into_iter();
    both.flat_map(|slits| names().map(move |name| Study::run(name, slits, SURFACES)))
        .collect()
}

pub fn report(studies: &[Study]) -> String {
    let rows = studies.iter().map(|study| {
        let slits = match study.slits {
            Slits::One => "one slit",
            Slits::Comb => "comb",
        };
        let name = format!("{}, {slits}", study.name);
        let errors = (study.errors.iter()).map(|[row, frame]| format!("{row:.1}, {frame:.1}"));
        [name].into_iter().chain(errors).collect()
    });
    let names = Estimator::ALL.map(Estimator::name).join(" | ");
    let head = format!("surface | {names}");
    let all = 2 * Estimator::ALL.len() as u64 * SURFACES * studies.len() as u64;
    let without: usize = studies.iter().map(|study| study.without_distance).sum();
    format!(
        "RMS errors in um of a row's distance, and of the distance of a frame of {ROWS} rows. Simulated on a \
         PC: a target at rest at 0.60 to 1.02 m, {SURFACES} surfaces of each material, and eq. (1) fitted to \
         each estimator's own centres. {without} of {all} rows and frames have no distance.\n\n{}",
        table::of(&head, rows)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The images of 16 slits see 16 speckle patterns: at least half of the error goes with every estimator.
    #[test]
    fn a_comb_halves_the_error_on_white_paper() {
        let [one, comb] = [Slits::One, Slits::Comb].map(|slits| {
            let study = Study::run(MATERIALS[0], slits, 24).expect("a curve");
            println!("{:.0?} um", study.errors);
            study.errors
        });
        for (one, comb) in one.as_flattened().iter().zip(comb.as_flattened()) {
            assert!(2.0 * comb < *one, "{comb} {one}");
        }
    }
}
