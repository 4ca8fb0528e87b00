//! A calibration record as a file: the bytes that the sensor keeps in its flash ([`slitrange::calibration::record`]).
