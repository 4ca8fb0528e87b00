//! Random numbers that are the same in each run.

/// A number whose bits all depend on all bits of `seed` (the finaliser of SplitMix64).
pub(crate) fn mixed(seed: u64) -> u64 {
    let mut bits = (seed ^ seed >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ bits >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    bits ^ bits >> 31
}
