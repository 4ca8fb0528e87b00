//! What a stream of readings comes to: mean, scatter, rate, faults.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use statistics::Moments;

use crate::sensor::stream::{FrameResult, Kind, fault_kind};

/// So many of the latest readings are shown as a line.
pub const SHOWN: usize = 400;
/// The rate is that of the results of this time.
const RATE_OVER: Duration = Duration::from_secs(5);
/// The kind of a fault in whose place the sensor sends an earlier reading. The line does not say which fault.
pub const HELD: &str = "held";

/// The statistics of all readings since the start.
#[derive(Clone, Debug, Default)]
pub struct Statistics {
    /// The distances of all readings in millimetres.
    pub readings: Moments,
    /// The smallest and the largest distance in millimetres.
    pub extremes_mm: Option<(f64, f64)>,
    /// The number of faults of each kind. A held reading counts as a fault of the kind [`HELD`].
    pub faults: BTreeMap<String, u64>,
    /// Lines that are neither a result nor an answer: noise on the line.
    pub unreadable: u64,
    /// The results that are missing in the sensor's count, if the lines have numbers.
    pub missing: u64,
    /// The sensor leaves results out, by its setting `rate`: the count does not show which ones were lost.
    pub leaves_out: bool,
    number: Option<u32>,
    /// The latest distances in millimetres with the time at which they came. A fault is `None`.
    latest: VecDeque<(Duration, Option<f64>)>,
    /// When the results of the last [`RATE_OVER`] came.
    came: VecDeque<Duration>,
}

impl Statistics {
    /// Takes a result that came at a time.
    pub fn take(&mut self, at: Duration, result: &FrameResult) {
        if let Some(number) = result.number {
            let expected = self.number.map(|before| before.wrapping_add(1));
            // A sensor that started anew counts from the beginning.
            let missing = expected.map_or(0, |expected| number.wrapping_sub(expected));
            if missing < u32::MAX / 2 && !self.leaves_out {
                self.missing += u64::from(missing);
            }
            self.number = Some(number);
        }
        self.came.push_back(at);
        let is_old = |first: &mut Duration| *first + RATE_OVER < at;
        while self.came.pop_front_if(is_old).is_some() {}
        let distance = match (result.kind, result.distance_mm) {
            (Kind::Reading | Kind::Difference, Some(mm)) => {
                self.readings.add(mm);
                let (least, most) = self.extremes_mm.unwrap_or((mm, mm));
                self.extremes_mm = Some((least.min(mm), most.max(mm)));
                Some(mm)
            }
            (kind, _) => {
                let fault = match kind {
                    Kind::Held => HELD,
                    _ => fault_kind(&result.fault),
                };
                *self.faults.entry(fault.to_owned()).or_default() += 1;
                None
            }
        };
        self.latest.push_back((at, distance));
        if self.latest.len() > SHOWN {
            self.latest.pop_front();
        }
    }

    /// Results a second over the last five seconds, if there are two.
    pub fn rate(&self) -> Option<f64> {
        let time = *self.came.back()? - *self.came.front()?;
        (!time.is_zero()).then(|| (self.came.len() - 1) as f64 / time.as_secs_f64())
    }

    /// The number of faults.
    pub fn all_faults(&self) -> u64 {
        self.faults.values().sum()
    }

    /// The latest results: the time at which they came, and the distance in millimetres.
    pub fn latest(&self) -> impl Iterator<Item = (Duration, Option<f64>)> {
        self.latest.iter().copied()
    }

    /// One line: how many, the rate, the mean and the scatter.
    pub fn line(&self) -> String {
        let mut line = format!("{} readings", self.readings.count);
        if let Some(rate) = self.rate() {
            line += &format!(", {rate:.1} a second");
        }
        if let Some(mean) = self.readings.mean() {
            line += &format!(", mean {mean:.4} mm");
        }
        if let Some(deviation) = self.readings.deviation() {
            line += &format!(", standard deviation {deviation:.4} mm");
        }
        if let Some((least, most)) = self.extremes_mm {
            line += &format!(", {least:.4} to {most:.4} mm");
        }
        line
    }

    /// One line: the faults by their kinds.
    pub fn faults_line(&self) -> String {
        if self.faults.is_empty() {
            return "no faults".to_owned();
        }
        let word = |(kind, count): (&String, &u64)| format!("{count} {kind}");
        let kinds: Vec<String> = self.faults.iter().map(word).collect();
        format!("faults: {}", kinds.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::stream::frame_result;

    /// Of these lines, with `; ` between them.
    fn taken(lines: &str) -> Statistics {
        let mut statistics = Statistics::default();
        for (place, line) in lines.split("; ").enumerate() {
            let at = Duration::from_millis(100 * place as u64);
            statistics.take(at, &frame_result(line).expect("a result"));
        }
        statistics
    }

    #[test]
    fn mean_deviation_and_extremes_are_those_of_the_readings() {
        let statistics = taken("d 1.0 mm; d 2.0 mm; f laser off; d 3.0 mm; d 6.0 mm");
        assert_eq!(statistics.readings.count, 4);
        assert_eq!(statistics.readings.mean(), Some(3.0));
        // 4 + 1 + 0 + 9 over 3.
        let deviation = statistics.readings.deviation().expect("two readings");
        assert!((deviation - (14.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert_eq!(statistics.extremes_mm, Some((1.0, 6.0)));
        // Four steps of 0.1 s.
        let rate = statistics.rate().expect("two results");
        assert!((rate - 10.0).abs() < 1e-9, "{rate}");
        assert_eq!(statistics.faults_line(), "faults: 1 laser off");
        assert_eq!(taken("d 5.0 mm").readings.deviation(), None);
    }

    #[test]
    fn held_readings_are_no_readings() {
        let statistics = taken("d 1.0 mm; d 1.0 mm g h 1; d 1.0 mm h 2 s; f laser off; d 3.0 mm g");
        assert_eq!(statistics.readings.count, 2);
        // 1 + 1 over 1.
        assert_eq!(statistics.readings.deviation(), Some(2.0_f64.sqrt()));
        assert_eq!(statistics.faults_line(), "faults: 2 held, 1 laser off");
        let shown: Vec<_> = statistics.latest().map(|(_, mm)| mm).collect();
        assert_eq!(shown, [Some(1.0), None, None, None, Some(3.0)]);
    }

    #[test]
    fn what_is_left_out_on_purpose_is_not_missing() {
        let mut statistics = Statistics::default();
        for (leaves_out, line) in [
            (true, "# 5 d 1.0 mm"),
            (true, "# 15 d 1.0 mm"),
            (false, "# 16 d 1.0 mm"),
            (false, "# 18 d 1.0 mm"),
        ] {
            statistics.leaves_out = leaves_out;
            statistics.take(Duration::ZERO, &frame_result(line).expect("a result"));
        }
        assert_eq!(statistics.missing, 1);
    }

    #[test]
    fn numbers_tell_what_is_missing() {
        let missing = |lines| taken(lines).missing;
        let two = "# 5 d 1.0 mm; # 6 d 1.0 mm; # 9 f laser off; # 10 d 1.0 mm";
        assert_eq!(missing(two), 2);
        // A restart is no loss.
        assert_eq!(missing("# 500 d 1.0 mm; # 1 d 1.0 mm; # 3 d 1.0 mm"), 1);
    }
}
