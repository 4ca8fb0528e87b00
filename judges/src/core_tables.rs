//! Phase tables made on the PC, handed to the core: other weights, other profiles.

use phase_tables::IntegerTable;
use slitrange::centre::tables::Table;

/// The tables as the core reads them; `TableSet::new` takes and proves the slice.
pub fn borrow(tables: &[IntegerTable]) -> Vec<Table<'_>> {
    tables
        .iter()
        .map(|table| Table {
            width: table.shape.width as f32,
            half_width: u8::try_from(table.shape.half_width).expect("windows are short"),
            phases: u8::try_from(table.shape.phases).expect("phases are few"),
            weights: &table.weights,
            stretch: &table.stretch,
            near_limit: table.shape.near_limit() as f32,
            centre_per_ratio: table.centre_per_ratio as f32,
            bend: table.bend as f32,
            stretch_per_ratio: table.stretch_per_ratio as f32,
            height_per_slope: table.height_per_slope as f32,
            variance_per_noise: table.variance_per_noise as f32,
            variance_per_height: table.variance_per_height as f32,
        })
        .collect()
}
