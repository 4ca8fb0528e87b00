//! `cargo cost`: what accuracy costs in time.

fn main() {}
