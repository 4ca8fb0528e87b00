//! What the fit gives: eq. (1) alone, or with the smooth curve of what it leaves.

use statistics::{least_and_most, mean, rms};

use super::eq1;
use super::observed::Observed;
use super::spline::Spline;

/// A curve that was fitted to points, in metres and pixels.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Eq. (1).
    pub eq1: eq1::Fit,
    /// Distance less eq. (1), over the distance that eq. (1) gives.
    pub correction: Option<Spline>,
    /// The same, smoothed less by [`LESS_SMOOTH`].
    pub less_smooth: Option<Spline>,
}

/// How much less the second curve is smoothed. What it changes is about what the first one smooths away.
pub const LESS_SMOOTH: f64 = 30.0;

impl Curve {
    /// The distance at a centre.
    pub fn distance(&self, centre: f64) -> f64 {
        self.eq1.curve.distance(centre) + self.residual(centre)
    }

    /// What is added to eq. (1) at a centre.
    pub fn residual(&self, centre: f64) -> f64 {
        (self.correction.as_ref()).map_or(0.0, |it| it.at(self.eq1.curve.distance(centre)))
    }

    /// Metres a pixel.
    pub fn slope(&self, centre: f64) -> f64 {
        let distance = self.eq1.curve.distance(centre);
        let change = (self.correction.as_ref()).map_or(0.0, |it| it.slope_at(distance));
        self.eq1.curve.slope(centre) * (1.0 + change)
    }

    /// How many parameters the curve is worth.
    pub fn freedoms(&self) -> f64 {
        (self.correction.as_ref()).map_or(3.0, |it| it.freedoms)
    }

    /// The variance of the curve's distance at a centre, as the variances of the points tell it. The spline's
    /// covers eq. (1)'s, whose part it leaves free.
    pub fn unit_variance_at(&self, centre: f64) -> f64 {
        match &self.correction {
            None => self.eq1.unit_variance_at(centre),
            Some(correction) => correction.unit_variance_at(self.eq1.curve.distance(centre)),
        }
    }

    /// What smoothing may have taken away at a centre, in metres.
    pub fn smoothed_away(&self, centre: f64) -> f64 {
        let distance = self.eq1.curve.distance(centre);
        match (&self.correction, &self.less_smooth) {
            (Some(curve), Some(less_smooth)) => less_smooth.at(distance) - curve.at(distance),
            _ => 0.0,
        }
    }

    /// How much the curve at a point hangs on that point: the part of an error of it that the curve takes
    /// over.
    pub fn leverage(&self, point: &Observed) -> f64 {
        let variance = point.sigma(&self.eq1.curve).powi(2);
        (self.unit_variance_at(point.centre) / variance).min(1.0)
    }

    /// Centres over the range at even steps of the distance by eq. (1), ends included.
    pub fn even_steps(&self, steps: usize) -> impl Iterator<Item = f64> {
        let (first, last) = self.eq1.valid;
        let curve = self.eq1.curve;
        let (from, to) = (curve.distance(first), curve.distance(last));
        (0..=steps).map(move |i| {
            let distance = from + (to - from) * i as f64 / steps as f64;
            // Rounding must not lead beyond the ends.
            curve.centre(distance).clamp(first, last)
        })
    }
}

/// How well a curve goes with the points that it was fitted to. Lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Root mean square of the residuals.
    pub rms: f64,
    /// The largest residual, without sign.
    pub largest: f64,
    /// Root mean square of the points' distances from curves that were fitted without them. `None` where a
    /// point alone holds the curve.
    pub cross_validated: Option<f64>,
    /// The factor from the points' uncertainties, as they were given, to those that the residuals tell.
    /// `None` where there are no more points than freedoms.
    pub scatter: Option<f64>,
    /// The factor by which the uncertainties here are larger than the points' own, as they were given, make
    /// them: the scatter, but see [`FEW_FREEDOMS`].
    pub factor: Option<f64>,
    /// Root mean square of the curve's own standard uncertainty over the range, at even steps of the
    /// distance.
    pub uncertainty: Option<f64>,
    /// The largest of it.
    pub largest_uncertainty: Option<f64>,
    /// The leverage of the points at the first and the last centre.
    pub leverages: (f64, f64),
}

/// A point that all but determines the curve where it is: without it there is none to compare it with.
const ALONE: f64 = 1.0 - 1e-6;
/// Points beyond the freedoms, below which known uncertainties are not taken to be smaller because the
/// residuals are: those may be by chance. The scatter squared is a chi-square over its freedoms: with ten it
/// is below half of the truth in 1 of 100 calibrations (P(chi-square < 2.5) = 0.9 %), with one in 38.
pub const FEW_FREEDOMS: f64 = 10.0;

impl Quality {
    /// That of a curve. `known` says whether the points' uncertainties were: then they stand in where
    /// residuals tell nothing.
    pub fn of(curve: &Curve, points: &[Observed], known: bool) -> Self {
        let residual = |point: &Observed| point.distance - curve.distance(point.centre);
        let residuals = || points.iter().map(residual);
        let over_sigma = |point: &Observed| residual(point) / point.sigma(&curve.eq1.curve);
        let squares: f64 = points.iter().map(|point| over_sigma(point).powi(2)).sum();
        let freedom = points.len() as f64 - curve.freedoms();
        let scatter = (freedom > 0.5).then(|| (squares / freedom).sqrt());
        let factor = match scatter {
            Some(scatter) if known && freedom < FEW_FREEDOMS => Some(scatter.max(1.0)),
            None if known => Some(1.0),
            scatter => scatter,
        };
        const STEPS: usize = 200;
        let centres = curve.even_steps(STEPS);
        let variances = centres.map(|centre| curve.unit_variance_at(centre));
        let variances: Vec<f64> = variances.collect();
        let (mean, (_, most)) = (mean(&variances), least_and_most(&variances));
        let ends = |better: fn(&f64, &f64) -> std::cmp::Ordering| {
            let end = points.iter().min_by(|a, b| better(&a.centre, &b.centre));
            end.map_or(1.0, |point| curve.leverage(point))
        };
        Self {
            rms: rms(residuals()),
            largest: residuals().map(f64::abs).fold(0.0, f64::max),
            cross_validated: without_each(curve, points).map(|errors| rms(&errors)),
            scatter,
            factor,
            uncertainty: factor.map(|factor| factor * mean.sqrt()),
            largest_uncertainty: factor.map(|factor| factor * most.sqrt()),
            leverages: (ends(f64::total_cmp), ends(|a, b| b.total_cmp(a))),
        }
    }
}

/// How far each point is, in metres, from the curve that would be fitted without it. `None` where a point
/// alone holds the curve.
pub fn without_each(curve: &Curve, points: &[Observed]) -> Option<Vec<f64>> {
    let without = |point: &Observed| {
        let leverage = curve.leverage(point);
        let residual = point.distance - curve.distance(point.centre);
        (leverage < ALONE).then(|| residual / (1.0 - leverage))
    };
    points.iter().map(without).collect()
}
