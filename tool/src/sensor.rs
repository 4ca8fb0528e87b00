//! A sensor at a serial port.
//!
//! ```text
//! bytes -> lines -> questions and answers -> points taken, records moved, rows shown
//!          (line)   (session, answers)       (run)         (transfer)     (row)
//! ```

pub mod answers;
pub mod doctor;
pub mod flat;
pub mod front_end;
pub mod line;
pub mod monitor;
pub mod port;
pub mod positions;
pub mod record;
pub mod row;
pub mod run;
pub mod session;
pub mod settings;
pub mod stream;
pub mod taken;
pub mod transfer;

pub use doctor::{DoctorOptions, doctor};
pub use flat::{FlatOptions, flat};
pub use front_end::{MeasureOptions, measure};
pub use monitor::{MonitorOptions, monitor};
pub use record::{RecordOptions, record};
pub use row::scope::{ScopeOptions, scope};
pub use row::{RowOptions, row};
pub use run::{RunOptions, run};
pub use settings::{SettingsOptions, settings};
pub use transfer::{ReadOptions, ShowOptions, WriteOptions, read, show, write};
