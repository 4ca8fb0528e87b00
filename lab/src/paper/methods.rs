//! The ways from a capture to a distance that are compared: the paper's, and ours beyond it.

use crate::paper::apparatus::Aperture;
use crate::paper::row_mean::RowMean;

/// How the centre of a row of the slit's image is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowEstimator {
    /// The paper's: least squares of a gaussian, all pixels alike. The core's `gauss-newton`, told of no shot
    /// noise.
    Gaussian,
    /// The paper's: Fraunhofer's pattern, sinc^2. The core's `fraunhofer`.
    Fraunhofer,
    /// The core's `phase-table`, the default.
    PhaseTable,
    /// The core's `adaptive`.
    Adaptive,
    /// The score of `phase-table` with tables of the profile that the sensor's own rows have.
    MeasuredProfile,
    /// The score with one table that is made for speckle:
    /// [`slit_path::speckle_table`](crate::paper::slit_path::speckle_table).
    Speckle,
}

impl RowEstimator {
    pub const ALL: [Self; 6] = [
        Self::Gaussian,
        Self::Fraunhofer,
        Self::PhaseTable,
        Self::Adaptive,
        Self::MeasuredProfile,
        Self::Speckle,
    ];

    pub const fn name(self) -> &'static str {
        match self {
            Self::Gaussian => "gaussian",
            Self::Fraunhofer => "fraunhofer",
            Self::PhaseTable => "phase-table",
            Self::Adaptive => "adaptive",
            Self::MeasuredProfile => "measured-profile",
            Self::Speckle => "speckle",
        }
    }
}

/// How the centre of a capture is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CentreMethod {
    /// Of the lens's image: eqs. (3) and (4).
    PlaneGaussian,
    /// Of the slit's: row by row.
    Rows(RowEstimator, RowMean),
}

impl CentreMethod {
    /// Those of an aperture, the paper's first.
    pub fn all(aperture: Aperture) -> Vec<Self> {
        match aperture {
            Aperture::Lens => vec![Self::PlaneGaussian],
            Aperture::Slit => RowEstimator::ALL
                .into_iter()
                .flat_map(|estimator| RowMean::ALL.map(|mean| Self::Rows(estimator, mean)))
                .collect(),
        }
    }
}

/// From the centre to the distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Calibration {
    /// The paper's: eq. (1), fitted to the data set itself.
    Eq1,
    /// The same, with a table of residuals from other surfaces added.
    Eq1AndTable,
}

/// A way from a capture to a distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Method {
    pub centre: CentreMethod,
    pub calibration: Calibration,
}

impl Method {
    pub const PAPERS_LENS: Self = Self {
        centre: CentreMethod::PlaneGaussian,
        calibration: Calibration::Eq1,
    };

    /// The paper's for the slit with a gaussian.
    pub const PAPERS_GAUSSIAN: Self = Self {
        centre: CentreMethod::Rows(RowEstimator::Gaussian, RowMean::Plain),
        calibration: Calibration::Eq1,
    };

    /// The paper's for the slit with Fraunhofer's pattern.
    pub const PAPERS_FRAUNHOFER: Self = Self {
        centre: CentreMethod::Rows(RowEstimator::Fraunhofer, RowMean::Plain),
        calibration: Calibration::Eq1,
    };

    /// Its name in tables: the parts that are not the paper's are named.
    pub fn name(&self) -> String {
        let (estimator, mean) = match self.centre {
            CentreMethod::PlaneGaussian => ("gaussian-2d", ""),
            CentreMethod::Rows(estimator, mean) => (estimator.name(), mean.name()),
        };
        let table = match self.calibration {
            Calibration::Eq1 => "",
            Calibration::Eq1AndTable => "table",
        };
        let parts = [estimator, mean, table];
        let named: Vec<&str> = parts.into_iter().filter(|part| !part.is_empty()).collect();
        named.join("+")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_methods_apart() {
        assert_eq!(Method::PAPERS_LENS.name(), "gaussian-2d");
        assert_eq!(Method::PAPERS_GAUSSIAN.name(), "gaussian");
        assert_eq!(Method::PAPERS_FRAUNHOFER.name(), "fraunhofer");
        let mut names: Vec<String> = CentreMethod::all(Aperture::Slit)
            .into_iter()
            .flat_map(|centre| {
                [Calibration::Eq1, Calibration::Eq1AndTable].map(|calibration| {
                    Method {
                        centre,
                        calibration,
                    }
                    .name()
                })
            })
            .collect();
        let all = names.len();
        names.sort();
        names.dedup();
        assert_eq!((all, names.len()), (2 * 6 * 4, 2 * 6 * 4));
        assert!(names.contains(&"adaptive+tukey+table".to_string()));
    }
}
