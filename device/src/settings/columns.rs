//! The columns of a line: the setting `output`.

/// A part of a reading's line.
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

impl Column {
    /// All columns, in the order in which a line has them. Only `k` follows `t`.
    pub const ALL: [Self; 11] = [
        Self::Counter,
        Self::Time,
        Self::Distance,
        Self::Uncertainty,
        Self::Repeatability,
        Self::Centre,
        Self::Height,
        Self::Rows,
        Self::Width,
        Self::Exposure,
        Self::Flags,
    ];

    /// The name that a person types.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Counter => "counter",
            Self::Time => "time",
            Self::Distance => "distance",
            Self::Uncertainty => "u",
            Self::Repeatability => "r",
            Self::Centre => "centre",
            Self::Height => "height",
            Self::Rows => "rows",
            Self::Width => "width",
            Self::Exposure => "exposure",
            Self::Flags => "flags",
        }
    }

    /// Finds a column by its [`name`](Self::name).
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|column| column.name() == name)
    }

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
        Self::NONE
            .with(Column::Distance)
            .with(Column::Uncertainty)
            .with(Column::Repeatability)
            .with(Column::Centre)
            .with(Column::Height)
            .with(Column::Rows)
            .with(Column::Exposure)
            .with(Column::Flags)
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
