//! Drives the head with a S11639 edge by edge.

use super::*;

const CLOCKS: Clocks = Clocks {
    master_hz: 656_250.0,
    serial_hz: 10.5e6,
};

/// A period of CLK, and the time of a word, ns.
const PERIOD: f64 = 16e9 / 10.5e6;

/// One pulse of ST with the words of its row. The default one keeps all limits. Times are in periods of CLK
/// from `begin`, when chip select falls.
#[derive(Clone, Copy)]
struct Sequence {
    /// Since power-on, ns.
    begin: Nanos,
    /// Word 92 is held 0.22 periods after it begins, so 55 % of pixel 0's time have passed then.
    st_falls: f64,
    /// The part of CLK's period that has passed when ST falls.
    part: f64,
    st_low: f64,
    words: usize,
    bits: u8,
    /// SCLK pauses before this word, for so many periods.
    pause: (usize, f64),
    clocks: Clocks,
}

const GOOD: Sequence = Sequence {
    begin: 1_000_000,
    st_falls: 3.669,
    part: 0.5,
    st_low: 101.0,
    words: WORDS,
    bits: 16,
    pause: (0, 0.0),
    clocks: CLOCKS,
};

impl Sequence {
    fn at(&self, periods: f64) -> Nanos {
        self.begin + (periods * PERIOD).round() as Nanos
    }

    fn run(&self, head: &mut SensorHead) {
        head.clocks(self.clocks, self.begin);
        head.chip_select(Level::Low, self.begin);
        let (mut falls, mut rises) = (Some(self.st_falls), Some(self.st_falls + self.st_low));
        let mut end = 0.0;
        for word in 0..self.words {
            end += 1.0;
            if self.pause.0 == word {
                end += self.pause.1;
            }
            if let Some(fall) = falls.take_if(|fall| *fall < end) {
                head.icg(Level::Low, self.at(fall));
                head.st_fell_at(self.part, self.clocks, self.at(fall));
                head.clocks(self.clocks, self.at(fall));
            }
            if let Some(rise) = rises.take_if(|rise| *rise < end) {
                head.icg(Level::High, self.at(rise));
            }
            head.word(self.bits, self.at(end));
        }
        head.chip_select(Level::High, self.at(end + 1.0));
        head.clocks(self.clocks, self.at(end + 1.0));
    }

    /// The only violation of this sequence.
    fn fault(&self) -> String {
        let mut head = head();
        self.run(&mut head);
        only_fault(&head)
    }
}

fn only_fault(head: &SensorHead) -> String {
    match head.violations() {
        [violation] => violation.to_string(),
        violations => panic!("not one violation but {violations:#?}"),
    }
}

#[track_caller]
fn says(fault: &str, words: &str) {
    assert!(fault.contains(words), "{fault:?} does not say {words:?}");
}

/// Pixel n shows 100 + n counts.
fn head() -> SensorHead {
    let light = |_: &Exposure| (0..PIXELS).map(|pixel| 100.0 + pixel as f32).collect();
    SensorHead::with(crate::Sensor::S11639, Box::new(light))
}

#[test]
fn word_92_shows_pixel_0_and_the_output_rises_with_light() {
    let mut head = head();
    GOOD.run(&mut head);
    assert_eq!(head.violations(), []);
    let row = head.last_row().expect("a row");
    assert_eq!(row.lead_in, 92);
    assert_eq!(row.words[91..95], [100, 100, 101, 102]);
    assert_eq!(
        row.words[92 + PIXELS - 1..],
        [vec![2147], vec![100; 12]].concat()
    );
    assert_eq!(row.counts[..3], [100, 101, 102]);
    assert!((0.54..0.56).contains(&row.phase.0) && (0.54..0.56).contains(&row.phase.1));
}

#[test]
fn an_exposure_lasts_from_the_rise_of_st_until_48_periods_after_its_fall() {
    let mut head = head();
    GOOD.run(&mut head);
    let second = Sequence {
        begin: 5_000_000,
        ..GOOD
    };
    second.run(&mut head);
    assert_eq!(head.violations(), []);
    let exposure = head.last_row().expect("a row").exposure;
    assert_eq!(exposure.start, GOOD.at(GOOD.st_falls + GOOD.st_low));
    let end = second.at(second.st_falls + STILL_EXPOSED);
    assert!(exposure.end.abs_diff(end) <= 1, "{exposure:?}");
}

#[test]
fn st_that_is_low_or_high_for_too_short_a_time_is_found() {
    let short = Sequence {
        st_low: 99.5,
        ..GOOD
    };
    says(
        &short.fault(),
        "ST was low for 99.5 periods of CLK; at least 100",
    );

    let mut head = head();
    let before = GOOD.begin - (110.0 * PERIOD) as Nanos;
    head.clocks(CLOCKS, before);
    head.icg(Level::Low, before);
    head.st_fell_at(0.5, CLOCKS, before);
    let fall = GOOD.at(GOOD.st_falls);
    head.icg(Level::High, fall - (5.5 * PERIOD) as Nanos);
    GOOD.run(&mut head);
    says(
        &only_fault(&head),
        "ST was high for 5.5 periods of CLK; at least 6",
    );
}

#[test]
fn st_that_falls_near_a_rise_of_clk_is_found() {
    for part in [0.04, 0.96] {
        // The read-out begins with the next rise: the words begin so that pixels are sampled as before.
        let near = Sequence {
            part,
            st_falls: GOOD.st_falls + part - GOOD.part,
            ..GOOD
        };
        says(
            &near.fault(),
            &format!("ST fell at {:.0} % of CLK's period", part * 100.0),
        );
    }
}

/// The head shows what the converter would show. A pause by whole words is the firmware's to find.
#[test]
fn a_pause_between_two_words_moves_the_pixels_after_it() {
    let by_a_word = Sequence {
        pause: (1092, 1.0),
        ..GOOD
    };
    let mut head = head();
    by_a_word.run(&mut head);
    assert_eq!(head.violations(), []);
    let words = &head.last_row().expect("a row").words;
    assert_eq!(words[1090..1094], [1098, 1099, 1101, 1102]);

    let by_less = Sequence {
        pause: (1092, 0.44),
        ..GOOD
    };
    says(&by_less.fault(), "% to 99.0 % of their time");
}

#[test]
fn rows_that_are_late_or_cut_short_are_found() {
    // A word later: word 91 shows pixel 0.
    let mut late = head();
    let early_fall = Sequence {
        st_falls: GOOD.st_falls - 1.0,
        ..GOOD
    };
    early_fall.run(&mut late);
    assert_eq!(late.last_row().expect("a row").lead_in, 91);

    let mut cut = head();
    let (words, begin) = (1000, GOOD.begin);
    Sequence { words, ..GOOD }.run(&mut cut);
    says(
        &only_fault(&cut),
        "chip select was low for 1000 words; a row is exactly 2152",
    );

    let mut again = head();
    again.clocks(CLOCKS, begin);
    again.chip_select(Level::Low, begin);
    again.icg(Level::Low, GOOD.at(3.67));
    again.st_fell_at(0.5, CLOCKS, GOOD.at(3.67));
    again.icg(Level::High, GOOD.at(110.0));
    for word in 1..=words {
        again.word(16, GOOD.at(word as f64));
    }
    again.icg(Level::Low, GOOD.at(1001.0));
    says(
        &only_fault(&again),
        "ST fell after word 1000 of 2152: the row is cut short",
    );
}

/// The driver measures the program's speed by words before the first pulse of ST.
#[test]
fn words_before_the_first_pulse_of_st_are_no_row_and_later_ones_without_a_pulse_are_found() {
    let before = Sequence {
        begin: 100_000,
        st_falls: 1e6,
        words: 16,
        ..GOOD
    };
    let mut head = head();
    before.run(&mut head);
    assert_eq!(head.violations(), []);
    assert_eq!(head.row_count(), 0);
    GOOD.run(&mut head);
    assert_eq!(head.violations(), []);
    assert_eq!(head.row_count(), 1);

    let begin = 10_000_000;
    Sequence { begin, ..before }.run(&mut head);
    let faults = format!("{:?}", head.violations());
    says(
        &faults,
        "chip select was low for 16 words; a row is exactly 2152",
    );
    says(&faults, "none showed a pixel");
}

#[test]
fn wrong_clocks_and_words_are_found() {
    let fast = Clocks {
        master_hz: 10.5e6,
        ..CLOCKS
    };
    let mut faults = head();
    Sequence {
        clocks: fast,
        ..GOOD
    }
    .run(&mut faults);
    let faults: Vec<String> = faults
        .violations()
        .iter()
        .map(ToString::to_string)
        .collect();
    let all = faults.join("\n");
    says(&all, "CLK is 10.5 MHz; within 0.2 to 10 MHz (S11639)");
    says(
        &all,
        "a pixel lasts 95.238 ns (1 / CLK) and a conversion 1523.810 ns",
    );
    let odd = Sequence { bits: 15, ..GOOD };
    says(&odd.fault(), "a word had 15 bits");
}

/// The firmware for a TCD1304DG gives pulses that this sensor does not take.
#[test]
fn the_pulses_of_a_tcd1304_are_found() {
    let mut head = head();
    head.clocks(CLOCKS, 0);
    head.icg(Level::Low, 1_000_000);
    head.st_fell_at(0.5, CLOCKS, 1_000_000);
    head.sh(Level::High, 1_000_500);
    head.sh(Level::Low, 1_002_000);
    head.icg(Level::High, 1_003_810);
    says(&only_fault(&head), "ST was low for 2.5 periods of CLK");
}
