//! A point as the fit sees it: in metres, with what is known of its errors.

use super::eq1::{Eq1, Observation};
use crate::points::{KnownShape, Point};

/// A centre at a known distance, with the standard uncertainties of both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observed {
    /// The line of the file that it comes from.
    pub line: u64,
    /// In pixels.
    pub centre: f64,
    /// In metres.
    pub distance: f64,
    /// Of the centre, in pixels.
    pub sigma_centre: f64,
    /// Of the distance, in metres.
    pub sigma_distance: f64,
    /// The spot's height in counts, where it is known.
    pub height: Option<f64>,
    /// The spot's shape, where it is known.
    pub shape: Option<KnownShape>,
}

/// What was known of the points' errors beforehand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weights {
    /// Nothing: all centres count alike, as if each had an uncertainty of 1 px.
    Alike,
    /// The centres' uncertainties, or the positions', or both.
    Known,
}

impl Observed {
    /// Points with the standard uncertainty of the positions in metres, where it is known.
    pub fn all(points: &[Point], position: Option<f64>) -> (Vec<Self>, Weights) {
        let with_sigma = points.iter().any(|point| point.sigma_px.is_some());
        let (weights, otherwise) = match with_sigma || position.is_some() {
            true => (Weights::Known, 0.0),
            false => (Weights::Alike, 1.0),
        };
        let observed = points.iter().map(|point| Self {
            line: point.line,
            centre: point.x_px,
            distance: point.d_mm * 1e-3,
            sigma_centre: point.sigma_px.unwrap_or(otherwise),
            sigma_distance: position.unwrap_or(0.0),
            height: point.height_counts,
            shape: point.shape,
        });
        (observed.collect(), weights)
    }

    /// Distance less curve, in metres.
    pub fn residual(&self, curve: &Eq1) -> f64 {
        self.distance - curve.distance(self.centre)
    }

    /// The residual's standard uncertainty in metres, with the curve's slope at the centre.
    pub fn sigma(&self, curve: &Eq1) -> f64 {
        self.sigma_at(curve.slope(self.centre))
    }

    /// The same with a slope in metres a pixel.
    pub fn sigma_at(&self, slope: f64) -> f64 {
        (slope * self.sigma_centre).hypot(self.sigma_distance)
    }

    /// For the fit, with the curve's slope at the centre.
    pub fn observation(&self, curve: &Eq1) -> Observation {
        Observation {
            centre: self.centre,
            distance: self.distance,
            variance: self.sigma(curve).powi(2),
        }
    }
}
