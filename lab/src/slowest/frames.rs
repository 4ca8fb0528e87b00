//! The rows among which the slowest of each estimator is looked for.

use cost_on_chip::rows::{PIXELS, WORDS, geometry};
use judges::hard_cases;
use slitrange::centre::Estimator;

use super::slowest_pair;

/// Rows of one frame in their order.
#[derive(Clone, Debug)]
pub struct Frame {
    /// What the rows show.
    pub name: String,
    pub rows: Vec<[u16; WORDS]>,
}

/// The frames that are known to be slow: the rows of the catalogue of hard cases, two of a case, and the rows
/// that `cargo slowest` found.
pub fn frames() -> Vec<Frame> {
    let cases = hard_cases::rows().into_iter();
    let frame = |case: hard_cases::RowCase| {
        let rows = (0..2).filter_map(|number| words(&case.row(number).light));
        Frame {
            rows: rows.collect(),
            name: case.name,
        }
    };
    let found = Estimator::ALL.into_iter().filter_map(slowest_pair);
    let found = found.map(|(before, row)| Frame {
        rows: (before.into_iter().chain([row]))
            .filter_map(|row| row.try_into().ok())
            .collect(),
        name: "found by cargo slowest".into(),
    });
    cases.map(frame).chain(found).collect()
}

/// Pixels at either end that are repeated where a row is shorter than the sensor.
const END: usize = 64;

/// A read-out with this light in the sensor's middle, the shielded pixels being dark. `None` where the light
/// does not fit.
fn words(light: &[u16]) -> Option<[u16; WORDS]> {
    let geometry = geometry();
    let full_scale = geometry.full_scale();
    let dark = light.iter().min().copied()?;
    let mut words = [full_scale.checked_sub(dark)?; WORDS];
    let before = PIXELS.checked_sub(light.len())? / 2;
    let (start, end) = (light.get(..END)?, light.get(light.len() - END..)?);
    for (i, word) in words.get_mut(geometry.light)?.iter_mut().enumerate() {
        let count = match i.checked_sub(before) {
            Some(inside) => light.get(inside).unwrap_or(&end[i % END]),
            None => &start[i % END],
        };
        *word = full_scale.checked_sub(*count)?;
    }
    Some(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_rows_lie_in_the_middle() {
        let light: Vec<u16> = (0..1024).collect();
        let words = words(&light).expect("it fits");
        let light = words.get(geometry().light).expect("a row");
        let counts: Vec<u16> = light.iter().map(|word| 4095 - word).collect();
        assert_eq!(counts[1312..2336], (0..1024).collect::<Vec<u16>>());
        assert!(counts[..1312].iter().all(|count| *count < 64));
        assert!(counts[2336..].iter().all(|count| *count >= 960));
    }

    #[test]
    fn most_hard_cases_fit_on_the_sensor() {
        let frames = frames();
        let whole = frames.iter().filter(|frame| frame.rows.len() == 2);
        assert!(whole.count() * 10 > frames.len() * 9);
    }
}
