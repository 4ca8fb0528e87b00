//! What all steps share: units, faults, exposures, arithmetic, and the work that a row may cost.

/// Gives an enum the list of its values, their names, and the value of a name.
#[macro_export]
macro_rules! named {
    ($type:ident { $($value:ident: $name:literal),* }) => {
        impl $type {
            /// All values.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$value),*];

            /// Their names.
            pub const NAMES: &[&str] = &[$($name),*];

            /// Its name in texts.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $name,)*
                }
            }

            /// The value with this [`name`](Self::name).
            pub fn named(name: &str) -> Option<Self> {
                let place = $crate::base::place_of(name, Self::NAMES)?;
                Self::ALL.get(place).copied()
            }
        }
    };
}

/// The place of a name in a list. Not inlined, so that flash does not hold a search for each enum.
#[inline(never)]
pub fn place_of(name: &str, names: &[&str]) -> Option<usize> {
    names.iter().position(|&it| it == name)
}

pub mod drawing;
pub mod exposure;
pub mod fault;
pub(crate) mod numeric;
pub mod order_statistic;
pub mod places;
pub mod units;
pub mod work_budget;

pub(crate) use exposure::{Exposure, ExposureMode};
pub(crate) use fault::Fault;
pub(crate) use named;
pub(crate) use units::{Counts, Electrons, Micrometres, Pixels};
pub(crate) use work_budget::WorkBudget;

/// The most rows in a frame.
pub const MAX_ROWS: u32 = 64;
