//! From points to curves.
//!
//! ```text
//! repeats -> order -> outliers -> eq. (1) -> smooth curve of what it leaves
//! ```
//!
//! [`solve()`](solve::solve) does all of it. With a comb of slits, [`comb`] comes first: it makes one centre
//! of each point's images.

pub mod comb;
pub mod curve;
pub mod eq1;
pub mod observed;
pub mod order;
pub mod outliers;
pub mod repeats;
pub mod solve;
pub mod spline;
pub mod start;
