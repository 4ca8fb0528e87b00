//! The sensor's own spot: smooth curves of the spot's width and shape over the centre.
//!
//! Optics change slowly over the range, so the width and each of the five components is a polynomial of a low
//! degree, fitted by least squares. All points count alike: on a rough surface speckle changes the shapes by
//! more than noise does.

use nalgebra::{DMatrix, DVector};
use slitrange::base::places::PLACES;
use slitrange::centre::spot_shape::COMPONENTS;
use slitrange::check::own_spot::Profile;
use slitrange::{Calibration, Pixels};
use statistics::{least_and_most, mean};

use crate::fit::solve::Solved;
use crate::fixed::pixels;
use crate::points::KnownShape;

/// With fewer points the scatter of the shapes is not known.
const FEWEST: usize = 4;
/// The highest degree of a polynomial. It takes ten points.
const HIGHEST_DEGREE: usize = 3;
/// The least deviation of the width, over the width. The width of a spot without a flaw changes with its
/// height and its place between two pixels, by less than this.
const LEAST_WIDTH_DEVIATION: f64 = 0.002;
/// The estimator makes one combination of the five components zero, so four of them scatter.
const SCATTERING: f64 = COMPONENTS as f64 - 1.0;

/// Learns the sensor's own spot from the points that the fit kept. `None` with fewer than four points, or if
/// the points have no shapes.
pub fn of(solved: &Solved, calibration: &Calibration) -> Option<Profile> {
    let (first, last) = calibration.valid();
    let points = solved.observed.iter();
    let points = points.filter_map(|point| Some((point.centre, point.shape?)));
    let points: Vec<(f64, KnownShape)> = points.collect();
    if points.len() < FEWEST {
        return None;
    }
    let along = |centre: f64| {
        let (first, last) = (first.to_f64(), last.to_f64());
        2.0 * (centre - first) / (last - first) - 1.0
    };
    let places = Places {
        powers: HIGHEST_DEGREE.min((points.len() - 1) / 3) + 1,
        along: points.iter().map(|(centre, _)| along(*centre)).collect(),
    };
    let values = |of: &dyn Fn(&KnownShape) -> f64| {
        DVector::from_fn(points.len(), |point, _| of(&points[point].1))
    };
    let (width, width_variance) = places.fit(&values(&|it| it.shape.width_px))?;
    let mut components = [[0.0; PLACES]; COMPONENTS];
    let mut squares = 0.0;
    for (index, component) in components.iter_mut().enumerate() {
        let (at_places, variance) = places.fit(&values(&|it| it.shape.components_px[index]))?;
        *component = at_places;
        squares += variance;
    }
    let noise = mean(points.iter().map(|(_, shape)| shape.noise_px.powi(2)));
    // A curve's own variance is that of a residual times parameters over points, on average.
    let own = places.powers as f64 / points.len() as f64;
    let deviation = |variance: f64| ((variance - noise).max(0.0) + variance * own).sqrt();
    let mean_width = mean(width);
    let profile = Profile {
        first,
        last,
        width: width.map(pixels),
        width_deviation: pixels(deviation(width_variance).max(LEAST_WIDTH_DEVIATION * mean_width)),
        components: components.map(|values| values.map(pixels)),
        deviation: pixels(deviation(squares / SCATTERING)),
    };
    profile.is_sensible().then_some(profile)
}

struct Places {
    /// Parameters of a polynomial: its degree and one.
    powers: usize,
    /// The centres, -1 at the first centre of the calibration and 1 at the last.
    along: Vec<f64>,
}

impl Places {
    /// A polynomial's values at even steps from the first centre to the last, and the variance of the
    /// residuals, over their degrees of freedom. `None` if the points are at too few places.
    fn fit(&self, values: &DVector<f64>) -> Option<([f64; PLACES], f64)> {
        let matrix = DMatrix::from_fn(self.along.len(), self.powers, |point, power| {
            self.along[point].powi(power as i32)
        });
        let squares = matrix.tr_mul(&matrix);
        let parameters = squares.cholesky()?.solve(&matrix.tr_mul(values));
        let residuals = values - matrix * &parameters;
        let freedom = self.along.len() - self.powers;
        let at_places = std::array::from_fn(|place| {
            let along = 2.0 * place as f64 / (PLACES - 1) as f64 - 1.0;
            let add = |sum, factor| sum * along + factor;
            parameters.iter().rev().fold(0.0, add)
        });
        Some((at_places, residuals.norm_squared() / freedom as f64))
    }
}

/// The least and the largest width of a spot, in pixels.
pub fn widths(profile: &Profile) -> [f64; 2] {
    least_and_most(profile.width.map(Pixels::to_f64)).into()
}

/// How lopsided the sensor's own spot is, least and most, in pixels: the root of the sum of the components'
/// squares.
pub fn lopsided(profile: &Profile) -> [f64; 2] {
    let sum = |place: usize| {
        let squares = (profile.components.iter()).map(|values| values[place].to_f64().powi(2));
        squares.sum::<f64>().sqrt()
    };
    least_and_most((0..PLACES).map(sum)).into()
}
