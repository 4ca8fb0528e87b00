//! A sensor at a serial port.
//!
//! ```text
//! bytes -> lines -> questions and answers -> points taken, records moved, rows shown
//!          (line)   (session, answers)       (run)         (transfer)     (row)
//! ```

pub mod answers;
pub mod flat;
pub mod front_end;
pub mod line;
pub mod positions;
pub mod record;
pub mod row;
pub mod run;
pub mod session;
pub mod taken;
pub mod transfer;

pub use flat::{FlatOptions, flat};
pub use front_end::{MeasureOptions, measure};
pub use record::{RecordOptions, record};
pub use row::{RowOptions, row};
pub use run::{RunOptions, run};
pub use transfer::{ReadOptions, ShowOptions, WriteOptions, read, show, write};
