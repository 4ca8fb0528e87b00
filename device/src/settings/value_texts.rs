//! How the value of each type is typed and written.

use core::fmt;

use crate::filters::average::{self, Average};
use crate::filters::{Limits, SpikeFilter};
use crate::settings::columns::{Column, Columns};
use crate::settings::lengths::{read_length, split_unit, write_lengths};
use crate::settings::serial_line::{Baud, Bits, Format, PixelStream};
use crate::settings::trigger::Trigger;
use crate::settings::{Form, ValueError, ValueText, read_number};
use slitrange::base::exposure::{Exposure, ExposureMode};
use slitrange::base::units::{Counts, Units};
use slitrange::frame::comb::Slits;
use slitrange::light::ambient::AmbientMode;
use slitrange::spot::choice::SpotChoice;
use slitrange::spot::region::Region;
use slitrange::{BlackLevel, Estimator, Mean, Surface};

impl ValueText for u16 {
    fn read(words: &[&str], form: Form, _: Units) -> Result<Self, ValueError> {
        match (words, form) {
            (&[word], Form::Number { least, most, .. }) => read_number(word, least, most),
            _ => Err(ValueError::Form),
        }
    }

    fn write(self, f: &mut fmt::Formatter<'_>, _: Option<Units>) -> fmt::Result {
        fmt::Display::fmt(&self, f)
    }
}

impl ValueText for bool {
    fn read(words: &[&str], _: Form, _: Units) -> Result<Self, ValueError> {
        match words {
            ["on"] => Ok(true),
            ["off"] => Ok(false),
            _ => Err(ValueError::Form),
        }
    }

    fn write(self, f: &mut fmt::Formatter<'_>, _: Option<Units>) -> fmt::Result {
        f.write_str(if self { "on" } else { "off" })
    }
}

impl ValueText for Average {
    fn read(words: &[&str], _: Form, _: Units) -> Result<Self, ValueError> {
        let (kind, length): (fn(u8) -> Self, _) = match *words {
            ["none"] => return Ok(Self::None),
            ["moving", length] => (Self::Moving, length),
            ["median", length] => (Self::Median, length),
            ["recursive", length] => (Self::Recursive, length),
            _ => return Err(ValueError::Form),
        };
        Ok(kind(read_number(length, 2, average::LONGEST.into())?))
    }

    fn write(self, f: &mut fmt::Formatter<'_>, _: Option<Units>) -> fmt::Result {
        match self {
            Self::None => f.write_str("none"),
            Self::Moving(length) => write!(f, "moving {length}"),
            Self::Median(length) => write!(f, "median {length}"),
            Self::Recursive(length) => write!(f, "recursive {length}"),
        }
    }
}

impl ValueText for Columns {
    fn read(words: &[&str], _: Form, _: Units) -> Result<Self, ValueError> {
        if words.is_empty() || words.len() > Column::ALL.len() {
            return Err(ValueError::Form);
        }
        words.iter().try_fold(Self::NONE, |columns, name| {
            Ok(columns.with(Column::named(name).ok_or(ValueError::Form)?))
        })
    }

    fn write(self, f: &mut fmt::Formatter<'_>, _: Option<Units>) -> fmt::Result {
        let mut blank = "";
        for column in Column::ALL {
            if self.has(column) {
                write!(f, "{blank}{}", column.name())?;
                blank = " ";
            }
        }
        Ok(())
    }
}

impl ValueText for SpikeFilter {
    fn read(words: &[&str], _: Form, units: Units) -> Result<Self, ValueError> {
        match (words, split_unit(words, units)) {
            (["off"], _) => Ok(Self::Off),
            (_, (&[word], units)) => {
                read_length(word, units, 1, Self::MOST_UM.cast_signed()).map(Self::Beyond)
            }
            _ => Err(ValueError::Form),
        }
    }

    fn write(self, f: &mut fmt::Formatter<'_>, units: Option<Units>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::Beyond(length) => write_lengths(f, &[length], units),
        }
    }
}

impl ValueText for Limits {
    fn read(words: &[&str], _: Form, units: Units) -> Result<Self, ValueError> {
        let (words, units) = match words {
            ["off"] => return Ok(Self::Off),
            words => split_unit(words, units),
        };
        let (low, high, hysteresis) = match *words {
            [low, high] => (low, high, "0"),
            [low, high, hysteresis] => (low, high, hysteresis),
            _ => return Err(ValueError::Form),
        };
        let most = Self::MOST_UM.cast_signed();
        let limit = |word| read_length(word, units, most.saturating_neg(), most);
        let (low, high) = (limit(low)?, limit(high)?);
        let most = Self::MOST_HYSTERESIS_UM.cast_signed();
        let hysteresis = read_length(hysteresis, units, 0, most)?;
        if low > high {
            return Err(ValueError::Range);
        }
        Ok(Self::Within {
            low,
            high,
            hysteresis,
        })
    }

    fn write(self, f: &mut fmt::Formatter<'_>, units: Option<Units>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::Within {
                low,
                high,
                hysteresis,
            } => match hysteresis.to_bits() {
                0 => write_lengths(f, &[low, high], units),
                _ => write_lengths(f, &[low, high, hysteresis], units),
            },
        }
    }
}

impl ValueText for ExposureMode {
    fn read(words: &[&str], form: Form, units: Units) -> Result<Self, ValueError> {
        match words {
            ["auto"] => Ok(Self::Auto),
            words => Exposure::read(words, form, units).map(Self::Fixed),
        }
    }

    fn write(self, f: &mut fmt::Formatter<'_>, units: Option<Units>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Fixed(exposure) => exposure.write(f, units),
        }
    }
}

impl ValueText for Exposure {
    fn read(words: &[&str], _: Form, _: Units) -> Result<Self, ValueError> {
        match *words {
            [us] => {
                let us = read_number(us, 0, u16::MAX.into())?;
                Self::from_us(us).ok_or(ValueError::Range)
            }
            _ => Err(ValueError::Form),
        }
    }

    fn write(self, f: &mut fmt::Formatter<'_>, _: Option<Units>) -> fmt::Result {
        fmt::Display::fmt(&self.us(), f)
    }
}

/// The values of these types are one word each: `name` writes it, `named` reads it. Another word is the error
/// beside the type.
macro_rules! one_word {
    ($($value:ty: $error:ident,)+) => {
        $(impl ValueText for $value {
            fn read(words: &[&str], _: Form, _: Units) -> Result<Self, ValueError> {
                match words {
                    [name] => Self::named(name).ok_or(ValueError::$error),
                    _ => Err(ValueError::Form),
                }
            }

            fn write(self, f: &mut fmt::Formatter<'_>, _: Option<Units>) -> fmt::Result {
                f.write_str(self.name())
            }
        })+
    };
}

one_word! {
    Mean: Form,
    Units: Form,
    AmbientMode: Form,
    Format: Form,
    PixelStream: Form,
    Bits: Form,
    Trigger: Form,
    Slits: Form,
    SpotChoice: Form,
    Estimator: Unlisted,
}

impl ValueText for Baud {
    fn read(words: &[&str], _: Form, _: Units) -> Result<Self, ValueError> {
        let &[word] = words else {
            return Err(ValueError::Form);
        };
        let rate: u32 = read_number(word, 0, u32::MAX)?;
        let found = (Self::ALL.into_iter()).find(|baud| baud.bits_a_second() == rate);
        found.ok_or(ValueError::Range)
    }

    fn write(self, f: &mut fmt::Formatter<'_>, _: Option<Units>) -> fmt::Result {
        fmt::Display::fmt(&self.bits_a_second(), f)
    }
}

impl ValueText for Region {
    fn read(words: &[&str], _: Form, _: Units) -> Result<Self, ValueError> {
        let pixel = |word| read_number(word, 0, Self::ALL.last().into());
        match *words {
            ["all"] => Ok(Self::ALL),
            [first, last] => Self::new(pixel(first)?, pixel(last)?).ok_or(ValueError::Range),
            _ => Err(ValueError::Form),
        }
    }

    fn write(self, f: &mut fmt::Formatter<'_>, _: Option<Units>) -> fmt::Result {
        match self {
            Self::ALL => f.write_str("all"),
            _ => write!(f, "{} {}", self.first(), self.last()),
        }
    }
}

/// The largest black level that can be fixed, in counts: that of a 12-bit converter.
const MAX_BLACK: u32 = 4095;

impl ValueText for BlackLevel {
    fn read(words: &[&str], _: Form, _: Units) -> Result<Self, ValueError> {
        match words {
            ["shielded"] => Ok(Self::Shielded),
            ["frame"] => Ok(Self::Frame),
            ["fixed", counts] => {
                let counts = read_number(counts, 0, MAX_BLACK)?;
                Ok(Self::Fixed(Counts::from_int(counts)))
            }
            _ => Err(ValueError::Form),
        }
    }

    fn write(self, f: &mut fmt::Formatter<'_>, _: Option<Units>) -> fmt::Result {
        match self {
            Self::Shielded => f.write_str("shielded"),
            Self::Frame => f.write_str("frame"),
            Self::Fixed(counts) => write!(f, "fixed {counts:.0}"),
        }
    }
}

/// The largest displacement by a surface that can be set, in micrometres: that of a laser spot of some
/// decimetres.
const MAX_SURFACE: i32 = 50_000;

impl ValueText for Surface {
    fn read(words: &[&str], _: Form, units: Units) -> Result<Self, ValueError> {
        match (words, split_unit(words, units)) {
            (["auto"], _) => Ok(Self::Auto),
            (["off"], _) => Ok(Self::Off),
            (_, (&[word], units)) => read_length(word, units, 0, MAX_SURFACE).map(Self::Fixed),
            _ => Err(ValueError::Form),
        }
    }

    fn write(self, f: &mut fmt::Formatter<'_>, units: Option<Units>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Off => f.write_str("off"),
            Self::Fixed(length) => write_lengths(f, &[length], units),
        }
    }
}
