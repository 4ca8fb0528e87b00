//! Drives the sensor head edge by edge.

use super::*;

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

/// Pixel n shows n / 2 counts.
fn head() -> SensorHead {
    SensorHead::new(Box::new(|_| {
        (0..PIXELS).map(|pixel| (pixel / 2) as f32).collect()
    }))
}

#[track_caller]
fn says(fault: &str, words: &[&str]) {
    for word in words {
        assert!(fault.contains(word), "{fault:?} does not say {word:?}");
    }
}

#[test]
fn a_row_has_its_counts_by_pixel_and_its_words_as_sent() {
    let mut head = head();
    GOOD.run(&mut head);
    assert_eq!(head.violations(), []);
    let row = head.last_row().unwrap();
    assert_eq!((row.number, row.lead_in), (0, 0));
    assert_eq!(
        row.exposure,
        Exposure {
            start: 0,
            end: 1_002_000,
            laser: 0,
        }
    );
    assert_eq!(row.read_out, 1_003_500);
    assert_eq!(row.counts[0..4], [0, 0, 1, 1]);
    assert_eq!(
        row.words[0..4],
        [4095, 4095, 4094, 4094],
        "the output falls with light"
    );
    assert!(
        (0.53..0.56).contains(&row.phase.0) && (0.53..0.56).contains(&row.phase.1),
        "{row:?}"
    );
}

#[test]
fn an_exposure_lasts_from_pulse_to_pulse() {
    let mut head = head();
    GOOD.run(&mut head);
    // A pulse while ICG is high clears the photodiodes: a new exposure begins.
    head.sh(Level::High, 8_000_000);
    head.sh(Level::Low, 8_002_000);
    Sequence {
        begin: 9_000_000,
        ..GOOD
    }
    .run(&mut head);
    assert_eq!(head.violations(), []);
    assert_eq!(
        head.last_row().unwrap().exposure,
        Exposure {
            start: 8_002_000,
            end: 9_002_000,
            laser: 0,
        }
    );
    assert_eq!(head.last_row().unwrap().exposure.duration(), 1_000_000);
}

#[test]
fn the_lead_in_says_which_word_shows_pixel_0() {
    // A burst that begins two pixels before ICG rises.
    let mut early = head();
    let read_out = GOOD.begin + 3500;
    let sequence = Sequence {
        burst_after: 500.0 - 2.0 * 16e9 / 10.5e6,
        ..GOOD
    };
    let begin = read_out as f64 + sequence.burst_after;
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
    assert_eq!(early.violations(), []);
    let row = early.last_row().unwrap();
    assert_eq!(row.lead_in, 2);
    assert_eq!(row.words[2..6], [4095, 4095, 4094, 4094]);
    assert_eq!(
        row.counts[PIXELS - 2..],
        [10, 10],
        "pixels that no word shows are as the shielded ones"
    );

    let mut late = head();
    Sequence {
        burst_after: 500.0 + 16e9 / 10.5e6,
        ..GOOD
    }
    .run(&mut late);
    assert_eq!(late.violations(), []);
    let row = late.last_row().unwrap();
    assert_eq!(row.lead_in, -1);
    assert_eq!(row.counts[1..4], [0, 1, 1]);
    assert_eq!(
        row.words[PIXELS - 1],
        4095 - 10,
        "after the last pixel the output is unlit"
    );
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
            Sequence {
                begin: 1_000_000 + number * 7_000_000,
                ..GOOD
            }
            .run(head);
        }
    };
    run(&mut head, 0, 70);
    assert_eq!((head.row_count(), head.rows().len()), (70, ROWS_KEPT));
    assert_eq!(head.rows().next().unwrap().number, 6);
    head.keep_all_rows(true);
    run(&mut head, 70, 80);
    assert_eq!(head.rows().len(), ROWS_KEPT + 10);
}

#[test]
fn sh_that_rises_too_early_or_too_late_after_icg_is_a_violation() {
    let fault = Sequence {
        sh_after_icg: 99,
        ..GOOD
    }
    .fault();
    says(
        &fault,
        &[
            "SH rose 99 ns",
            "100 to 1000 ns",
            "TCD1304 t2",
            "at 1.000099 ms",
        ],
    );
    let fault = Sequence {
        sh_after_icg: 1001,
        ..GOOD
    }
    .fault();
    says(&fault, &["SH rose 1001 ns", "100 to 1000 ns"]);
}

#[test]
fn sh_that_is_high_when_icg_falls_is_a_violation() {
    let mut head = head();
    head.sh(Level::High, 1000);
    head.icg(Level::Low, 1500);
    head.sh(Level::Low, 3000);
    says(&only_fault(&head), &["ICG fell while SH was high"]);
}

#[test]
fn a_too_short_sh_pulse_is_a_violation() {
    let fault = Sequence {
        sh_high: 999,
        ..GOOD
    }
    .fault();
    says(
        &fault,
        &["SH was high for 999 ns", "at least 1000", "TCD1304 t3"],
    );
}

#[test]
fn icg_that_rises_too_early_after_sh_is_a_violation() {
    let fault = Sequence {
        icg_after_sh: 999,
        ..GOOD
    }
    .fault();
    says(
        &fault,
        &[
            "ICG rose 999 ns after SH fell",
            "at least 1000 ns",
            "TCD1304 t1",
        ],
    );
}

#[test]
fn icg_that_rises_while_sh_is_high_is_a_violation() {
    let mut head = head();
    head.icg(Level::Low, 1000);
    head.sh(Level::High, 1500);
    head.icg(Level::High, 3000);
    says(&only_fault(&head), &["ICG rose while SH was high"]);
}

#[test]
fn a_too_short_exposure_is_a_violation() {
    let mut head = head();
    head.sh(Level::High, 990_000);
    head.sh(Level::Low, 992_001);
    GOOD.run(&mut head);
    says(
        &only_fault(&head),
        &["the exposure was 9999 ns", "at least 10000", "tINT"],
    );
}

#[test]
fn a_master_clock_out_of_range_is_a_violation() {
    // The converter's clock changes too, so that only one limit is violated.
    let clocks = Clocks {
        master_hz: 4.05e6,
        serial_hz: 16.2e6,
    };
    let mut head = head();
    Sequence { clocks, ..GOOD }.pulses(&mut head);
    assert_eq!(head.violation_count(), 2);
    says(
        &head.violations()[0].what,
        &["fM is 4.05 MHz", "0.8 to 4 MHz"],
    );
    says(
        &head.violations()[1].what,
        &["SCLK is 16.2 MHz", "8 to 16 MHz", "ADC122S101"],
    );
}

#[test]
fn a_stopped_master_clock_is_a_violation() {
    let clocks = Clocks {
        master_hz: 0.0,
        ..CLOCKS
    };
    let mut head = head();
    Sequence { clocks, ..GOOD }.run(&mut head);
    says(&head.violations()[0].what, &["fM does not run"]);
    says(&head.violations()[1].what, &["without the master clock"]);
    assert_eq!(head.row_count(), 0);
}

#[test]
fn pixels_and_conversions_of_different_length_are_a_violation() {
    let clocks = Clocks {
        master_hz: 2.625e6 * 1.0002,
        ..CLOCKS
    };
    let fault = Sequence {
        clocks,
        burst_after: 900.0,
        ..GOOD
    };
    let mut head = head();
    fault.pulses(&mut head);
    says(
        &only_fault(&head),
        &[
            "a pixel lasts 1523.505 ns",
            "a conversion 1523.810 ns",
            "0.0001",
        ],
    );
}

#[test]
fn wrong_clocks_are_reported_once_a_row() {
    let clocks = Clocks {
        master_hz: 2.7e6,
        ..CLOCKS
    };
    let mut head = head();
    Sequence { clocks, ..GOOD }.pulses(&mut head);
    head.clocks(clocks, 2_000_000);
    assert_eq!(head.violation_count(), 1);
}

#[test]
fn a_word_of_eight_bits_is_a_violation() {
    let mut head = head();
    Sequence { bits: 8, ..GOOD }.run(&mut head);
    says(
        &head.violations()[0].what,
        &["a word had 8 bits", "16 SCLK"],
    );
}

#[test]
fn a_burst_with_too_few_or_too_many_words_is_a_violation() {
    let fault = Sequence {
        words: 3693,
        ..GOOD
    }
    .fault();
    says(&fault, &["low for 3693 words", "exactly 3694"]);
    let fault = Sequence {
        words: 3695,
        ..GOOD
    }
    .fault();
    says(&fault, &["low for 3695 words"]);
}

#[test]
fn a_word_clocked_with_chip_select_high_is_a_violation() {
    let mut head = head();
    assert_eq!(head.word(16, 1000), 0);
    says(&only_fault(&head), &["with chip select high"]);
}

#[test]
fn a_burst_without_a_read_out_is_a_violation() {
    let mut head = head();
    head.clocks(CLOCKS, 0);
    GOOD.burst(&mut head, 1_000_000);
    says(&only_fault(&head), &["3694 words", "none showed a pixel"]);
    assert_eq!(head.row_count(), 0);
}

#[test]
fn icg_alone_starts_no_read_out() {
    let mut head = head();
    head.icg(Level::Low, 1_000_000);
    head.icg(Level::High, 1_003_000);
    head.clocks(CLOCKS, 1_003_000);
    GOOD.burst(&mut head, 1_003_000);
    says(&only_fault(&head), &["none showed a pixel"]);
}

#[test]
fn a_row_that_icg_cuts_short_is_a_violation() {
    let mut head = head();
    GOOD.pulses(&mut head);
    head.chip_select(Level::Low, 1_004_000);
    head.word(16, 1_006_000);
    head.icg(Level::Low, 1_007_000);
    says(
        &only_fault(&head),
        &["ICG fell after word 1 of 3694", "cut short"],
    );
}

#[test]
fn a_pixel_held_too_early_or_too_late_is_a_violation() {
    // 19 % and 96 % of a pixel's 1523.8 ns, less the 333.3 ns until the converter holds.
    let early = Sequence {
        burst_after: 0.19 * 1523.81 - 333.33,
        ..GOOD
    }
    .fault();
    says(&early, &["at 18.9 % to 19.0 %", "within 20 % to 95 %"]);
    let late = Sequence {
        burst_after: 0.96 * 1523.81 - 333.33,
        ..GOOD
    }
    .fault();
    says(&late, &["96.0 %"]);
}

#[test]
fn a_dma_buffer_in_core_coupled_ram_is_a_violation() {
    let mut head = head();
    head.dma_address(0x2000_0000, 5);
    head.dma_address(0x1000_8000, 6);
    says(
        &only_fault(&head),
        &["0x10008000", "core-coupled RAM", "RM0090"],
    );
}

#[test]
fn a_light_source_with_the_wrong_number_of_pixels_is_a_violation() {
    let mut head = SensorHead::new(Box::new(|_| vec![100.0; 128]));
    GOOD.run(&mut head);
    says(&only_fault(&head), &["gave 128 pixels", "3694"]);
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
    Sequence {
        begin: 3_000_000,
        ..GOOD
    }
    .run(&mut head);
    assert_eq!(head.violations(), []);
    assert_eq!(
        head.last_row().unwrap().exposure,
        Exposure {
            start: 1_002_000,
            end: 3_002_000,
            laser: 0,
        }
    );
}

#[test]
fn violations_are_counted_even_if_they_are_not_kept() {
    let mut head = head();
    for now in 0..300 {
        head.word(16, now);
    }
    assert_eq!(
        (head.violations().len(), head.violation_count()),
        (200, 300)
    );
}
