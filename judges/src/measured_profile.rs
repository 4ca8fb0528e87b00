//! The profile of a sensor's own spot, from rows that it read: what phase tables for that sensor are made of.
//!
//! The rows lie at many sub-pixel phases, so together they sample the profile finely. Each is moved to its
//! centre and scaled to the same height and level; a smoothing spline goes through all of their pixels.

use nalgebra::{Cholesky, DMatrix, DVector, Matrix2, Vector2};
use slitrange::centre::RowCentre;
use statistics::least_and_most;

/// A profile and the width that its spot has.
#[derive(Clone, Debug)]
pub struct MeasuredProfile {
    /// In pixels, as the estimator measured it: the mean over the rows.
    pub width: f64,
    /// Of cubic B-splines [`KNOT`] widths apart, the first of them centred one knot before -[`REACH`] widths.
    coefficients: DVector<f64>,
}

/// The profile is measured so many widths to either side; beyond it is taken for dark.
const REACH: f64 = 8.0;
/// From knot to knot, in widths: a cubic spline follows a gaussian to 1e-4 of its height.
const KNOT: f64 = 0.36;
const SPLINES: usize = (2.0 * REACH / KNOT) as usize + 4;
/// Weight of the squared third differences of the coefficients (P. Eilers and B. Marx, 1996) over that of the
/// samples of a spline: too small to bend the profile, enough to hold splines that few samples reach.
const SMOOTHNESS: f64 = 1e-4;

impl MeasuredProfile {
    /// The profile of rows whose centres an estimator found; some hundred rows smooth the noise away.
    ///
    /// # Panics
    /// Where there are no rows, or they do not reach far enough beyond the spot.
    pub fn of(rows: &[(Vec<u16>, RowCentre)]) -> Self {
        let widths = rows.iter().map(|(_, centre)| centre.width.to_f64());
        let width = widths.sum::<f64>() / rows.len() as f64;
        // Where no profile is known yet, the gaussian tells height and level of a row.
        let mut known = Self {
            width,
            coefficients: fit((0..1000).map(|i| {
                let place = (f64::from(i) / 500.0 - 1.0) * REACH;
                (place, (-0.5 * place * place).exp())
            })),
        };
        for _ in 0..3 {
            let samples = rows.iter().flat_map(|(counts, centre)| {
                let samples = known.around(counts, centre);
                let [level, height] = known.scale(&samples);
                let scaled = move |(place, count)| (place, (count - level) / height);
                samples.into_iter().map(scaled)
            });
            known.coefficients = fit(samples);
            known.normalise();
        }
        known
    }

    /// What a pixel gathers whose centre is `offset` pixels from the spot's, of a spot `width` pixels wide: a
    /// [`phase_tables::Profile`]. The pixels are scaled with the spot, which is right for the width that was
    /// measured and good for those next to it.
    pub fn at(&self, offset: f64, width: f64) -> f64 {
        self.value(offset / width)
    }

    /// Height and level of a profile are a convention: 1 where it is brightest, and 0 where it is darkest.
    fn normalise(&mut self) {
        let values = (-500..=500).map(|i| self.value(f64::from(i) / 500.0 * (REACH - KNOT)));
        let (dark, bright) = least_and_most(values);
        self.coefficients.add_scalar_mut(-dark);
        self.coefficients /= bright - dark;
    }

    fn value(&self, place: f64) -> f64 {
        let (first, weights) = splines(place);
        (0..4)
            .filter_map(|i| self.coefficients.get(first + i).map(|c| c * weights[i]))
            .sum()
    }

    /// The pixels within reach of a centre: their places in widths, and their counts.
    fn around(&self, counts: &[u16], centre: &RowCentre) -> Vec<(f64, f64)> {
        let place = |i: usize| (i as f64 - centre.centre.to_f64()) / self.width;
        let samples = counts.iter().enumerate();
        samples
            .map(|(i, &count)| (place(i), f64::from(count)))
            .filter(|(place, _)| place.abs() < REACH)
            .collect()
    }

    fn scale(&self, samples: &[(f64, f64)]) -> [f64; 2] {
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for &(place, count) in samples {
            let row = Vector2::new(1.0, self.value(place));
            normal += row * row.transpose();
            right += row * count;
        }
        (normal.try_inverse().expect("a spot and its background") * right).into()
    }
}

/// The first of the four cubic B-splines that reach to a place, and their values there.
fn splines(place: f64) -> (usize, [f64; 4]) {
    let knots = (place + REACH) / KNOT;
    let first = knots.floor();
    let (t, s) = (knots - first, 1.0 - (knots - first));
    let weights = [
        s * s * s / 6.0,
        2.0 / 3.0 - t * t + t * t * t / 2.0,
        2.0 / 3.0 - s * s + s * s * s / 2.0,
        t * t * t / 6.0,
    ];
    // Places before the first spline have none.
    if first < 0.0 {
        return (SPLINES, weights);
    }
    (first as usize, weights)
}

fn fit(samples: impl Iterator<Item = (f64, f64)>) -> DVector<f64> {
    let mut normal = DMatrix::zeros(SPLINES, SPLINES);
    let mut right = DVector::zeros(SPLINES);
    let mut count = 0.0;
    for (place, value) in samples {
        let (first, weights) = splines(place);
        for i in 0..4 {
            right[first + i] += weights[i] * value;
            for j in 0..4 {
                normal[(first + i, first + j)] += weights[i] * weights[j];
            }
        }
        count += 1.0;
    }
    for first in 0..SPLINES - 3 {
        let differences = [-1.0, 3.0, -3.0, 1.0];
        for i in 0..4 {
            for j in 0..4 {
                normal[(first + i, first + j)] +=
                    SMOOTHNESS * count / SPLINES as f64 * differences[i] * differences[j];
            }
        }
    }
    let normal = Cholesky::new(normal).expect("samples all over the reach");
    normal.solve(&right)
}
