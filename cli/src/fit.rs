//! From points to a calibration.
