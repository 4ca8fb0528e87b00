//! From points to curves: order, outliers, eq. (1), the smooth curve of what it leaves, and which of the two
//! to take.

use anyhow::{Context as _, bail, ensure};
use statistics::{mean, variance};

use super::curve::{Curve, LESS_SMOOTH, Quality, without_each};
use super::eq1;
use super::observed::{Observed, Weights};
use super::order::{self, FEWEST_TO_REJECT};
use super::outliers::{self, Verdict};
use super::repeats::{self, Repeats};
use super::spline::{Equations, Grid, Residual};
use super::start;
use crate::points::Point;

/// What a calibration is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// Eq. (1) alone.
    Eq1,
    /// Eq. (1) with a table of smoothed residuals.
    Corrected,
    /// A table of smoothed distances.
    Table,
}

/// Curves through points.
#[derive(Clone, Debug)]
pub struct Solved {
    /// Eq. (1) alone.
    pub plain: Curve,
    /// How well it goes with the points.
    pub plain_quality: Quality,
    /// Eq. (1) with the smooth curve of what it leaves, where there are ten points, and how well that goes.
    pub corrected: Option<(Curve, Quality)>,
    /// How clearly the correction is better: see [`CLEARLY`].
    pub gain: Option<f64>,
    /// The points in their order, one of each distance.
    pub points: Vec<Point>,
    /// Those that count, as the fit sees them.
    pub observed: Vec<Observed>,
    /// What became of each.
    pub verdicts: Vec<Verdict>,
    /// What was known of their errors.
    pub weights: Weights,
    /// What points that repeat a distance tell.
    pub repeats: Option<Repeats>,
}

/// How many standard errors a correction must gain to be taken for better than eq. (1) alone.
pub const CLEARLY: f64 = 2.0;
/// Bends below this many standard uncertainties are those of a straight line.
const BENT: f64 = 2.0;
/// Rounds in which the points' weights follow the curve's slope.
const WEIGHT_ROUNDS: usize = 3;

/// Fits both curves to points, with the standard uncertainty of the positions in metres, where it is known.
///
/// # Errors
/// Says which line stands against it, and why.
pub fn solve(points: &[Point], position: Option<f64>) -> anyhow::Result<Solved> {
    let all_points = points;
    let points = &repeats::merged(points)[..];
    order::before(points, all_points)?;
    let (all, weights) = Observed::all(points, position);
    let verdicts = verdicts(&all, weights)?;
    let is_kept: Vec<bool> = verdicts.iter().map(|verdict| verdict.kept).collect();
    let kept = all.iter().zip(&is_kept).filter(|(_, kept)| **kept);
    let kept: Vec<Observed> = kept.map(|(point, _)| *point).collect();
    let (count, off) = (all.len(), all.len() - kept.len());
    if off > order::most_rejected(count) {
        let rejected = points.iter().zip(&is_kept).filter(|(_, kept)| !**kept);
        let lines: Vec<String> = rejected.map(|(point, _)| point.line.to_string()).collect();
        let more = if off > 6 { ", ..." } else { "" };
        bail!(
            "{off} of {count} points lie off the curve that the others make (lines {}{more}), more than a \
             fifth: look at what is wrong with them, or take a range over which the centre follows the \
             distance smoothly",
            lines[..off.min(6)].join(", ")
        );
    }
    let lines = || {
        let lines = || kept.iter().map(|point| point.line);
        let (first, last) = (lines().min().unwrap_or(0), lines().max().unwrap_or(0));
        format!("lines {first} to {last}")
    };
    let eq1 = weighted(&kept).with_context(lines)?;
    let plain = Curve {
        eq1,
        correction: None,
        less_smooth: None,
    };
    let known = weights == Weights::Known;
    let plain_quality = Quality::of(&plain, &kept, known);
    let corrected = correct(&plain, &kept).map(|curve| {
        let quality = Quality::of(&curve, &kept, known);
        (curve, quality)
    });
    let factor = corrected.as_ref().and_then(|(_, quality)| quality.factor);
    let scatter = factor.or(plain_quality.factor).unwrap_or(1.0);
    ensure!(
        plain.eq1.unit_bend() > BENT * scatter,
        "{}: a straight line goes through the points as well as eq. (1), whose xp would be at infinity: take \
         a wider range of distances, or points that scatter less",
        lines()
    );
    let curve = &plain.eq1.curve;
    let sigma_px = |point: &Observed| (point.sigma(curve) / curve.slope(point.centre)).abs();
    let scatter_px: Vec<f64> = all.iter().map(|point| scatter * sigma_px(point)).collect();
    order::after(points, &scatter_px)?;
    let gain_of = |(curve, _): &(Curve, Quality)| gain(&plain, curve, &kept);
    let gain = corrected.as_ref().and_then(gain_of);
    Ok(Solved {
        repeats: Repeats::of(all_points, &plain.eq1.curve),
        plain,
        plain_quality,
        corrected,
        gain,
        points: points.to_vec(),
        observed: kept,
        verdicts,
        weights,
    })
}

/// All are kept where there are too few to reject any.
fn verdicts(points: &[Observed], weights: Weights) -> anyhow::Result<Vec<Verdict>> {
    if points.len() < FEWEST_TO_REJECT {
        let (off, kept) = (0.0, true);
        return Ok(vec![Verdict { off, kept }; points.len()]);
    }
    start::robust(points)
        .and_then(|start| outliers::judge(points, weights, &start))
        .context("no three of the points lie on an eq. (1): check that distances and centres belong together")
}

/// Eq. (1) with each point's weight from the curve's slope there.
fn weighted(points: &[Observed]) -> anyhow::Result<eq1::Fit> {
    let alike: Vec<(f64, f64)> = points.iter().map(|it| (it.centre, it.distance)).collect();
    let mut fit = eq1::fit(&alike)?;
    for _ in 0..WEIGHT_ROUNDS {
        let weighted = points.iter().map(|point| point.observation(&fit.curve));
        fit = eq1::fit_weighted(&weighted.collect::<Vec<_>>())?;
    }
    Ok(fit)
}

/// Eq. (1) with the smooth curve of what it leaves. `None` where there are too few points for one.
fn correct(plain: &Curve, points: &[Observed]) -> Option<Curve> {
    if points.len() < FEWEST_TO_REJECT {
        return None;
    }
    let curve = plain.eq1.curve;
    let (first, last) = plain.eq1.valid;
    let ends = (curve.distance(first), curve.distance(last));
    let grid = Grid::new(ends.0.min(ends.1), ends.0.max(ends.1), points.len());
    let residuals = points.iter().map(|point| Residual {
        at: curve.distance(point.centre),
        value: point.residual(&curve),
        weight: 1.0 / point.sigma(&curve).powi(2),
    });
    let equations = Equations::new(grid, residuals, points.len() as f64);
    let penalty = equations.best_penalty()?;
    Some(Curve {
        eq1: plain.eq1.clone(),
        correction: Some(equations.solve(penalty)?),
        less_smooth: Some(equations.solve(penalty / LESS_SMOOTH)?),
    })
}

/// By how many of its standard errors the corrected curve's cross-validated error lies below that of eq. (1)
/// alone. `None` where a point alone holds one of the curves, or both are the same.
fn gain(plain: &Curve, corrected: &Curve, points: &[Observed]) -> Option<f64> {
    let [before, after] = [plain, corrected].map(|curve| without_each(curve, points));
    let (before, after) = (before?, after?);
    let all = points.iter().zip(before.iter().zip(&after));
    let gains = all.map(|(point, (before, after))| {
        (before.powi(2) - after.powi(2)) / point.sigma(&plain.eq1.curve).powi(2)
    });
    let gains: Vec<f64> = gains.collect();
    let (count, mean, variance) = (gains.len() as f64, mean(&gains), variance(&gains));
    (variance > 0.0).then(|| mean / (variance / count).sqrt())
}

impl Solved {
    /// How well the curve of a form goes with the points.
    pub fn quality(&self, form: Form) -> &Quality {
        match &self.corrected {
            Some((_, quality)) if form != Form::Eq1 => quality,
            _ => &self.plain_quality,
        }
    }

    /// The form to take: the corrected one where its cross-validated error is clearly lower, by [`CLEARLY`]
    /// times its standard error.
    pub fn better(&self) -> Form {
        match self.gain {
            Some(gain) if gain > CLEARLY => Form::Corrected,
            _ => Form::Eq1,
        }
    }

    /// What the covariance of eq. (1), as the points' variances give it, is to be multiplied with: the square
    /// of the scatter about eq. (1) alone, or at least 1 where uncertainties were given and few points tell
    /// more. A departure from eq. (1) counts as scatter: the parameters are no better known than that.
    pub fn variance(&self) -> Option<f64> {
        self.plain_quality.factor.map(|factor| factor * factor)
    }
}
