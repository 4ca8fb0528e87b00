//! The slit's captures through the core: rows in, the centres of frames out.

use std::sync::LazyLock;

use judges::core_tables;
use phase_tables::{Background, IntegerTable, Shape, design, gaussian};
use slitrange::centre::tables::TableSet;
use slitrange::centre::{Estimator, RowCentre, centre, phase_table};
use slitrange::row::{Geometry, Row};
use slitrange::spot::{self, Spot};

use crate::paper::apparatus::{self, Aperture, SLIT};
use crate::paper::camera::{FULL_SCALE, PITCH, ROWS, SHOT_VARIANCE_PER_COUNT_Q16};
use crate::paper::row_mean::{self, RowFit};
use simulator::field::{Image, Surface, View, every, slit_image};
use simulator::scene::Sensor;

/// Pixels of a row that are simulated, around the spot. The spot's sigma is 10 to 13 pixels and its side
/// lobes end at some 60: more than half of them are background, from which the core tells level and noise
/// (medians over blocks), and 10 sigma to either side are more than any estimator looks at. The other 1664
/// would only tell the noise better: with 384 columns the mean errors change by 1 % (`robust`: 2 %).
pub const COLUMNS: usize = 256;

/// The light is computed on every so many rows, and interpolated between them: the speckle of a spot of half
/// a millimetre is some 150 rows high. On every row, the mean errors change by 0.4 %.
const ROW_STEP: usize = 4;

/// A table whose score is nearly blind to half of what speckle does to a row.
///
/// Over a slit much narrower than a speckle, the field is E0 + E1 u. The imaginary part of E1 / E0 is a tilt
/// of the wave; it moves the pattern as a move of the spot does, and no look at a row tells the two apart.
/// The real part is a taper: one side of the slit is brighter. That does not move Fraunhofer's pattern, but
/// it does Fresnel's: with the wave's curvature at a Fresnel number of a third it adds a broad odd pattern,
/// which over the spot's core is almost a slope. A least-squares fit of a gaussian moves by 0.44 of what the
/// same tilt would move it by; a fit of the core on a background of any slope by 0.19.
pub fn speckle_table() -> IntegerTable {
    design(&gaussian, SPECKLE_SHAPE, f64::INFINITY, Background::Tilted).quantise()
}

/// Three quarters of the spot's width, and 2.5 of those to either side.
const SPECKLE_SHAPE: Shape = Shape {
    width: 8.0,
    half_width: 20,
    phases: 1,
};

/// The same as the core takes it.
static SPECKLE: LazyLock<TableSet<'static>> = LazyLock::new(|| {
    let tables = core_tables::borrow(vec![speckle_table()].leak()).leak();
    TableSet::new(tables).expect("a table that the core takes")
});

/// The image of a view, and the sensor's column at which it begins.
pub fn image(surface: &Surface, view: &View) -> anyhow::Result<(Image, usize)> {
    let centre = apparatus::centre(Aperture::Slit, view.distance);
    let first = centre.round() as usize - COLUMNS / 2;
    let place = |column| (column as f64 - centre) * PITCH;
    let columns: Vec<f64> = (first..first + COLUMNS).map(place).collect();
    let place = |row| (row as f64 - (ROWS as f64 - 1.0) / 2.0) * PITCH;
    let rows: Vec<f64> = (0..ROWS).map(place).collect();
    let image = slit_image(surface, view, &SLIT, &columns, &every(&rows, ROW_STEP))?;
    Ok((image.with_rows_between(ROW_STEP, ROWS), first))
}

pub fn density(surface: &Surface, view: &View) -> anyhow::Result<f64> {
    Ok(slit_image(surface, view, &SLIT, &[0.0], &[0.0])?.density)
}

/// The centres of a capture, by every method: a value for each of those that
/// [`Method::of`](crate::paper::methods::Method::of) names, in pixels from the image's first column, not a
/// number where there is none.
pub fn centres(counts: &[u16]) -> Vec<f64> {
    let [gaussian, fraunhofer, speckle] = fit_rows(counts);
    let found = [
        row_mean::plain(&gaussian),
        row_mean::plain(&fraunhofer),
        row_mean::towards_the_ends(&speckle),
    ];
    found.map(|centre| centre.unwrap_or(f64::NAN)).into()
}

/// The rows of a capture that have a centre: by the paper's gaussian, by Fraunhofer's pattern, and by
/// [`speckle_table`]. As the core's pipeline does, a row is searched near the spot of the row before; the
/// methods share that search.
pub fn fit_rows(counts: &[u16]) -> [Vec<RowFit>; 3] {
    // To the paper's fits all pixels have the same noise.
    let ignored = Sensor::Row(COLUMNS).geometry();
    let known = Geometry {
        shot_variance_per_count_q16: SHOT_VARIANCE_PER_COUNT_Q16,
        ..ignored.clone()
    };
    let mut found = [const { vec![] }; 3];
    let mut last_spot: Option<(Spot, RowCentre)> = None;
    let mut last: [Option<RowCentre>; 3] = [None; 3];
    for (number, row) in (0..).zip(counts.as_chunks::<COLUMNS>().0) {
        let place = 2.0 * f64::from(number) / (ROWS as f64 - 1.0) - 1.0;
        let row = Row::new(row, &[], FULL_SCALE).expect("a camera of 12 bits");
        let spot = match &last_spot {
            Some((spot, centre)) => spot::find_again(&row, spot, centre.width),
            None => spot::find(&row),
        };
        let Ok((spot, _)) = spot else {
            (last_spot, last) = (None, Default::default());
            continue;
        };
        let by = |estimator, before: Option<&RowCentre>, geometry| {
            centre(estimator, &row, &spot, before, geometry)
        };
        let [gaussian, fraunhofer, speckle] = last.each_ref().map(Option::as_ref);
        let centres = [
            by(Estimator::GaussNewton, gaussian, &ignored),
            by(Estimator::Fraunhofer, fraunhofer, &known),
            phase_table::centre(&row, &spot, speckle, &known, &SPECKLE),
        ];
        last = centres.map(Result::ok);
        for (found, centre) in found.iter_mut().zip(&last) {
            found.extend(centre.map(|centre| RowFit {
                centre: centre.centre.to_f64(),
                amplitude: centre.amplitude.to_f64(),
                place,
            }));
        }
        let before = last_spot.as_ref().map(|(_, centre)| centre);
        let tracked = by(Estimator::PhaseTable, before, &known);
        last_spot = tracked.ok().map(|centre| (spot, centre));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::apparatus::LASER;
    use phase_tables::{LEAST_SQUARES, Plan};
    use std::f64::consts::TAU;

    /// Derivatives of the pattern of a point, R away, by a taper and by a tilt of the field across the slit:
    /// at pixels from -`reach` to `reach`, in any unit that both share. With S = int exp(i phase) du and S1 =
    /// int u exp(i phase) du they are 2 Re(S* S1) and 2 Re(i S* S1).
    fn by_taper_and_tilt(range: f64, reach: i32) -> Vec<[f64; 2]> {
        const STEPS: i32 = 2000;
        let wave = TAU / LASER.wavelength;
        (-reach..=reach)
            .map(|pixel| {
                let place = f64::from(pixel) * PITCH;
                let mut sums = [0.0; 4];
                for step in 0..STEPS {
                    let u = SLIT.width * ((f64::from(step) + 0.5) / f64::from(STEPS) - 0.5);
                    let curved = 0.5 * u * u * (1.0 / range + 1.0 / SLIT.to_sensor);
                    let phase = wave * (curved - u * place / SLIT.to_sensor);
                    let (sin, cos) = phase.sin_cos();
                    for (sum, value) in sums.iter_mut().zip([cos, sin, u * cos, u * sin]) {
                        *sum += value;
                    }
                }
                let [re, im, re1, im1] = sums;
                [2.0 * (re * re1 + im * im1), 2.0 * (im * re1 - re * im1)]
            })
            .collect()
    }

    /// What a score makes of a taper, over what it makes of the same tilt.
    fn share(score: &[f64]) -> f64 {
        let derivatives = by_taper_and_tilt(0.85, score.len() as i32 / 2);
        let response = |i: usize| -> f64 {
            let products = score.iter().zip(&derivatives);
            products.map(|(weight, by)| weight * by[i]).sum()
        };
        response(0) / response(1)
    }

    #[test]
    fn a_taper_moves_tables_that_ignore_a_slope_less() {
        let of = |plan: Plan, shape| {
            let table = design(&gaussian, shape, plan.noise_ratio, plan.background);
            share(table.score[0].as_slice()).abs()
        };
        let speckle = of(phase_tables::LOPSIDED, SPECKLE_SHAPE);
        let [lopsided, fit] =
            [phase_tables::LOPSIDED, LEAST_SQUARES].map(|it| of(it, it.shape(10.5)));
        println!(
            "taper over tilt: {speckle:.3}, the firmware's {lopsided:.3}, least squares {fit:.3}"
        );
        assert!((speckle - 0.19).abs() < 0.02 && (lopsided - 0.36).abs() < 0.02);
        assert!((fit - 0.44).abs() < 0.02);
    }
}
