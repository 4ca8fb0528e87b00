//! The second judge: rows and frames with one fault each, which stays in all rows of a frame.

use crate::support::*;
use judges::second_judge::tally::{JUDGED, judge_frames};
use judges::second_judge::{self, Kind, judge};

#[test]
fn a_few_rows_of_each_kind_are_judged() {
    let report = judge(Kind::all(), 10, 3);
    println!("{}", report.markdown());
    assert!(report.kinds.iter().all(|kind| kind.rows[0].count == 10));
}

#[test]
fn the_same_number_gives_the_same_row() {
    for kind in Kind::all() {
        let [first, again, other] = [1, 1, 2].map(|number| second_judge::row(kind, number).rows);
        assert_eq!(first, again, "{}", kind.name);
        assert_ne!(first, other, "{}", kind.name);
    }
}

/// If the generator's noise or its spots were wrong, clean rows would have other errors than they claim.
fn clean_rows_are_honest(rows: u64, frames: u64) {
    let report = judge(kinds("clean"), rows, frames);
    // Five standard deviations of an RMS of so many normal errors, and 3 % for spots that are no gaussians.
    let [of_rows, of_frames] = [rows, frames].map(|count| 5.0 / (2.0 * count as f64).sqrt() + 0.03);
    let [rows, frames] = [&report.kinds[0].rows[0], &report.kinds[0].frames[0]];
    println!("{}, {} flagged", report.kinds[0].claims(), rows.flagged);
    assert!((rows.error_over_claim() - 1.0).abs() < of_rows);
    assert!((frames.error_over_claim() - 1.0).abs() < of_frames);
    // One row of 20,000 by chance.
    assert!(rows.errors <= 1 && frames.errors == 0);
    assert!(rows.share(rows.flagged) <= 0.01);
}

#[test]
fn clean_rows_have_the_errors_that_they_claim_and_no_flag() {
    clean_rows_are_honest(5000, 100);
}

#[test]
#[ignore = "28,000 rows take 6 CPU s; run by .ci/run"]
fn many_clean_rows_have_the_errors_that_they_claim_and_no_flag() {
    clean_rows_are_honest(20_000, 500);
}

/// A spot without a flaw has no shape but noise. The limits of noise are exceeded by 2 % of such spots; their
/// u grows, that of the others does not. In a few rows u grows by a large factor, 57 in one of 60,000. So a
/// mean needs many rows: it is 6.2 % of 60,000 rows of a calibrated sensor, and the mean of 10,000 has a
/// standard deviation of 0.5 %.
#[test]
#[ignore = "36,000 rows take 6 CPU s; run by .ci/run"]
fn the_shape_hardly_adds_to_the_uncertainty_of_clean_rows() {
    let clean = Kind::named("clean").expect("a kind");
    type Take = fn(&Kind, u64) -> second_judge::Frame;
    let (row, frame): (Take, Take) = (second_judge::row, second_judge::frame);
    for (name, take, count, most) in [("rows", row, 10_000, 1.075), ("frames", frame, 500, 1.05)] {
        for judged in [JUDGED[0], JUDGED[2]] {
            let growths = (0..count).into_par_iter().filter_map(|number| {
                let frame = take(clean, number);
                let own = || frame.profile(judged.estimator);
                let profile = judged.is_calibrated.then(own);
                let measured = frame.measure(judged.estimator, profile.flatten()).ok()?;
                let shape = measured.by_shape.to_f64();
                Some(1f64.hypot(shape / measured.frame.uncertainty.to_f64()))
            });
            let growths: Vec<f64> = growths.collect();
            let mean = statistics::mean(&growths);
            let grown = growths.iter().filter(|growth| **growth > 1.0).count();
            let of = growths.len();
            let kind = judged.is_calibrated;
            print!("{name}, calibrated {kind}: u is {mean:.3} times as large on average, ");
            println!("and larger in {grown} of {of}");
            assert!(growths.len() as u64 >= count - count / 100);
            assert!(mean <= most, "{mean}");
        }
    }
}

#[test]
fn a_story_tells_the_fault_and_the_result() {
    let kind = Kind::named("hot block").expect("a kind");
    let story = second_judge::frame(kind, 1).story(kind);
    println!("{story}");
    for words in ["hot block: 1 to 4 pixels", "truth: Centre(", "adaptive: "] {
        assert!(story.contains(words), "{words}");
    }
}

fn kinds(name: &str) -> &'static [Kind] {
    std::slice::from_ref(Kind::named(name).expect("a kind"))
}

/// What the check has to reach. Of the frames of each kind, and of all frames.
const OF_A_KIND: f64 = 0.01;
const OF_ALL: f64 = 0.003;

#[test]
#[ignore = "takes minutes"]
fn confident_errors_are_rare() {
    let (mut wrong, mut errors, mut frames) = (vec![], 0, 0);
    for kind in Kind::all() {
        let tally = judge_frames(kind, 1000);
        let (name, ratio, of) = (kind.name, tally.error_over_claim(), tally.count);
        print!(
            "{name}: {:?} of {of} are errors, over claims {ratio:.2}; ",
            tally.numbers
        );
        let [flagged, good] = [tally.flagged, tally.flagged_good].map(|it| 100.0 * tally.share(it));
        println!("{flagged:.1} % flagged, {good:.1} % though good");
        if tally.share(tally.errors) > OF_A_KIND {
            wrong.push(name);
        }
        errors += tally.errors;
        frames += tally.count;
    }
    assert!(wrong.is_empty(), "more than 1 % of frames: {wrong:#?}");
    let all = errors as f64 / frames as f64;
    assert!(all <= OF_ALL, "{all}");
}

#[test]
#[ignore = "takes minutes"]
fn a_faint_wide_light_hides_no_spot_and_is_none() {
    let report = judge(kinds("faint wide light"), 10_000, 0);
    let rows = &report.kinds[0].rows[0];
    println!("{} of {} lost", rows.faults, rows.count);
    let alone = judge(kinds("faint wide light alone"), 50_000, 0);
    let [default, phase_table, _] = &alone.kinds[0].rows;
    for (name, rows) in [("default", default), ("phase-table", phase_table)] {
        let centres = rows.count - rows.faults;
        println!("{name}: {centres} false spots, {} flagged", rows.flagged);
    }
    assert!(rows.share(rows.faults) <= 0.01);
    assert_eq!(default.errors, 0);
    assert_eq!(phase_table.count, phase_table.faults);
}
