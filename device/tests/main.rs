//! What the crate promises of its types.

mod memory;
