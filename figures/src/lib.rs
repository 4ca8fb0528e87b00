//! How the figures of this project look, for the owner's tool and for the lab.
#![forbid(unsafe_code)]

pub mod axes;
pub mod dark;
pub mod fit;
