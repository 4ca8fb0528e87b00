//! The core's answers to seeded rows and frames, to their last bit. Other tests judge whether the answers are
//! good. These tables show every change of an answer as a diff, so that no change goes unnoticed.

use crate::support::*;
use judges::hard_cases::{self, Recipe, Shape};
use std::fmt::Write as _;

fn answer(row: &HardRow, before: Option<&RowCentre>) -> Answer {
    checked_after(before, &row.geometry, &row.light, Estimator::default())
}

/// An answer to a row: centre, uncertainty by noise and by the shape, height, width and table. Pixels as
/// multiples of 2^-16, counts as multiples of 2^-8.
fn answer_text(answer: &Answer) -> String {
    match answer {
        Ok(row) => format!(
            "x {} u {} s {} a {} w {} table {}/{}/{}{}",
            row.centre.to_bits(),
            row.uncertainty.to_bits(),
            row.shape.uncertainty(None).to_bits(),
            row.amplitude.to_bits(),
            row.width.to_bits(),
            row.class.set,
            row.class.table,
            row.class.block,
            if row.misfit { " misfit" } else { "" }
        ),
        Err(fault) => format!("f {fault}"),
    }
}

/// The first row of each hard case, and the second row with the first row's centre as the row before.
#[test]
fn answers_to_hard_rows_stay_the_same() {
    let mut text = String::new();
    for case in hard_cases::rows() {
        let (first, second) = (case.row(0), case.row(1));
        let before = answer(&first, None);
        let following = answer(&second, before.as_ref().ok());
        writeln!(text, "{}: {}", case.name, answer_text(&before)).expect("text");
        writeln!(text, "    {}", answer_text(&following)).expect("text");
    }
    insta::assert_snapshot!("rows", text);
}

/// What the rows of a frame are like, besides their noise.
#[derive(Clone, Copy, Debug)]
enum Rows {
    Alike,
    /// Each row has its own uncertainty, within a factor of 20.
    Unlike,
    /// One row claims to be 1000 times as certain as the others.
    OneCertain,
    /// One row of four lies 0.5 px away.
    Outliers,
    Misfits,
    Faults,
    /// The errors are three times as large as the rows claim.
    TooCertain,
    /// The target moves by 0.05 px a row.
    Moving,
    /// The target moves, and one row of four lies 0.5 px away.
    MovingOutliers,
    /// Each error is 0.9 of the one before and 0.44 of a new one.
    Correlated,
    /// Correlated errors, five times as large as the rows claim.
    CorrelatedExcess,
    /// The rows are at one of two places, 0.3 px apart.
    TwoPlaces,
}

use Rows::*;

const ROWS: [[Rows; 4]; 3] = [
    [Alike, Unlike, OneCertain, Outliers],
    [Misfits, Faults, TooCertain, Moving],
    [MovingOutliers, Correlated, CorrelatedExcess, TwoPlaces],
];

impl Rows {
    fn frame(self, count: usize) -> Frame {
        const UNCERTAINTY: f64 = 0.03;
        let mut random = random(count as u64);
        let mut frame = Frame::default();
        let mut error: f64 = StandardNormal.sample(&mut random);
        for number in 0..count {
            let new: f64 = StandardNormal.sample(&mut random);
            let is_fourth = number % 4 == 1;
            error = match self {
                Correlated | CorrelatedExcess => 0.9 * error + 0.44 * new,
                _ => new,
            };
            let uncertainty = match self {
                Unlike => UNCERTAINTY * 20f64.powf(random.random()),
                OneCertain if number == 2 => 1e-3 * UNCERTAINTY,
                _ => UNCERTAINTY,
            };
            let growth = match self {
                TooCertain => 3.0,
                CorrelatedExcess => 5.0,
                _ => 1.0,
            };
            let place = match self {
                Outliers if is_fourth => 0.5,
                Moving => 0.05 * number as f64,
                MovingOutliers => 0.05 * number as f64 + if is_fourth { 0.5 } else { 0.0 },
                TwoPlaces => 0.3 * f64::from(u8::from(random.random::<bool>())),
                _ => 0.0,
            };
            if matches!(self, Faults) && is_fourth {
                frame.add(Err(Fault::SensorSilent));
                continue;
            }
            let centre = (1800.3 + place + growth * uncertainty * error) as f32;
            frame.add(Ok(with(row_centre(0.0, 0.0), |it| {
                [it.centre, it.uncertainty] = [centre, uncertainty as f32].map(Pixels::from_f32);
                it.amplitude = Counts::from_int(1000 + number as i32);
                it.misfit = matches!(self, Misfits) && is_fourth;
            })));
        }
        frame
    }
}

/// Frames of a few rows, of as many as turn one rule of the mean into another, and of the most.
#[test]
fn centres_of_frames_stay_the_same() {
    const COUNTS: [usize; 10] = [1, 2, 3, 5, 7, 8, 16, 17, 40, 64];
    let mut text = String::new();
    for (rows, count) in pairs(ROWS.as_flattened(), COUNTS) {
        let frame = rows.frame(count);
        for how in Mean::ALL {
            let answer = match frame.centre(how) {
                Ok(centre) => format!(
                    "x {} u {} a {} n {}/{} m {} c {:?}",
                    centre.centre.to_bits(),
                    centre.uncertainty.to_bits(),
                    centre.amplitude.to_bits(),
                    centre.rows_used,
                    centre.rows,
                    centre.misfits,
                    centre.correlated
                ),
                Err(fault) => format!("f {fault}"),
            };
            writeln!(text, "{rows:?} {count} {}: {answer}", how.name()).expect("text");
        }
    }
    insta::assert_snapshot!("frames", text);
}

/// A flaw that grows from nothing until nobody can miss it, for spots of several widths and shapes. Each
/// character is a row: the estimator's centre (.), the same with more uncertainty by its shape than by noise
/// (u), a repaired centre (r), a flag (m), a fault (f). So a line shows from which strength on the check
/// finds the flaw, and from which strength on the repair succeeds.
#[test]
fn the_strengths_at_which_flaws_are_found_stay_the_same() {
    const STRENGTHS: u32 = 48;
    let bad = |counts, pixels, at| Bad {
        counts,
        pixels,
        from_spot: (at, at + 0.1),
    };
    let hot = |s, pixels, at| Flaw::Hot(bad(3000.0 * s, pixels, at));
    let dead = |s| Flaw::Stuck(bad(4000.0 * (1.0 - s), 1, 0.5));
    let spot = |share, offset, widths| Second {
        share,
        offset,
        widths,
    };
    let second = |s, offset, widths| Flaw::Second(spot(1.2 * s, offset, widths));
    let ghost = |share| Flaw::Ghost(spot(share, 3.0, 6.0));
    #[rustfmt::skip] // A flaw a line.
    let flaws: [(&str, &dyn Fn(f64) -> Flaw); 14] = [
        ("one hot pixel at 1 sigma, to 3000 counts", &|s| hot(s, 1, 1.0)),
        ("two hot pixels at 4 sigma, to 3000 counts", &|s| hot(s, 2, 4.0)),
        ("a dead pixel at 0.5 sigma, from 4000 counts", &dead),
        ("a second spot at 2 sigma, to 1.2", &|s| second(s, 2.0, 1.0)),
        ("a second spot at 3 sigma, to 1.2", &|s| second(s, 3.0, 1.0)),
        ("a second spot at 5.5 sigma, to 1.2", &|s| second(s, 5.5, 1.0)),
        ("a narrow second spot at 12 sigma, to 1.2", &|s| second(s, 12.0, 0.7)),
        ("a wide second spot at -15 sigma, to 1.2", &|s| second(s, -15.0, 1.5)),
        ("a wide ghost at 3 sigma, to 0.2", &|s| ghost(0.2 * s)),
        ("a slope, to 20 counts a pixel", &|s| Flaw::Slope(20.0 * s)),
        ("a step at 1 sigma, to 800 counts", &|s| Flaw::Step(800.0 * s, 1.0)),
        ("a ripple of 30 px, to 400 counts", &|s| Flaw::Ripple(400.0 * s, 30.0)),
        ("responses that differ, to 0.2", &|s| Flaw::Response(0.2 * s)),
        ("steps of the converter, to 512 counts", &|s| Flaw::Steps(1.0 + 511.0 * s)),
    ];
    let shapes: [(&str, Shape); 2] = [("gaussian", Shape::Gaussian), ("Fresnel", Shape::Fresnel)];
    let mut text = String::new();
    for (name, flaw) in flaws {
        writeln!(text, "{name}").expect("text");
        for ((shape_name, shape), width) in pairs(shapes, [1.0, 1.5, 4.0, 10.5, 20.0]) {
            let clean = Recipe::clean(width).spot(|spot| spot.shape = shape);
            let found = (1..=STRENGTHS).map(|step| {
                // From 1/1000 to 1.
                let strength = 1e-3f64.powf(1.0 - f64::from(step) / f64::from(STRENGTHS));
                let row = clean.clone().with(flaw(strength)).row(7, 0);
                let by = Estimator::default();
                let [alone, checked] = accuracy::answers(&row.geometry, &row.light, by);
                match checked {
                    Err(_) => 'f',
                    Ok(found) if found.misfit => 'm',
                    Ok(found) if found.shape.uncertainty(None) > found.uncertainty => 'u',
                    Ok(found) if alone.is_ok_and(|it| it.centre == found.centre) => '.',
                    Ok(_) => 'r',
                }
            });
            let found: String = found.collect();
            writeln!(text, "  {found} {shape_name}, sigma {width}").expect("text");
        }
    }
    insta::assert_snapshot!("strengths", text);
}
