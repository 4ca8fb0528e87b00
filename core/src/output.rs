//! What happens to a reading before it becomes a line, as the settings say.
//!
//! ```text
//! frame's reading -> zero -> columns -> line
//! ```

pub mod columns;
