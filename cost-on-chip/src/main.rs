//! Counts what each estimator takes on the chip.

fn main() {}
