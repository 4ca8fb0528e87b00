//! The Allan deviation: how much the means of neighbouring stretches of readings differ.
//!
//! White noise falls with the square root of the time, a drift rises in proportion to it. The time of the
//! smallest deviation is the longest over which averaging helps. Formulae: Riley, Handbook of Frequency
//! Stability Analysis, NIST SP 1065 (2008), section 5.2.5.

/// Times to a decade of the curve.
const A_DECADE: f64 = 10.0;

/// The overlapped Allan deviation of the means of `m` values. `None` if there are fewer than `2 m` values, or
/// `m` is 0.
pub fn deviation(values: &[f64], m: usize) -> Option<f64> {
    let terms = (values.len() + 1)
        .checked_sub(2 * m)
        .filter(|&terms| terms > 0 && m > 0)?;
    // The sums are of small numbers, so that little cancels.
    let first = values.first()?;
    let mut sums = vec![0.0];
    for value in values {
        sums.push(sums[sums.len() - 1] + (value - first));
    }
    let squares = (0..terms).map(|at| {
        let step = sums[at + 2 * m] - 2.0 * sums[at + m] + sums[at];
        let step = step / m as f64;
        step * step
    });
    Some((squares.sum::<f64>() / (2.0 * terms as f64)).sqrt())
}

/// The curve: the time of a mean in seconds, and the deviation, up to a third of the values.
pub fn curve(values: &[f64], interval_s: f64) -> Vec<(f64, f64)> {
    let mut lengths: Vec<usize> = (0..)
        .map(|step| 10f64.powf(f64::from(step) / A_DECADE).round() as usize)
        .take_while(|m| 3 * m <= values.len())
        .collect();
    lengths.dedup();
    let point = |m: usize| Some((m as f64 * interval_s, deviation(values, m)?));
    lengths.into_iter().filter_map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The data and the results of NIST SP 1065, section 12.4: 1000 numbers of a generator.
    #[test]
    fn the_handbook_s_numbers_come_out() {
        let mut state: u64 = 1_234_567_890;
        let mut values = vec![];
        for _ in 0..1000 {
            values.push(state as f64 / 2_147_483_647.0);
            state = state * 16_807 % 2_147_483_647;
        }
        for (m, expected) in [(1, 2.922_319e-1), (10, 9.159_953e-2), (100, 3.241_343e-2)] {
            let found = deviation(&values, m).expect("enough values");
            println!("{m}: {found:.6e}");
            assert!((found / expected - 1.0).abs() < 1e-6, "{m}: {found}");
        }
    }

    #[test]
    fn a_drift_rises_with_the_time_and_a_constant_is_zero() {
        // 0.5 mm a second, a reading each 0.1 s: drift * time / sqrt 2.
        let values: Vec<f64> = (0..300).map(|at| 800.0 + 0.05 * f64::from(at)).collect();
        for (time, found) in curve(&values, 0.1) {
            let expected = 0.5 * time / 2f64.sqrt();
            assert!((found / expected - 1.0).abs() < 1e-9, "{time}: {found}");
        }
        assert_eq!(deviation(&[800.0; 10], 3), Some(0.0));
        for (values, m) in [(&[1.0; 5][..], 3), (&[1.0; 5], 0), (&[], 1)] {
            assert_eq!(deviation(values, m), None);
        }
    }
}
