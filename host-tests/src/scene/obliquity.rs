//! Light that comes in at an angle makes an asymmetric pattern.

use serde::{Deserialize, Serialize};

/// Diffraction is symmetric in the sine of the angle, and the sensor is flat: off the axis the pattern is wider on its outer side, and dimmer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Obliquity {}
