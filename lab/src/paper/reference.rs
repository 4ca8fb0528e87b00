//! The paper's fits in f64 beside the core's, on the same rows: whether what the core makes of a frame is
//! what the paper's method makes.

use crate::paper::data_set::{DataSet, Target};
use crate::paper::row_mean::{self, RowFit};
use crate::paper::slit_path::{self, COLUMNS};
use crate::prelude::*;
use simulator::least_squares::{self, Spot};
use simulator::sinc_fit;

/// Compares frames, the first capture at 16 positions of a data set. Gives root mean squares of the plain
/// mean of rows, core less reference, in pixels: `gauss-newton` with equal weights less
/// [`least_squares::fit_near`], and `fraunhofer` less [`sinc_fit::fit_from`]. The weights of `fraunhofer` are
/// made for a mix of read and shot noise, the reference weighs all pixels alike: in noise they are both
/// right, in speckle they differ.
pub fn compare(set: &DataSet) -> anyhow::Result<[f64; 2]> {
    let target = Target::new(set)?;
    let positions = (0..set.distances.len()).step_by(set.distances.len().div_ceil(16));
    let of_position = |position| {
        let (exposure, _) = target.expose(position)?;
        let mut counts = vec![];
        target.capture(&exposure, position, 0, &mut counts);
        let [gaussian, fraunhofer, _] = slit_path::fit_rows(&counts);
        let (gaussian_fits, sinc_fits) = reference(&counts);
        let difference = |core: &[RowFit], fits: &[f64]| {
            let core = row_mean::plain(core).filter(|_| !fits.is_empty());
            core.map(|core| core - statistics::mean(fits))
                .with_context(|| format!("no centre at position {position}"))
        };
        Ok([
            difference(&gaussian, &gaussian_fits)?,
            difference(&fraunhofer, &sinc_fits)?,
        ])
    };
    let positions: Vec<usize> = positions.collect();
    let differences = positions.into_par_iter().map(of_position);
    let differences: Vec<[f64; 2]> = differences.collect::<anyhow::Result<_>>()?;
    Ok([0, 1].map(|i| statistics::rms(differences.iter().map(|both| both[i]))))
}

/// The centres of a frame's rows by fits of eq. (5) and of eq. (6).
fn reference(counts: &[u16]) -> (Vec<f64>, Vec<f64>) {
    let (mut gaussians, mut sincs) = (vec![], vec![]);
    for row in counts.as_chunks::<COLUMNS>().0 {
        let row: Vec<f64> = row.iter().map(|&count| f64::from(count)).collect();
        // Rows that the core calls too dim have a centre that is uncertain by an eighth of the width. For the
        // reference: a height of ten times the noise.
        let Some(top) = brightest(&row) else { continue };
        let Some(fit) = least_squares::fit_near(&row, top) else {
            continue;
        };
        if fit.amplitude < 10.0 || !(3.0..40.0).contains(&fit.width) || !fit.is_whole_in(COLUMNS) {
            continue;
        }
        gaussians.push(fit.centre);
        let start = Spot {
            centre: fit.centre,
            extent: fit.width / 0.376,
            amplitude: fit.amplitude,
            level: fit.level,
        };
        sincs.extend(sinc_fit::fit_from(&row, start).map(|fit| fit.centre));
    }
    (gaussians, sincs)
}

fn brightest(row: &[f64]) -> Option<f64> {
    let sums = row.windows(16).map(|window| window.iter().sum::<f64>());
    let (start, _) = sums.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(start as f64 + 7.5)
}
