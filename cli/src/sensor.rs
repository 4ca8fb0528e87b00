//! A sensor at a serial port.
