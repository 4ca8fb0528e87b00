//! A fixed piece of work. `.ci/run` times it, and scales the ceilings of `cargo test` by its time.
//! Its mix is that of a compiler and of a simulated chip: sorted and hashed numbers, branches, some floats.

use std::collections::HashMap;

fn main() {
    let mut state: u64 = 1;
    let mut next = || {
        // Knuth's multiplier of a linear congruential generator modulo 2^64.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        state >> 20
    };
    let mut sum = 0.0;
    for _ in 0..30 {
        let mut numbers: Vec<u64> = (0..2_000_000).map(|_| next()).collect();
        numbers.sort_unstable();
        let mut counts: HashMap<u64, u32> = HashMap::new();
        for number in &numbers {
            *counts.entry(number >> 24).or_default() += 1;
        }
        sum += counts.values().map(|&count| f64::from(count).sqrt().sin()).sum::<f64>();
    }
    println!("{sum}");
}
