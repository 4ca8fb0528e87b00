//! Drives the sensor head edge by edge.

use super::*;
use simulator::with;

const CLOCKS: Clocks = Clocks {
    master_hz: 2.625e6,
    serial_hz: 10.5e6,
};

/// One pulse sequence and burst; its instants are counted from `begin`, ns. The default one keeps all limits.
#[derive(Clone, Copy)]
struct Sequence {
    begin: Nanos,
    sh_after_icg: Nanos,
    sh_high: Nanos,
    icg_after_sh: Nanos,
    /// From ICG's rise to the begin of the first word, which is held 3.5 SCLK = 333 ns later; a pixel lasts
    /// 1524 ns.
    burst_after: f64,
    words: usize,
    bits: u8,
    clocks: Clocks,
}

const GOOD: Sequence = Sequence {
    begin: 1_000_000,
    sh_after_icg: 500,
    sh_high: 1500,
    icg_after_sh: 1500,
    burst_after: 500.0,
    words: PIXELS,
    bits: 16,
    clocks: CLOCKS,
};

impl Sequence {
    fn pulses(&self, head: &mut SensorHead) -> Nanos {
        let mut now = self.begin;
        head.icg(Level::Low, now);
        now += self.sh_after_icg;
        head.sh(Level::High, now);
        now += self.sh_high;
        head.sh(Level::Low, now);
        now += self.icg_after_sh;
        head.icg(Level::High, now);
        head.clocks(self.clocks, now);
        now
    }

    fn burst(&self, head: &mut SensorHead, read_out: Nanos) {
        let begin = read_out as f64 + self.burst_after;
        let word_time = 16e9 / self.clocks.serial_hz;
        head.chip_select(Level::Low, begin as Nanos);
        for word in 1..=self.words {
            head.word(self.bits, (begin + word as f64 * word_time) as Nanos);
        }
        let end = (begin + (self.words + 1) as f64 * word_time) as Nanos;
        head.chip_select(Level::High, end);
        head.clocks(self.clocks, end);
    }

    fn run(&self, head: &mut SensorHead) {
        let read_out = self.pulses(head);
        self.burst(head, read_out);
    }

    fn from(begin: Nanos) -> Self {
        Self { begin, ..GOOD }
    }
}

fn exposed(start: Nanos, end: Nanos) -> Exposure {
    Exposure {
        start,
        end,
        laser: 0,
    }
}

/// Pixel n shows n / 2 counts.
fn head() -> SensorHead {
    SensorHead::new(Box::new(|_| {
        (0..PIXELS).map(|pixel| (pixel / 2) as f32).collect()
    }))
}

/// Asserts that a fault says all of these words, which commas divide.
#[track_caller]
fn says(fault: &str, words: &str) {
    for word in words.split(", ") {
        assert!(fault.contains(word), "{fault:?} does not say {word:?}");
    }
}

#[track_caller]
fn says_only(head: &SensorHead, words: &str) {
    let [violation] = &head.violations.first[..] else {
        panic!("not one violation but {:#?}", head.violations);
    };
    says(&violation.to_string(), words);
}

#[test]
fn a_row_has_its_counts_by_pixel_and_its_words_as_sent() {
    let mut head = head();
    GOOD.run(&mut head);
    assert_eq!(head.violations.first, []);
    let row = head.last_row().unwrap();
    assert_eq!((row.number, row.lead_in), (0, 0));
    assert_eq!(row.exposure, exposed(0, 1_002_000));
    assert_eq!(row.read_out, 1_003_500);
    assert_eq!(row.counts[0..4], [0, 0, 1, 1]);
    // The output falls with light.
    assert_eq!(row.words[0..4], [4095, 4095, 4094, 4094]);
    let (least, most) = row.phase;
    assert!(0.53 <= least && most < 0.56, "{row:?}");
}

#[test]
fn an_exposure_lasts_from_pulse_to_pulse() {
    let mut head = head();
    GOOD.run(&mut head);
    // A pulse while ICG is high clears the photodiodes: a new exposure begins.
    head.sh(Level::High, 8_000_000);
    head.sh(Level::Low, 8_002_000);
    Sequence::from(9_000_000).run(&mut head);
    assert_eq!(head.violations.first, []);
    let exposure = head.last_row().unwrap().exposure;
    assert_eq!(exposure, exposed(8_002_000, 9_002_000));
    assert_eq!(exposure.duration(), 1_000_000);
}

#[test]
fn the_lead_in_says_which_word_shows_pixel_0() {
    // A burst that begins two pixels before ICG rises.
    let mut early = head();
    let read_out = GOOD.begin + 3500;
    let begin = read_out as f64 + 500.0 - 2.0 * 16e9 / 10.5e6;
    early.icg(Level::Low, GOOD.begin);
    early.clocks(CLOCKS, GOOD.begin);
    early.chip_select(Level::Low, begin as Nanos);
    early.sh(Level::High, GOOD.begin + 500);
    early.sh(Level::Low, GOOD.begin + 2000);
    for word in 1..=PIXELS {
        let now = (begin + word as f64 * 16e9 / 10.5e6) as Nanos;
        if word == 3 {
            early.icg(Level::High, read_out);
            early.clocks(CLOCKS, read_out);
        }
        early.word(16, now);
    }
    early.chip_select(Level::High, 10_000_000);
    assert_eq!(early.violations.first, []);
    let row = early.last_row().unwrap();
    assert_eq!(row.lead_in, 2);
    assert_eq!(row.words[2..6], [4095, 4095, 4094, 4094]);
    // Pixels that no word shows are as the shielded ones.
    assert_eq!(row.counts[PIXELS - 2..], [10, 10]);

    let mut late = head();
    with(GOOD, |it| it.burst_after = 500.0 + 16e9 / 10.5e6).run(&mut late);
    assert_eq!(late.violations.first, []);
    let row = late.last_row().unwrap();
    assert_eq!(row.lead_in, -1);
    assert_eq!(row.counts[1..4], [0, 1, 1]);
    // After the last pixel the output is unlit.
    assert_eq!(row.words[PIXELS - 1], 4095 - 10);
}

#[test]
fn counts_are_rounded_and_clipped_to_twelve_bits() {
    let mut head = SensorHead::new(Box::new(|_| {
        let mut row = vec![-3.0, 5000.0, 99.5, f32::NAN];
        row.resize(PIXELS, 100.4);
        row
    }));
    GOOD.run(&mut head);
    assert_eq!(head.last_row().unwrap().counts[..5], [0, 4095, 100, 0, 100]);
}

#[test]
fn either_the_last_rows_or_all_rows_are_kept() {
    let mut head = head();
    let run = |head: &mut SensorHead, from: u64, to: u64| {
        for number in from..to {
            Sequence::from(1_000_000 + number * 7_000_000).run(head);
        }
    };
    run(&mut head, 0, 70);
    assert_eq!((head.row_count, head.rows().len()), (70, ROWS_KEPT));
    assert_eq!(head.rows().next().unwrap().number, 6);
    head.keeps_all_rows = true;
    run(&mut head, 70, 80);
    assert_eq!(head.rows().len(), ROWS_KEPT + 10);
}

#[test]
fn each_limit_that_a_sequence_breaks_is_a_violation() {
    type Change = fn(&mut Sequence);
    let cases: [(Change, &str); 9] = [
        (
            |it| it.sh_after_icg = 99,
            "SH rose 99 ns, 100 to 1000 ns, TCD1304 t2, at 1.000099 ms",
        ),
        (
            |it| it.sh_after_icg = 1001,
            "SH rose 1001 ns, 100 to 1000 ns",
        ),
        (
            |it| it.sh_high = 999,
            "SH was high for 999 ns, at least 1000, TCD1304 t3",
        ),
        (
            |it| it.icg_after_sh = 999,
            "ICG rose 999 ns after SH fell, at least 1000 ns, TCD1304 t1",
        ),
        (|it| it.words = 3693, "low for 3693 words, exactly 3694"),
        (|it| it.words = 3695, "low for 3695 words"),
        // 19 % and 96 % of a pixel's 1523.8 ns, less the 333.3 ns until the converter holds.
        (
            |it| it.burst_after = 0.19 * 1523.81 - 333.33,
            "at 18.9 % to 19.0 %, within 20 % to 95 %",
        ),
        (|it| it.burst_after = 0.96 * 1523.81 - 333.33, "96.0 %"),
        (|it| it.bits = 8, "a word had 8 bits, 16 SCLK"),
    ];
    for (change, words) in cases {
        let (mut head, mut sequence) = (head(), GOOD);
        change(&mut sequence);
        sequence.run(&mut head);
        says(&head.violations.first[0].to_string(), words);
        // Short words also show the wrong pixels.
        assert!(sequence.bits != GOOD.bits || head.violations.count == 1);
    }
}

/// Asserts that this breaks one limit, whose violation says all of these words.
#[track_caller]
fn breaks_only(words: &str, edges: impl FnOnce(&mut SensorHead)) {
    let mut head = head();
    edges(&mut head);
    says_only(&head, words);
}

#[test]
fn each_limit_that_single_edges_break_is_a_violation() {
    breaks_only("ICG fell while SH was high", |head| {
        head.sh(Level::High, 1000);
        head.icg(Level::Low, 1500);
        head.sh(Level::Low, 3000);
    });
    breaks_only("ICG rose while SH was high", |head| {
        head.icg(Level::Low, 1000);
        head.sh(Level::High, 1500);
        head.icg(Level::High, 3000);
    });
    breaks_only("the exposure was 9999 ns, at least 10000, tINT", |head| {
        head.sh(Level::High, 990_000);
        head.sh(Level::Low, 992_001);
        GOOD.run(head);
    });
    let lengths = "a pixel lasts 1523.505 ns, a conversion 1523.810 ns, 0.0001";
    breaks_only(lengths, |head| {
        let mut fault = GOOD;
        fault.clocks.master_hz *= 1.0002;
        fault.pulses(head);
    });
    breaks_only("with chip select high", |head| {
        assert_eq!(head.word(16, 1000), 0);
    });
    breaks_only("3694 words, none showed a pixel", |head| {
        head.clocks(CLOCKS, 0);
        GOOD.burst(head, 1_000_000);
        assert_eq!(head.row_count, 0);
    });
    // ICG alone starts no read-out.
    breaks_only("none showed a pixel", |head| {
        head.icg(Level::Low, 1_000_000);
        head.icg(Level::High, 1_003_000);
        head.clocks(CLOCKS, 1_003_000);
        GOOD.burst(head, 1_003_000);
    });
    breaks_only("ICG fell after word 1 of 3694, cut short", |head| {
        GOOD.pulses(head);
        head.chip_select(Level::Low, 1_004_000);
        head.word(16, 1_006_000);
        head.icg(Level::Low, 1_007_000);
    });
    breaks_only("0x10008000, core-coupled RAM, RM0090", |head| {
        head.dma_address(0x2000_0000, 5);
        head.dma_address(0x1000_8000, 6);
    });
}

#[test]
fn a_master_clock_out_of_range_is_a_violation() {
    // The converter's clock changes too, so that only one limit is violated.
    let (mut head, mut fast) = (head(), GOOD);
    (fast.clocks.master_hz, fast.clocks.serial_hz) = (4.05e6, 16.2e6);
    fast.pulses(&mut head);
    assert_eq!(head.violations.count, 2);
    let [fm, sclk] = [0, 1].map(|i| head.violations.first[i].to_string());
    says(&fm, "fM is 4.05 MHz, 0.8 to 4 MHz");
    says(&sclk, "SCLK is 16.2 MHz, 8 to 16 MHz, ADC122S101");
}

#[test]
fn a_stopped_master_clock_is_a_violation() {
    let (mut head, mut stopped) = (head(), GOOD);
    stopped.clocks.master_hz = 0.0;
    stopped.run(&mut head);
    says(&head.violations.first[0].what, "fM does not run");
    says(&head.violations.first[1].what, "without the master clock");
    assert_eq!(head.row_count, 0);
}

#[test]
fn wrong_clocks_are_reported_once_a_row() {
    let (mut head, mut wrong) = (head(), GOOD);
    wrong.clocks.master_hz = 2.7e6;
    wrong.pulses(&mut head);
    head.clocks(wrong.clocks, 2_000_000);
    assert_eq!(head.violations.count, 1);
}

#[test]
fn a_light_source_with_the_wrong_number_of_pixels_is_a_violation() {
    let mut head = SensorHead::new(Box::new(|_| vec![100.0; 128]));
    GOOD.run(&mut head);
    says_only(&head, "gave 128 pixels, 3694");
}

#[test]
fn a_restart_violates_nothing() {
    let mut head = head();
    GOOD.pulses(&mut head);
    head.chip_select(Level::Low, 1_004_000);
    head.word(16, 1_006_000);
    head.restarted(1_500_000);
    // The firmware configures its pins again.
    head.icg(Level::High, 2_000_000);
    head.sh(Level::Low, 2_000_000);
    head.chip_select(Level::High, 2_000_000);
    Sequence::from(3_000_000).run(&mut head);
    assert_eq!(head.violations.first, []);
    let exposure = head.last_row().unwrap().exposure;
    assert_eq!(exposure, exposed(1_002_000, 3_002_000));
}

#[test]
fn violations_are_counted_even_if_they_are_not_kept() {
    let mut head = head();
    for now in 0..300 {
        head.word(16, now);
    }
    let (kept, all) = (head.violations.first.len(), head.violations.count);
    assert_eq!((kept, all), (200, 300));
}
