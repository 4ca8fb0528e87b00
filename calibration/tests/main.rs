//! Fits against known truth: one test program, so that it links only once.

mod fit {
    mod accuracy;
    mod comb;
    mod errors;
    mod profile;
    mod refusals;
    mod truth;
}
