//! The centre of a row's spot, to a fraction of a pixel.

pub mod phase_table;
pub mod tables;

use crate::units::{Counts, Pixels};

/// What an estimator finds in a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowCentre {
    /// The spot's centre.
    pub centre: Pixels,
    /// Its standard uncertainty: the row's noise and the spot's shot noise through the estimator.
    pub uncertainty: Pixels,
    /// The spot's height above the background.
    pub amplitude: Counts,
    /// The spot's width (a gaussian's sigma).
    pub width: Pixels,
    /// The table that served.
    pub class: WidthClass,
}

/// Which table served: its place in the set, and the pixels in a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WidthClass {
    /// Index of the table.
    pub table: u8,
    /// Pixels in a sample.
    pub block: u8,
}
