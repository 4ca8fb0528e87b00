//! The figures under `docs/figures/` whose names begin with `paper-`.

mod eq1;
mod errors;
mod style;
mod violins;

use std::path::Path;

use crate::programs::table1::report::Report;

pub fn draw(report: &Report, directory: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(directory)?;
    errors::draw(report, &directory.join("paper-errors.svg"))?;
    eq1::draw(report, &directory.join("paper-eq1.svg"))?;
    violins::draw(report, &directory.join("paper-violins.svg"))
}
