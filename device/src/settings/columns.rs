//! The columns of a line: the setting `output`.

use slitrange::named;

/// A part of a reading's line, in the order in which a line has them. Only `k` follows `t`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column {
    /// `# 1234`: the result's number.
    Counter,
    /// `@ 12345678`: the time of the result, in microseconds.
    Time,
    /// The distance.
    Distance,
    /// `u`: the standard uncertainty.
    Uncertainty,
    /// `r`: the repeatability.
    Repeatability,
    /// `x`: the spot's centre.
    Centre,
    /// `a`: the spot's height.
    Height,
    /// `n`: the rows used. Also `k`, the slits used, if there are several.
    Rows,
    /// `w`: the spot's width.
    Width,
    /// `t`: the exposure, unless it is the longest one.
    Exposure,
    /// `m`, `c`, `g` and `s`.
    Flags,
}

named! {
    Column {
        Counter: "counter", Time: "time", Distance: "distance", Uncertainty: "u", Repeatability: "r",
        Centre: "centre", Height: "height", Rows: "rows", Width: "width", Exposure: "exposure", Flags: "flags"
    }
}

impl Column {
    const fn bit(self) -> u16 {
        1 << self as u16
    }
}

/// Some of the columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Columns(u16);

impl Columns {
    /// No column.
    pub const NONE: Self = Self(0);

    /// The names of all columns.
    pub const NAMES: &'static str =
        "counter time distance u r centre height rows width exposure flags";

    /// These columns and one more.
    #[must_use]
    pub const fn with(self, column: Column) -> Self {
        Self(self.0 | column.bit())
    }

    /// Whether a column is one of them.
    pub const fn has(self, column: Column) -> bool {
        self.0 & column.bit() != 0
    }
}

impl Default for Columns {
    /// All but counter, time and width.
    fn default() -> Self {
        let is_there = |it: &Column| !matches!(it, Column::Counter | Column::Time | Column::Width);
        let columns = Column::ALL.into_iter().filter(is_there);
        columns.fold(Self::NONE, Self::with)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_column_has_its_own_bit_and_its_name_in_the_list() {
        for column in Column::ALL {
            let alone = Columns::NONE.with(column);
            for other in Column::ALL {
                assert_eq!(alone.has(other), other == column, "{column:?} {other:?}");
            }
            assert_eq!(Column::named(column.name()), Some(column));
        }
        assert_eq!(Column::named("n"), None);
        assert_eq!(Columns::NAMES, Column::ALL.map(Column::name).join(" "));
    }
}
