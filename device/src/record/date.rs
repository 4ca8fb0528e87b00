//! A day.

use core::fmt;

/// A day of the Gregorian calendar, of a year with four digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Date {
    year: u16,
    month: u8,
    day: u8,
}

impl Date {
    /// The date of the nominal calibration, which nobody made.
    pub const NEVER: Self = Self {
        year: 1,
        month: 1,
        day: 1,
    };

    /// The day of that year (1 to 9999), month (1 to 12) and day of the month, if there is one.
    pub const fn new(year: u16, month: u8, day: u8) -> Option<Self> {
        let leap = year.is_multiple_of(4) && !year.is_multiple_of(100) || year.is_multiple_of(400);
        let days = match month {
            1 | 3 | 5 | 7 | 8 | 10 | 12 => 31,
            4 | 6 | 9 | 11 => 30,
            2 if leap => 29,
            2 => 28,
            _ => 0,
        };
        if year == 0 || year > 9999 || day == 0 || day > days {
            return None;
        }
        Some(Self { year, month, day })
    }

    /// Year, month and day of the month.
    pub const fn parts(self) -> (u16, u8, u8) {
        (self.year, self.month, self.day)
    }
}

impl fmt::Display for Date {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NEVER => f.write_str("never"),
            Self { year, month, day } => write!(f, "{year:04}-{month:02}-{day:02}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_days_as_the_calendar_has() {
        let days = |year| {
            let all = (0..=255).flat_map(|month| (0..=255).map(move |day| (month, day)));
            all.filter_map(|(month, day)| Date::new(year, month, day))
                .count()
        };
        for (year, count) in [
            (0, 0),
            (1, 365),
            (1900, 365),
            (2000, 366),
            (2026, 365),
            (2028, 366),
            (9999, 365),
            (10_000, 0),
        ] {
            assert_eq!(days(year), count, "{year}");
        }
        assert!(Date::new(2028, 2, 29) > Date::new(2028, 2, 28));
        assert_eq!(Date::new(2026, 4, 31), None);
        let day = Date::new(2026, 1, 9).map(|date| date.to_string());
        assert_eq!(day.as_deref(), Some("2026-01-09"));
    }
}
