//! The ways from a capture to a centre that are compared: the paper's, and ours beyond it. Eq. (1), fitted to
//! the data set itself, makes distances of the centres.

use crate::paper::apparatus::Aperture;

/// The name of [`Method::Ours`] on pages: its table of weights, and its mean of the rows.
pub const OURS: &str = "speckle+ends";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The paper's for the lens: a gaussian in the plane, eqs. (3) and (4).
    PlaneGaussian,
    /// The paper's for the slit: on each row least squares of a gaussian, all pixels alike. The core's
    /// `gauss-newton`, told of no shot noise.
    Gaussian,
    /// The paper's for the slit: on each row Fraunhofer's pattern, sinc^2. The core's `fraunhofer`.
    Fraunhofer,
    /// Ours for the slit: a table that is made for speckle
    /// ([`slit_path::speckle_table`](crate::paper::slit_path::speckle_table)), and weights of the rows that
    /// suit speckle ([`row_mean::towards_the_ends`](crate::paper::row_mean::towards_the_ends)).
    Ours,
}

impl Method {
    /// All, in the order of the columns of tables.
    pub const ALL: [Self; 4] = [
        Self::PlaneGaussian,
        Self::Gaussian,
        Self::Fraunhofer,
        Self::Ours,
    ];

    pub const fn of(aperture: Aperture) -> &'static [Self] {
        match aperture {
            Aperture::Lens => &[Self::PlaneGaussian],
            Aperture::Slit => &[Self::Gaussian, Self::Fraunhofer, Self::Ours],
        }
    }

    pub fn aperture(self) -> Aperture {
        match self {
            Self::PlaneGaussian => Aperture::Lens,
            _ => Aperture::Slit,
        }
    }
}
