//! The sensors that a scene can be seen by.

use serde::{Deserialize, Serialize};
use slitrange::row::{Geometry, Polarity, sensor_heads};

/// A sensor: pixels of a row, rows that are exposed at once, and their sizes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sensor {
    /// Toshiba TCD1304DG: one row of 3648 pixels of 8 um x 200 um.
    Tcd1304dg,
    /// The paper's camera (Sony IMX249), its middle 600 rows: 1920 x 600 pixels of 5.86 um x 5.86 um, 12
    /// bits.
    Camera,
    /// One row of so many pixels of 8 um x 200 um, all lit, 12 bits.
    Row(usize),
}

impl Sensor {
    /// From pixel to pixel along a row, in metres.
    pub const fn pitch(self) -> f64 {
        match self {
            Self::Tcd1304dg | Self::Row(_) => 8e-6,
            Self::Camera => 5.86e-6,
        }
    }

    /// A pixel's height, in metres.
    pub const fn pixel_height(self) -> f64 {
        match self {
            Self::Tcd1304dg | Self::Row(_) => 200e-6,
            Self::Camera => 5.86e-6,
        }
    }

    /// Rows that are exposed at once, one above the other.
    pub const fn rows(self) -> u64 {
        match self {
            Self::Tcd1304dg | Self::Row(_) => 1,
            Self::Camera => 600,
        }
    }

    /// Time from row to row, or from frame to frame of a camera, in seconds. The TCD1304DG gives 175.4 rows a
    /// second. The camera gives 41.6 frames a second (paper, section 3).
    pub const fn period(self) -> f64 {
        match self {
            Self::Tcd1304dg | Self::Row(_) => 1.0 / 175.4,
            Self::Camera => 1.0 / 41.6,
        }
    }

    /// What the values of a row are; light positive or not is the driver's matter.
    pub fn geometry(self) -> Geometry {
        let plain = |pixels| Geometry {
            words: pixels,
            shielded: 0..0,
            light: 0..pixels,
            polarity: Polarity::Rising,
            bits: 12,
            shot_variance_per_count_q16: 0,
            saturation: slitrange::row::LARGEST_COUNT,
        };
        match self {
            Self::Tcd1304dg => sensor_outputs(),
            Self::Camera => plain(1920),
            Self::Row(pixels) => plain(pixels),
        }
    }
}

/// The TCD1304DG's outputs as it numbers them: the driver's words without their lead-in.
pub fn sensor_outputs() -> Geometry {
    let words = sensor_heads::tcd1304dg();
    let without_lead_in = |range: std::ops::Range<usize>| {
        range.start - sensor_heads::TCD1304DG_LEAD_IN..range.end - sensor_heads::TCD1304DG_LEAD_IN
    };
    Geometry {
        shielded: without_lead_in(words.shielded.clone()),
        light: without_lead_in(words.light.clone()),
        ..words
    }
}
