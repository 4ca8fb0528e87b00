//! The programs that write the figures of the docs, one module each. `cargo NAME` runs one of them.

pub mod ambient;
pub mod comb;
pub mod cost;
pub mod exposure;
pub mod hard_cases;
pub mod points;
pub mod scene;
pub mod serial_line;
pub mod slowest;
pub mod surfaces;
pub mod table1;
pub mod timing;
