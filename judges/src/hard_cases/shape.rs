//! The profiles that hard rows' spots have.

use phase_tables::gaussian;
use simulator::profiles::{self, Curve, Slit};
use std::f64::consts::{PI, SQRT_2};
use std::fmt;
use std::sync::LazyLock;

/// A spot's profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Eq. (5).
    Gaussian,
    /// sinc^2, eq. (6).
    SincSquared,
    /// Fresnel's diffraction of a point of light by the nominal slit.
    Fresnel,
    /// The same of a laser spot of 1 mm.
    LaserSpot,
    /// A gaussian whose right half is wider than its left one by this share of its width; the mean of both is
    /// the width. Negative: narrower.
    Lopsided(f64),
}

static SINC_SQUARED: LazyLock<Curve> = LazyLock::new(profiles::slit);
static FRESNEL: LazyLock<Curve> = LazyLock::new(|| Slit::nominal(0.0).curve());
static LASER_SPOT: LazyLock<Curve> = LazyLock::new(|| Slit::nominal(1e-3).curve());

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gaussian => f.write_str("a gaussian"),
            Self::SincSquared => f.write_str("sinc squared"),
            Self::Fresnel => f.write_str("Fresnel's diffraction of a point of light"),
            Self::LaserSpot => f.write_str("Fresnel's diffraction of a laser spot of 1 mm"),
            Self::Lopsided(share) => write!(
                f,
                "a gaussian whose right half is wider by {:.0} %",
                100.0 * share
            ),
        }
    }
}

impl Shape {
    /// What a pixel gathers `offset` pixels from the centre of a spot of height 1 and `width` pixels.
    pub fn at(self, offset: f64, width: f64) -> f64 {
        match self {
            Self::Gaussian => gaussian(offset, width),
            Self::SincSquared => SINC_SQUARED.at(offset, width),
            Self::Fresnel => FRESNEL.at(offset, width),
            Self::LaserSpot => LASER_SPOT.at(offset, width),
            Self::Lopsided(share) => {
                let half = |place: f64| {
                    let sigma = width * (1.0 + 0.5 * share.copysign(share * place));
                    sigma * (0.5 * PI).sqrt() * libm::erf(place / (SQRT_2 * sigma))
                };
                half(offset + 0.5) - half(offset - 0.5)
            }
        }
    }

    /// From peak to centroid, in widths: of two half gaussians sqrt(2/pi) times their widths' difference.
    pub fn centroid(self) -> f64 {
        match self {
            Self::Lopsided(share) => (2.0 / PI).sqrt() * share,
            _ => 0.0,
        }
    }

    /// From the peak to the middle between both flanks at a share of the height, in widths. Where the top is
    /// cut off, the flanks are all that is seen: half of sqrt(2 ln(1/share)) times the difference of the half
    /// gaussians' widths.
    pub fn middle_at(self, share: f64) -> f64 {
        match self {
            Self::Lopsided(difference) => 0.5 * difference * (-2.0 * share.ln()).sqrt(),
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums over the pixels: the area must be that of a gaussian, and the centroid must be the stated one.
    #[test]
    fn the_stated_centroid_of_a_lopsided_spot_is_that_of_its_pixels() {
        for share in [-0.3, -0.1, 0.0, 0.2, 0.3] {
            let shape = Shape::Lopsided(share);
            let (mut area, mut moment) = (0.0, 0.0);
            for i in -100..=100 {
                let offset = f64::from(i) - 0.3;
                let light = shape.at(offset, 10.0);
                area += light;
                moment += light * offset;
            }
            println!("{share}: {area}, {}", moment / area / 10.0);
            assert!((area - 10.0 * (2.0 * PI).sqrt()).abs() < 1e-6);
            assert!((moment / area / 10.0 - shape.centroid()).abs() < 1e-3);
            let height = |offset: f64| shape.at(offset, 10.0);
            let middle = 10.0 * shape.middle_at(0.5);
            let half = 10.0 * (2.0 * 2f64.ln()).sqrt();
            // Pixels blur the flanks by a little.
            assert!((height(middle - half) - 0.5).abs() < 1e-3);
            assert!((height(middle + half) - 0.5).abs() < 1e-3);
        }
    }
}
