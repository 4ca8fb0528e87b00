//! The setting `rate`: leaves lines out.

/// Remembers when the next line is due.
#[derive(Clone, Debug, Default)]
pub struct Rate {
    /// In microseconds since the start.
    due_us: u64,
}

impl Rate {
    /// Whether the line of a result at this time, in microseconds since the start, is sent: at most `rate`
    /// lines a second on average, or all if it is 0.
    pub fn is_due(&mut self, rate: u16, us: u64) -> bool {
        if rate == 0 {
            return true;
        }
        let period = 1_000_000 / u64::from(rate.max(1));
        let early = self.due_us.saturating_sub(us);
        // A line that is due later than in a period was planned for a lower `rate`.
        if early > 0 && early <= period {
            return false;
        }
        let late = us.saturating_sub(self.due_us);
        // A line waits for the end of a frame. The next one is not late by that, too.
        let is_late = early == 0 && late < period;
        let from = if is_late { self.due_us } else { us };
        self.due_us = from.saturating_add(period);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of 16 rows come every 91.2 ms: of 1000, three lines a second are 273.6.
    #[test]
    fn the_mean_rate_is_kept_whatever_the_frames_period_is() {
        let frame_us = 91_200;
        for (rate, expected) in [
            (0, 1000),
            (1, 92),
            (3, 274),
            (10, 912),
            (11, 1000),
            (1000, 1000),
        ] {
            let mut state = Rate::default();
            let sent = (0..1000).filter(|frame| state.is_due(rate, frame * frame_us));
            assert_eq!(sent.count(), expected, "{rate}");
        }
    }

    /// Neither a pause nor another rate makes a burst of lines, or a long silence.
    #[test]
    fn a_pause_or_another_rate_takes_effect_at_once() {
        let mut state = Rate::default();
        assert!(state.is_due(1, 0) && !state.is_due(1, 999_999) && state.is_due(1, 1_000_000));
        assert!(state.is_due(10, 1_100_000) && !state.is_due(10, 1_199_999));
        assert!(state.is_due(10, 60_000_000) && !state.is_due(10, 60_050_000));
    }
}
