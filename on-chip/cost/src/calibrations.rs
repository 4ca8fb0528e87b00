//! The forms of a calibration, each of the paper's geometry.

use slitrange::distance::eq1::Eq1;
use slitrange::distance::knots::Knot;
use slitrange::distance::residuals::Corrected;
use slitrange::distance::table::Table;
use slitrange::{Calibration, Micrometres, Pixels};

/// Knots of a form with a table.
const KNOTS: usize = 33;

/// A form of a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Eq. (1).
    Eq1,
    /// A table with monotone cubics.
    Cubic,
    /// Eq. (1) with residuals, and monotone cubics between those.
    Corrected,
}

impl Form {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Eq1, Self::Cubic, Self::Corrected];

    /// Its name in the log.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Eq1 => "eq1",
            Self::Cubic => "cubic",
            Self::Corrected => "corrected",
        }
    }

    /// How many knots it has.
    pub const fn knots(self) -> usize {
        match self {
            Self::Eq1 => 0,
            Self::Cubic | Self::Corrected => KNOTS,
        }
    }

    /// It, with knots at even distances.
    pub fn calibration(self) -> Option<Calibration> {
        let curve = curve()?;
        let mut knots = [Knot {
            centre: FIRST,
            value: Micrometres::from_int(0),
        }; KNOTS];
        let knots = knots.get_mut(..self.knots())?;
        for (i, knot) in knots.iter_mut().enumerate() {
            knot.centre = place(i, self.knots() - 1);
            knot.value = match self {
                Self::Corrected => residual(knot.centre),
                _ => curve.distance_at(knot.centre).ok()?.0,
            };
        }
        match self {
            Self::Eq1 => Some(Calibration::Eq1(curve)),
            Self::Cubic => Table::new(knots).ok().map(Calibration::Table),
            Self::Corrected => Corrected::new(curve, knots)
                .ok()
                .map(Calibration::Corrected),
        }
    }

    /// What the distance should be at a centre in pixels, in micrometres.
    pub fn truth(self, centre: f64) -> f64 {
        let distance = D + K / (centre - POLE);
        match self {
            Self::Corrected => distance + distortion(centre),
            _ => distance,
        }
    }
}

/// b, f in micrometres and tan u; pixels of 5.86 um, and the one on the optical axis.
const BASELINE: f64 = 300_000.0;
const FOCAL_LENGTH: f64 = 50_000.0;
const TAN_ANGLE: f64 = 2.6;
const PITCH: f64 = 5.86;
const AXIS: f64 = 959.5;

/// The paper's range of distances in micrometres.
const NEAR: f64 = 600_000.0;
const FAR: f64 = 1_020_000.0;

/// Eq. (1), as in [`slitrange::distance::eq1`].
const D: f64 = -BASELINE / TAN_ANGLE;
const K: f64 =
    BASELINE * FOCAL_LENGTH / PITCH * (1.0 + TAN_ANGLE * TAN_ANGLE) / (TAN_ANGLE * TAN_ANGLE);
const POLE: f64 = AXIS - FOCAL_LENGTH / PITCH / TAN_ANGLE;

/// The centres of the range: that of the longest distance is the first.
pub const FIRST: Pixels = centre(FAR);
/// The last of them.
pub const LAST: Pixels = centre(NEAR);

const fn centre(distance: f64) -> Pixels {
    Pixels::from_bits(((POLE + K / (distance - D)) * 65536.0 + 0.5) as i32)
}

fn curve() -> Option<Eq1> {
    Eq1::new(
        Micrometres::from_bits((D * 256.0 - 0.5) as i32),
        (K * 65536.0 + 0.5) as i64,
        Pixels::from_bits((POLE * 65536.0 - 0.5) as i32),
        FIRST..=LAST,
    )
    .ok()
}

/// The `i`-th of `parts + 1` even places over the range.
fn place(i: usize, parts: usize) -> Pixels {
    let (first, last) = (FIRST.to_bits(), LAST.to_bits());
    let from_first = i64::from(last - first) * i as i64 / parts as i64;
    Pixels::from_bits(first + from_first as i32)
}

/// A distortion of the third order of up to 300 um, less what eq. (1) takes of it.
fn distortion(centre: f64) -> f64 {
    let (first, last) = (FIRST.to_f64(), LAST.to_f64());
    let z = (2.0 * centre - first - last) / (last - first);
    300.0 * (4.0 * z * z * z - 3.0 * z)
}

fn residual(centre: Pixels) -> Micrometres {
    Micrometres::from_bits(libm::round(distortion(centre.to_f64()) * 256.0) as i32)
}

/// Centres that are asked for.
pub const CENTRES: usize = 129;

/// Every fourth is on a knot of any table, the others are spread unevenly over what lies between.
pub fn asked(i: usize) -> Pixels {
    let place = place(i, CENTRES - 1);
    // A 128th of the range is 12 pixels.
    let beside = (i % 4) as i32 * 123_457;
    Pixels::from_bits(place.to_bits() + beside)
}
