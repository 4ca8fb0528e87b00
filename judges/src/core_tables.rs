//! Phase tables made on the PC, handed to the core: other weights, other profiles.

use phase_tables::IntegerTable;
use slitrange::centre::tables::Table;

/// The tables as the core reads them; `TableSet::new` takes and proves the slice.
pub fn borrow(tables: &[IntegerTable]) -> Vec<Table<'_>> {
    tables
        .iter()
        .map(|table| Table {
            half_width: u8::try_from(table.shape.half_width).expect("windows are short"),
            phases: u8::try_from(table.shape.phases).expect("phases are few"),
            weights: &table.weights,
            stretch: &table.stretch,
            width: table.width,
            per_width: table.per_width,
            near_limit: table.near_limit,
            centre_per_ratio: table.centre_per_ratio,
            bend: table.bend,
            stretch_per_ratio: table.stretch_per_ratio,
            height_per_slope: table.height_per_slope,
            deviation_per_noise: table.deviation_per_noise,
            shot_share: table.shot_share,
        })
        .collect()
}
