//! How much time a row may take on the chip, whatever is on it.
//!
//! Each row takes what the search, an estimator and the check take. The rest takes time only on some rows:
//! many peaks, a wide spot, a fit, a repair. All these together share one budget. If a repair has too little,
//! the first centre stays: its shape makes u larger, or it has a flag. If the check of a wide spot has too
//! little, the row has a flag. If the fit of a cut or saturated spot has too little, or the fit of the
//! estimator `gauss-newton`, the row has a fault.

/// What a row may still take beyond a plain one. One unit is what a pass of the repair takes for a sample: 40
/// of the chip's instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorkBudget(u16);

/// The units of a row. With 50 fewer, a repair of a clean row among 3000 does not end (host-tests,
/// second_judge.rs).
const WHOLE: u16 = 4250;

impl WorkBudget {
    /// That of a row on which nothing is done yet.
    pub const fn of_row() -> Self {
        Self(WHOLE)
    }

    /// The units that nothing has used yet.
    pub(crate) fn left(self) -> usize {
        self.0.into()
    }

    /// Uses some units. Returns `None`, and uses nothing, if there are fewer.
    #[must_use]
    pub(crate) fn pay(&mut self, units: usize) -> Option<()> {
        let units = u16::try_from(units).ok()?;
        self.0 = self.0.checked_sub(units)?;
        Some(())
    }

    /// Uses some units, or all that are left.
    pub(crate) fn use_up_to(&mut self, units: usize) {
        self.0 = u16::try_from(units).map_or(0, |units| self.0.saturating_sub(units));
    }
}
