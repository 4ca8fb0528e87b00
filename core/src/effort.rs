//! How much time a row may take on the chip, whatever is on it.
//!
//! Nearly all rows take what the plain search, an estimator and the check take. The rest takes time only on
//! some rows: a tilt, narrow spots, wide light, a repair, light that may be another spot. All these together
//! share one effort. What it does not suffice for is not done: then the row has a flag, or it is a fault.

/// What a row may still take beyond a plain one. One unit is 40 of the chip's instructions: as many as the
/// repair's passes take for a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort(u16);

impl Effort {
    /// Nothing is done yet.
    pub const WHOLE: Self = Self(5200);

    /// What is left.
    pub(crate) fn left(self) -> usize {
        self.0.into()
    }

    /// Takes from what is left. `None` if too little is left.
    #[must_use]
    pub(crate) fn pay(&mut self, units: usize) -> Option<()> {
        let units = u16::try_from(units).ok()?;
        self.0 = self.0.checked_sub(units)?;
        Some(())
    }
}
