//! Which points do not belong: judged against eq. (1) and a smooth curve on top of it, so that no good point
//! of a sensor is lost that departs from eq. (1) smoothly.
//!
//! ```text
//! start (3 points) -> smooth curve by least absolute residuals
//!     -> Tukey's biweight, penalty by cross-validation -> verdicts
//! ```
//!
//! None of the steps lets a point that is far off have more weight than one that is not: however far off
//! outliers are, they move nothing. A point whose weight by the biweight is zero is rejected; all others
//! count in full in the fit that follows, which loses nothing against a fit that knew beforehand which points
//! are good.

use statistics::{least_and_most, median};

use super::eq1::Eq1;
use super::observed::{Observed, Weights};
use super::spline::{Equations, Grid, Residual, Spline, most_freedoms, penalties};

/// Where the biweight ends, in standard deviations: 95 % efficiency in gaussian noise (J. Tukey).
const REACH: f64 = 4.685;
/// The standard deviation of a gaussian over its median absolute deviation.
const BY_MEDIAN: f64 = 1.4826;
/// The least scatter in pixels is the last digit of a centre: rounding is no reason to reject a point.
const LEAST_SCATTER: f64 = 1e-5;
/// A curve is less certain where it is continued beyond its points than its own variance says, which takes it
/// to bend there as it does elsewhere: that counts so many times. Chosen: with 1, 6 of 9000 good points were
/// rejected (60 a row, distorted by 100 to 490 um), all at the ends; with 2 none.
const EXTRAPOLATED: f64 = 2.0;
/// Rounds of least absolute residuals.
const ABSOLUTE_ROUNDS: usize = 20;
/// Rounds of the biweight at most.
const ROUNDS: usize = 30;

/// What became of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// How far it is off, in standard deviations, from the curve that the others make.
    pub off: f64,
    /// Whether it counts.
    pub kept: bool,
}

/// Judges points against curves near a start. `None` where there is no smooth curve through them.
///
/// Where the points' uncertainties are known, their scatter is not taken to be less, however well a curve
/// goes through most of them: of a dozen points it does so by chance.
pub fn judge(points: &[Observed], weights: Weights, start: &Eq1) -> Option<Vec<Verdict>> {
    let least_scatter = match weights {
        Weights::Known => 1.0,
        Weights::Alike => 0.0,
    };
    let residuals: Vec<Judged> = points.iter().map(|it| Judged::of(it, start)).collect();
    let grid = grid(&residuals)?;
    let (weights, spline) = stiffest(grid, &residuals)?;
    let first = judge_by(&residuals, &weights, &spline, least_scatter);
    biweight(grid, &residuals, first, least_scatter)
}

/// Judges again and again with weights by the verdicts before, until they stay.
fn biweight(
    grid: Grid,
    residuals: &[Judged],
    first: Vec<Verdict>,
    least_scatter: f64,
) -> Option<Vec<Verdict>> {
    let mut verdicts = first;
    for _ in 0..ROUNDS {
        let weight = |it: &Verdict| (1.0 - (it.off / REACH).powi(2)).max(0.0).powi(2);
        let weights: Vec<f64> = verdicts.iter().map(weight).collect();
        let equations = equations(grid, residuals, &weights);
        let spline = equations.solve(equations.best_penalty()?)?;
        let next = judge_by(residuals, &weights, &spline, least_scatter);
        let same = |(a, b): (&Verdict, &Verdict)| {
            a.kept == b.kept && (!a.kept || (a.off - b.off).abs() < 1e-3)
        };
        let settled = verdicts.iter().zip(&next).all(same);
        verdicts = next;
        if settled {
            break;
        }
    }
    Some(verdicts)
}

/// The stiffest curve with the least absolute residuals from which the points are hardly further than from
/// any other, each from the curve that the others make, and an outlier however far: a curve that bends more
/// than it must could follow an outlier at its end. With the weights that belong to it.
fn stiffest(grid: Grid, residuals: &[Judged]) -> Option<(Vec<f64>, Spline)> {
    let curves: Vec<(Vec<f64>, Vec<f64>, Spline)> = penalties()
        .step_by(2)
        .filter_map(|penalty| least_absolute(grid, residuals, penalty))
        .take_while(|(_, spline)| spline.freedoms <= most_freedoms(residuals.len() as f64))
        .map(|(weights, spline)| (off_others(residuals, &weights, &spline), weights, spline))
        .collect();
    let (scatter, _) = least_and_most(curves.iter().map(|(off, ..)| BY_MEDIAN * median(off)));
    let error = |off: &[f64]| -> f64 {
        let squares = off.iter().map(|off| (off / scatter).min(REACH).powi(2));
        squares.sum()
    };
    let (least, _) = least_and_most(curves.iter().map(|(off, ..)| error(off)));
    let is_near = |off: &[f64]| error(off) <= least + 0.5 * REACH.powi(2);
    let stiffest = curves.into_iter().find(|(off, ..)| is_near(off));
    stiffest.map(|(_, weights, spline)| (weights, spline))
}

/// How far each point is from the curve that the others make, over its own uncertainty.
fn off_others(residuals: &[Judged], weights: &[f64], spline: &Spline) -> Vec<f64> {
    let without = without_each(residuals, weights, spline);
    let all = without.into_iter().zip(residuals);
    all.map(|((off, _), residual)| (off / residual.sigma).abs())
        .collect()
}

/// The curve with the least sum of absolute residuals and of the penalty, and the weights by which least
/// squares gives it.
fn least_absolute(grid: Grid, residuals: &[Judged], penalty: f64) -> Option<(Vec<f64>, Spline)> {
    let mut weights = Vec::new();
    // Beginning with the start's own residuals, which no outlier has moved.
    let mut values = vec![0.0; residuals.len()];
    for _ in 0..ABSOLUTE_ROUNDS {
        let off: Vec<f64> = (residuals.iter().zip(values))
            .map(|(residual, value)| (residual.value - value).abs() / residual.sigma)
            .collect();
        let middle = median(&off);
        // Where half of the points lie on the curve, the others do not count.
        let middle = middle.max(f64::MIN_POSITIVE);
        // Down to a hundredth of the median: a point that is met by chance must not count without end.
        let weight = |off: f64| 1.0 / (off / middle).max(0.01);
        weights = off.into_iter().map(weight).collect();
        let at = residuals.iter().map(|residual| residual.at);
        values = equations(grid, residuals, &weights).values(penalty, at)?;
    }
    let spline = equations(grid, residuals, &weights).solve(penalty)?;
    Some((weights, spline))
}

/// A point's residual from the start.
struct Judged {
    /// The distance by the start.
    at: f64,
    value: f64,
    /// Its standard uncertainty for its weight.
    sigma: f64,
    /// The same to judge it by, and what it is at least. The lesser of those with the slope at its centre and
    /// with that at its distance: a centre that is off towards the pole must not pass for uncertain.
    strict: f64,
    least: f64,
}

impl Judged {
    fn of(point: &Observed, start: &Eq1) -> Self {
        let here = start.slope(point.centre).abs();
        let there = start.slope(start.centre(point.distance)).abs();
        let lesser = here.min(there);
        Self {
            at: start.distance(point.centre),
            value: point.residual(start),
            sigma: point.sigma(start),
            strict: point.sigma_at(lesser),
            least: lesser * LEAST_SCATTER,
        }
    }

    /// A centre on the pole has none.
    fn is_finite(&self) -> bool {
        self.value.is_finite() && self.sigma.is_finite() && self.sigma > 0.0
    }

    fn from(&self, spline: &Spline) -> f64 {
        self.value - spline.at(self.at)
    }
}

/// Over the distances of the points. Distances far beyond the others, which only an outlier makes, must not
/// stretch it.
fn grid(residuals: &[Judged]) -> Option<Grid> {
    let finite = residuals.iter().filter(|residual| residual.is_finite());
    let mut places: Vec<f64> = finite.map(|residual| residual.at).collect();
    places.sort_by(f64::total_cmp);
    let tenth = places.len() / 10;
    let (low, high) = (*places.get(tenth)?, *places.get(places.len() - 1 - tenth)?);
    let room = 2.0 * (high - low);
    let first = places.first()?.max(low - room);
    let last = places.last()?.min(high + room);
    (first < last).then(|| Grid::new(first, last, places.len()))
}

fn equations(grid: Grid, residuals: &[Judged], weights: &[f64]) -> Equations {
    let weighted = || {
        let all = residuals.iter().zip(weights);
        all.filter(|(residual, weight)| residual.is_finite() && **weight > 0.0)
    };
    let points = weighted().map(|(_, weight)| weight).sum();
    let weighted = weighted().map(|(residual, weight)| Residual {
        at: residual.at,
        value: residual.value,
        weight: weight / residual.sigma.powi(2),
    });
    Equations::new(grid, weighted, points)
}

/// How far each point is from the curve without it, and that curve's variance there.
fn without_each(residuals: &[Judged], weights: &[f64], spline: &Spline) -> Vec<(f64, f64)> {
    let without = |(residual, weight): (&Judged, &f64)| {
        let variance = spline.unit_variance_at(residual.at);
        let share = (weight * variance / residual.sigma.powi(2)).min(1.0 - 1e-9);
        let left = 1.0 - share;
        (residual.from(spline) / left, variance / left)
    };
    residuals.iter().zip(weights).map(without).collect()
}

/// How far each point is from the curve of the others, over its own scatter and that curve's uncertainty.
fn judge_by(
    residuals: &[Judged],
    weights: &[f64],
    spline: &Spline,
    least_scatter: f64,
) -> Vec<Verdict> {
    let without = without_each(residuals, weights, spline);
    let all = || residuals.iter().zip(&without);
    let off = all()
        .map(|(residual, (off, variance))| off.abs() / (residual.sigma.powi(2) + variance).sqrt());
    let scatter = (BY_MEDIAN * median(off)).max(least_scatter);
    let verdict = |(residual, (off, variance)): (&Judged, &(f64, f64))| {
        let sigma = (scatter * residual.strict).max(residual.least);
        let off = off.abs() / sigma.hypot(EXTRAPOLATED * scatter * variance.sqrt());
        let kept = residual.is_finite() && off < REACH;
        Verdict { off, kept }
    };
    all().map(verdict).collect()
}
