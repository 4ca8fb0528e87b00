//! Statistics of measured values, which are passed by value or by reference. Too few values give NaN.
//!
//! Sums follow the order of the values, so the same values in the same order give the same bits.
#![forbid(unsafe_code)]

use std::borrow::Borrow;

fn floats(values: impl IntoIterator<Item: Borrow<f64>>) -> impl Iterator<Item = f64> {
    values
        .into_iter()
        .map(|value| *Borrow::<f64>::borrow(&value))
}

fn sorted(values: impl IntoIterator<Item: Borrow<f64>>) -> Vec<f64> {
    let mut values: Vec<f64> = floats(values).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The least and the largest value: infinity and its negative without a value.
pub fn least_and_most(values: impl IntoIterator<Item: Borrow<f64>>) -> (f64, f64) {
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    floats(values).fold(none, |(least, most), it| (least.min(it), most.max(it)))
}

/// The arithmetic mean.
pub fn mean(values: impl IntoIterator<Item: Borrow<f64>>) -> f64 {
    let add = |(sum, count), value| (sum + value, count + 1.0);
    let (sum, count) = floats(values).fold((0.0, 0.0), add);
    sum / count
}

/// The root mean square.
pub fn rms(values: impl IntoIterator<Item: Borrow<f64>>) -> f64 {
    mean(floats(values).map(|value| value * value)).sqrt()
}

/// The variance of one value about the mean, estimated from two values or more (n - 1 in the denominator).
pub fn variance(values: impl IntoIterator<Item: Borrow<f64>>) -> f64 {
    let values: Vec<f64> = floats(values).collect();
    let mean = mean(&values);
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    squares / (values.len() as f64 - 1.0)
}

/// The root of the [`variance`].
pub fn standard_deviation(values: impl IntoIterator<Item: Borrow<f64>>) -> f64 {
    variance(values).sqrt()
}

/// Mean and scatter of values that come one after the other (Welford's algorithm, which does not cancel).
#[derive(Clone, Copy, Debug, Default)]
pub struct Moments {
    /// How many values came.
    pub count: u64,
    mean: f64,
    /// The sum of the squared differences from the mean.
    squares: f64,
}

impl Moments {
    /// Adds a value.
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        let before = value - self.mean;
        self.mean += before / self.count as f64;
        self.squares += before * (value - self.mean);
    }

    /// The mean. `None` without a value.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then_some(self.mean)
    }

    /// The standard deviation of a value. `None` of fewer than two values.
    pub fn deviation(&self) -> Option<f64> {
        (self.count > 1).then(|| (self.squares / (self.count - 1) as f64).sqrt())
    }
}

/// The middle value, or the mean of the middle two.
pub fn median(values: impl IntoIterator<Item: Borrow<f64>>) -> f64 {
    let values = sorted(values);
    match values.len() {
        0 => f64::NAN,
        n => 0.5 * (values[(n - 1) / 2] + values[n / 2]),
    }
}

/// The middle value, or the upper of the middle two.
pub fn upper_median(values: impl IntoIterator<Item: Borrow<f64>>) -> f64 {
    let values = sorted(values);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The value below which a share of the values lies, from 0 to 1: the value of the nearest rank.
pub fn quantile(values: impl IntoIterator<Item: Borrow<f64>>, share: f64) -> f64 {
    let values = sorted(values);
    let rank = (share * values.len().saturating_sub(1) as f64).round() as usize;
    values.get(rank).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 to n: the mean is (n + 1) / 2, the mean square (n + 1)(2 n + 1) / 6, the variance n (n + 1) / 12.
    #[test]
    fn moments_have_their_closed_forms() {
        for count in 2..50u32 {
            let values = || (1..=count).map(f64::from);
            let n = f64::from(count);
            let is_near = |value: f64, expected: f64| (value / expected - 1.0).abs() < 1e-14;
            assert_eq!(mean(values()), (n + 1.0) / 2.0);
            assert!(is_near(
                rms(values()).powi(2),
                (n + 1.0) * (2.0 * n + 1.0) / 6.0
            ));
            assert!(is_near(variance(values()), n * (n + 1.0) / 12.0));
            assert_eq!(standard_deviation(values()), variance(values()).sqrt());
            let mut moments = Moments::default();
            assert_eq!((moments.mean(), moments.deviation()), (None, None));
            values().for_each(|value| moments.add(value));
            assert!(is_near(moments.mean().expect("values"), (n + 1.0) / 2.0));
            let deviation = moments.deviation().expect("two values");
            assert!(is_near(deviation.powi(2), n * (n + 1.0) / 12.0));
        }
    }

    #[test]
    fn the_median_is_the_middle_or_between_the_middle_two() {
        assert_eq!(median([3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median([4.0, 1.0, 3.0, 2.0]), 2.5);
        let one = vec![7.0];
        assert_eq!((median(&one), upper_median(&one)), (7.0, 7.0));
        assert_eq!(upper_median([3.0, 1.0, 2.0]), 2.0);
        assert_eq!(upper_median([4.0, 1.0, 3.0, 2.0]), 3.0);
    }

    #[test]
    fn a_quantile_has_the_nearest_rank() {
        let values = [5.0, 1.0, 4.0, 2.0, 3.0];
        let shares = [0.0, 0.12, 0.13, 0.5, 0.87, 0.88, 1.0];
        let found = shares.map(|share| quantile(values, share));
        assert_eq!(found, [1.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.0]);
    }

    #[test]
    fn too_few_values_give_nan() {
        let none: [f64; 0] = [];
        let of_none = [mean, rms, median, upper_median].map(|of: fn([f64; 0]) -> f64| of(none));
        assert!(of_none.iter().all(|value| value.is_nan()));
        assert!(quantile(none, 0.5).is_nan());
        assert!(variance([1.0]).is_nan() && standard_deviation([1.0]).is_nan());
    }
}
