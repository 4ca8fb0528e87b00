//! The standard uncertainty of a distance, in parts (after the GUM: the parts are independent, so their
//! squares add up).
//!
//! | part | what it is | more rows of a target at rest reduce it |
//! |---|---|---|
//! | noise | the rows' own noise: the repeatability r | yes |
//! | pixels | response and offset of the pixels, which stay | no |
//! | calibration | the curve's own uncertainty at this centre | no |
//! | surface | speckle, which moves the whole spot | no |
//! | geometry | tolerances of a head that was never calibrated | no |
//! | motion | where the target was in the middle of the frame | no |
//!
//! **Surface.** Behind a slit that is narrower than a speckle, the light that the sensor sees is a plane wave
//! with a random tilt, and the tilt moves the spot. For a spot that is made of M equal speckle patterns, the
//! displacement given the spot's light I is normal, with the variance s^2 / (2 M) times the mean light over
//! I: s is the standard deviation of the laser spot, converted to a distance. So the surface's part is
//! e sqrt(usual height / height). e depends on the surface, and is proportional to the distance. Both heights
//! are those at the longest exposure. A comb measures the part in each reading, as the scatter of its slits
//! ([`crate::frame::comb`]).
//!
//! **Ranges.** In fixed point, lengths are below 2^23 um, centres below 2^15 px and heights below 2^23
//! counts. A curve's slope is below 2^28 um a pixel: knots are at least 1/16 px and less than 2^22 um apart,
//! and eq. (1)'s pole is at least a pixel away. So (spread times slope)^2 is below 2^86, deviation^2 times
//! height below 2^69, and no other square is as large: all are far below f32's 2^127. Not-a-number, as from a
//! height below zero, becomes 0.

use serde::{Deserialize, Serialize};

use crate::base::drawing::{DRAWING, Drawing};
use crate::base::numeric::{at_least, at_most, square};
use crate::base::places::{PLACES, place_at};
use crate::base::{Counts, Exposure, Micrometres, Pixels, numeric};
use crate::centre::Estimator;
use crate::frame::FrameCentre;
use crate::row::pixels::PixelErrors;

/// Where the surface's part comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Surface {
    /// From the calibration's points. If the record does not hold it, from [`SPECKLE`] and
    /// [`USUAL_HEIGHT`].
    #[default]
    Auto,
    /// Set by hand, for a spot of the usual height. With a comb: the part that all slits share.
    Fixed(Micrometres),
    /// The surface is smooth, or its errors are not to count.
    Off,
}

/// The uncertainties of a calibration. They are kept for years: another encoding needs another version.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum CalibrationErrors {
    /// None: a calibration of a library's user.
    Unknown,
    /// The nominal calibration, for a head that nobody adjusted: [`LENGTH_TOLERANCE`],
    /// [`OFFSET_TOLERANCE_UM`] and [`ANGLE_TOLERANCE`].
    Nominal,
    /// Those that the fit of the calibration's points found.
    Fitted(FittedErrors),
}

/// The uncertainties that a fit found, at [`PLACES`] centres from the calibration's first to its last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FittedErrors {
    /// Standard uncertainty of the curve.
    pub curve: [Micrometres; PLACES],
    /// Standard uncertainty by the surface, for a spot of the usual height. `None` if the points did not show
    /// it. With a comb: the part that all slits share.
    pub surface: Option<FittedSurface>,
}

/// How a surface moves the spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FittedSurface {
    /// Standard uncertainty of a distance, for a spot of the usual height. For a comb, only the part that all
    /// slits share, whatever the height: the scatter of the slits tells the rest.
    pub deviation: [Micrometres; PLACES],
    /// The usual height of the spot.
    pub height: [Counts; PLACES],
}

/// The surface's standard uncertainty divided by the distance, for a spot of [`USUAL_HEIGHT`] on a rough
/// target before the nominal head: speckle of a laser with a single wavelength, on a surface that keeps the
/// polarisation. Other surfaces have less.
///
/// sigma_spot / (b sqrt 2), where sigma_spot is a quarter of the spot's diameter of 1 mm and b = 300 mm.
pub const SPECKLE: f32 = 0.25 / 300.0 * core::f32::consts::FRAC_1_SQRT_2;
/// The usual height of a spot in counts if no calibration tells it: a quarter of full scale, as in the paper.
pub const USUAL_HEIGHT: f32 = 1000.0;
/// Up to this many times the usual brightness, a spot is a bright speckle of the usual target. From twice as
/// much on, it belongs to a brighter target: speckle makes 2 % of the readings of metal so bright (one
/// polarisation, light with an exponential distribution), and 0.3 % of paper.
const BRIGHT_SPECKLE: f32 = 2.0;
/// The surface's variance over that at the usual height, for a target whose usual brightness is not known:
/// two polarisations. The displacement then has Student's t distribution with four degrees of freedom, whose
/// variance is 4 / (4 - 2).
const ANY_BRIGHTNESS: f32 = 2.0;
/// The memory of speckle in micrometres at the range [`MEMORY_RANGE_UM`]: the step along the beam after which
/// the errors of two readings by the surface have the correlation 1/e. It is that of a laser spot of 1 mm
/// before the nominal head. A smaller spot's memory is longer, in inverse proportion, and a difference is
/// then better than it claims.
pub const MEMORY_UM: f32 = 840.0;
/// From the slit to the target in micrometres, where the memory is [`MEMORY_UM`].
pub const MEMORY_RANGE_UM: f32 = 854_400.0;

/// The memory of speckle at a distance, in micrometres: it grows as the square of the range.
pub(crate) fn memory_um(distance_um: f32) -> f32 {
    let squares = square(distance_um) + square(DRAWING.baseline_um);
    MEMORY_UM * squares / square(MEMORY_RANGE_UM)
}

/// The standard uncertainty of baseline and focal length, over themselves, of a head that was put together by
/// its drawing and never adjusted: uniform within 1 %.
pub const LENGTH_TOLERANCE: f32 = 0.0058;
/// The standard uncertainty of d0 in micrometres, of such a head: uniform within 5 mm.
pub const OFFSET_TOLERANCE_UM: f32 = 2890.0;
/// The standard uncertainty of the angle u in radians, of such a head. A laser module's beam is 0.25 to 0.5
/// degrees off its housing.
pub const ANGLE_TOLERANCE: f32 = 0.006_67;

/// The parts of a standard uncertainty.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Parts {
    /// The repeatability r.
    pub noise: Micrometres,
    /// A spot that is not its own mirror image.
    pub shape: Micrometres,
    /// Response and offset of the pixels.
    pub pixels: Micrometres,
    /// The calibration's curve.
    pub calibration: Micrometres,
    /// Speckle.
    pub surface: Micrometres,
    /// Tolerances of a head that was never calibrated.
    pub geometry: Micrometres,
    /// Motion that is not known exactly.
    pub motion: Micrometres,
}

impl Parts {
    /// Names and values, in the order of the pipeline.
    pub const fn named(&self) -> [(&'static str, Micrometres); 7] {
        [
            ("noise", self.noise),
            ("shape", self.shape),
            ("pixels", self.pixels),
            ("calibration", self.calibration),
            ("surface", self.surface),
            ("geometry", self.geometry),
            ("motion", self.motion),
        ]
    }

    /// The combined standard uncertainty u. Never zero: if it is below the finest step, it is the step.
    pub fn combined(&self) -> Micrometres {
        // Seven squares of at most 2^23 um.
        let squares: f32 = (self.named().iter())
            .map(|part| square(part.1.to_f32()))
            .sum();
        Micrometres::from_f32(dual_mac::square_root(squares)).max(Micrometres::from_bits(1))
    }
}

/// A place of the target, as far as the parts of the uncertainty need it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    /// The distance.
    pub distance: Micrometres,
    /// Micrometres a pixel, without sign.
    pub slope: f32,
    /// How far along the calibration's centres, 0 to 1.
    pub along: f32,
}

impl Place {
    /// The parts of the uncertainty of a frame's distance here.
    pub fn parts(
        &self,
        frame: &FrameCentre,
        by_shape: Pixels,
        pixels: f32,
        by_slits: Option<Pixels>,
        errors: &CalibrationErrors,
        surface: Surface,
    ) -> Parts {
        let distance_of = |pixels: f32| Micrometres::from_f32(pixels * self.slope);
        Parts {
            noise: distance_of(frame.uncertainty.to_f32()).max(Micrometres::from_bits(1)),
            shape: distance_of(by_shape.to_f32()),
            pixels: distance_of(pixels),
            calibration: errors.curve(self),
            surface: match by_slits {
                None => self.surface(frame, errors, surface),
                Some(by_slits) => self.surface_by_slits(by_slits, errors, surface),
            },
            geometry: match errors {
                CalibrationErrors::Nominal => self.geometry(frame.centre),
                CalibrationErrors::Unknown | CalibrationErrors::Fitted(_) => Micrometres::default(),
            },
            motion: distance_of(frame.motion.to_f32()),
        }
    }

    /// The surface's part. The rows of a moving target see different speckle, and their mean has a smaller
    /// error than one row: by the variance of their scatter ([`FrameCentre::spread`]), but never below that
    /// of independent rows.
    fn surface(
        &self,
        frame: &FrameCentre,
        errors: &CalibrationErrors,
        surface: Surface,
    ) -> Micrometres {
        let Some((deviation, height)) = errors.surface(self, surface) else {
            return Micrometres::default();
        };
        let seen = brightness(frame);
        let variance = square(deviation) * by_brightness(seen / height);
        let rest = variance - square(frame.spread.to_f32() * self.slope);
        let least = variance / f32::from(frame.rows_used.max(1));
        Micrometres::from_f32(dual_mac::square_root(at_least(rest, least)))
    }

    /// The surface's part of a comb's reading: the scatter of the slits, and what all slits share. The
    /// scatter does not show that part, as when a texture makes one side of the laser spot brighter. A
    /// calibration finds it on its own material, or a person sets it.
    fn surface_by_slits(
        &self,
        by_slits: Pixels,
        errors: &CalibrationErrors,
        surface: Surface,
    ) -> Micrometres {
        let shared = match (surface, errors) {
            (Surface::Off, _) => return Micrometres::default(),
            (Surface::Fixed(shared), _) => shared.to_f32(),
            (Surface::Auto, CalibrationErrors::Fitted(fitted)) => {
                let found = fitted.surface.as_ref();
                found.map_or(0.0, |found| {
                    between(&found.deviation.map(Micrometres::to_f32), self.along)
                })
            }
            (Surface::Auto, _) => 0.0,
        };
        let squares = square(by_slits.to_f32() * self.slope) + square(shared);
        Micrometres::from_f32(dual_mac::square_root(squares))
    }

    /// Eq. (1)'s derivatives by angle, baseline, focal length and offset, each times its tolerance.
    fn geometry(&self, centre: Pixels) -> Micrometres {
        let Drawing {
            baseline_um: b,
            focal_px,
            axis_px,
            pitch_um: _,
        } = DRAWING;
        let distance = self.distance.to_f32();
        // d = b tan(theta), alpha = atan((x - axis) / f).
        let by_angle = b + distance * distance / b;
        let tangent = (centre.to_f32() - axis_px) / focal_px;
        let by_focal = by_angle * tangent / (1.0 + tangent * tangent);
        let squares = square(by_angle * ANGLE_TOLERANCE)
            + square(distance * LENGTH_TOLERANCE)
            + square(by_focal * LENGTH_TOLERANCE)
            + square(OFFSET_TOLERANCE_UM);
        Micrometres::from_f32(dual_mac::square_root(squares))
    }
}

impl CalibrationErrors {
    /// Whether no uncertainty is below zero, and all usual heights are above zero.
    pub fn are_sensible(&self) -> bool {
        let Self::Fitted(fitted) = self else {
            return true;
        };
        let none_negative = |values: &[Micrometres]| values.iter().all(|it| it.to_bits() >= 0);
        none_negative(&fitted.curve)
            && fitted.surface.as_ref().is_none_or(|surface| {
                none_negative(&surface.deviation)
                    && surface.height.iter().all(|height| height.to_bits() > 0)
            })
    }

    fn curve(&self, place: &Place) -> Micrometres {
        match self {
            Self::Fitted(fitted) => {
                Micrometres::from_f32(between(&fitted.curve.map(Micrometres::to_f32), place.along))
            }
            Self::Unknown | Self::Nominal => Micrometres::default(),
        }
    }

    /// The surface's standard uncertainty in micrometres for a spot of the usual height, and that height in
    /// counts. `None` where it does not count.
    fn surface(&self, place: &Place, surface: Surface) -> Option<(f32, f32)> {
        let physical = (place.distance.to_f32().abs() * SPECKLE, USUAL_HEIGHT);
        let fitted = match self {
            Self::Fitted(FittedErrors {
                surface: Some(FittedSurface { deviation, height }),
                ..
            }) => Some((
                between(&deviation.map(Micrometres::to_f32), place.along),
                between(&height.map(Counts::to_f32), place.along),
            )),
            _ => None,
        };
        let (deviation, height) = fitted.unwrap_or(physical);
        match surface {
            Surface::Auto => Some((deviation, height)),
            Surface::Fixed(deviation) => Some((deviation.to_f32(), height)),
            Surface::Off => None,
        }
    }
}

/// The surface's variance over that at the usual brightness, for a spot that is `times` as bright: 1 / times
/// for the usual target, [`ANY_BRIGHTNESS`] for a brighter one, and a parabola that joins the two.
fn by_brightness(times: f32) -> f32 {
    if times <= BRIGHT_SPECKLE {
        return 1.0 / times;
    }
    // 1/2 at twice the usual brightness, 2 at four times.
    at_most(times * times / 8.0, ANY_BRIGHTNESS)
}

/// The height that the spot would have at the longest exposure, in counts: 1 to 2^33.
fn brightness(frame: &FrameCentre) -> f32 {
    let factor = frame.exposure.map_or(1.0, |exposure| {
        f32::from(Exposure::LONGEST.us()) / f32::from(exposure.us())
    });
    at_least(frame.amplitude.to_f32() * factor, 1.0)
}

/// Linear interpolation. `along` is limited to 0 to 1; not-a-number counts as 0.
fn between(values: &[f32; PLACES], along: f32) -> f32 {
    let (index, part) = place_at(numeric::whole_i32(along * 65536.0));
    match values.get(index..) {
        Some([from, to, ..]) => from + (to - from) * (part as f32 / 65536.0),
        _ => 0.0,
    }
}

impl PixelErrors {
    /// The standard uncertainty in pixels of a spot's centre, by these errors: of a spot of a width (sigma)
    /// and a height, on a background of ambient light. It does not depend on the spot's place, and rises with
    /// the square root of the width, as the sum of so many independent pixels does.
    pub fn of_centre(
        self,
        estimator: Estimator,
        width: Pixels,
        height: Counts,
        ambient: Counts,
    ) -> f32 {
        let (by_response, by_offset) = weights(estimator);
        let response = f32::from(self.response_q16) / 65536.0;
        let height = at_least(height.to_f32(), 1.0);
        // Ambient light makes an offset of a response that differs.
        let offset = self.offset.to_f32();
        let under = response * ambient.to_f32();
        let offset = dual_mac::square_root(offset * offset + under * under) / height;
        let (response, offset) = (by_response * response, by_offset * offset);
        let width = at_least(width.to_f32(), 0.0);
        dual_mac::square_root(width * (response * response + offset * offset))
    }
}

/// How far independent errors of the pixels move a centre, over the square root of the width: relative errors
/// of the response, and offsets over the spot's height. The unweighted fit of a gaussian has 0.632 and 1.062
/// in closed form. Here the weights follow the shot noise of a TCD1304DG; host-tests/tests/uncertainty.rs
/// finds errors of 0.8 to 1.1 times these.
const fn weights(estimator: Estimator) -> (f32, f32) {
    match estimator {
        Estimator::Centroid => (0.42, 1.75),
        Estimator::PhaseTable => (0.49, 1.17),
        Estimator::Adaptive => (0.55, 1.1),
        Estimator::GaussNewton => (0.52, 1.1),
        Estimator::Fraunhofer => (0.48, 1.17),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Continuous, as the usual target up to twice its brightness, and never less than half.
    #[test]
    fn a_brighter_target_has_the_variance_of_any_brightness() {
        for (times, expected) in [
            (0.1, 10.0),
            (1.0, 1.0),
            (2.0, 0.5),
            (2.0001, 0.5),
            (4.0, 2.0),
            (560.0, 2.0),
        ] {
            let found = by_brightness(times);
            assert!((found / expected - 1.0).abs() < 1e-3, "{times}: {found}");
        }
        assert_eq!(by_brightness(f32::NAN), ANY_BRIGHTNESS);
    }
}
