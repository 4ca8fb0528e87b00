//! The chip and a PC do the same.

use std::sync::LazyLock;

use cost_on_chip::calibrations::{self, CENTRES, Form};
use cost_on_chip::inputs::{self, Input, Searched};
use cost_on_chip::methods;
use cost_on_chip::rows::{self, PIXELS, ROWS, Turn, WIDTHS};

use super::whole_rows::{FIRST, FOLLOWING, LAST, READING, WholeRow};
use super::*;

static LINES: LazyLock<Vec<Line>> =
    LazyLock::new(|| run::lines_of(PACKAGE).expect("the chip's program runs"));
/// The figures of a run with a trace, which takes over a minute.
static CHIP: LazyLock<Chip> = LazyLock::new(|| measure().expect("and says all"));

#[derive(Clone, Debug, PartialEq)]
struct Found {
    name: String,
    width: f32,
    row: usize,
    /// The bits of centre and uncertainty, or the fault's name.
    found: Result<(i32, i32), String>,
}

fn on_the_chip() -> Vec<Found> {
    lines::all(&LINES, "row")
        .map(|line| Found {
            name: line.name.clone(),
            // The log prints widths as f32 does: 11.3.
            width: line.number("width").unwrap() as f32,
            row: line.whole("number").unwrap() as usize,
            found: match &line.fault {
                Some(fault) => Err(fault.clone()),
                // Whole numbers of 32 bits, which a double holds.
                None => Ok((
                    line.number("centre").unwrap() as i32,
                    line.number("uncertainty").unwrap() as i32,
                )),
            },
        })
        .collect()
}

fn on_this_pc(method: Method, width: f32, row: usize) -> Result<(i32, i32), String> {
    let geometry = rows::geometry();
    let (mut before, mut now) = ([0; PIXELS], [0; PIXELS]);
    rows::light(width, row, Turn::Before, &mut before);
    rows::light(width, row, Turn::Now, &mut now);
    let (before, now) = (
        inputs::searched(&before).expect("a spot"),
        inputs::searched(&now).expect("a spot"),
    );
    let Input {
        searched: Searched { row, spot },
        before,
        geometry,
    } = inputs::input(method, &before, now, &geometry);
    match methods::centre(method, &row, &spot, before.as_ref(), geometry) {
        Ok(found) => Ok((found.centre.to_bits(), found.uncertainty.to_bits())),
        Err(fault) => Err(fault.name().to_owned()),
    }
}

/// The chip's inner products are assembly. Its floating point is the core's own or the compiler's library.
#[test]
#[ignore = "runs its program for 25 s; `answers::` compares chip and PC too; .ci/run runs it"]
fn the_chip_and_a_pc_find_the_same_bits() {
    let mut found = on_the_chip().into_iter();
    let (mut centres, mut faults) = (0, 0);
    for width in WIDTHS {
        for row in 0..ROWS {
            for method in Method::ALL {
                let expected = Found {
                    name: method.name().to_owned(),
                    width,
                    row,
                    found: on_this_pc(method, width, row),
                };
                match expected.found {
                    Ok(_) => centres += 1,
                    Err(_) => faults += 1,
                }
                assert_eq!(found.next(), Some(expected));
            }
        }
    }
    assert_eq!(found.next(), None);
    println!("{centres} centres and {faults} faults are the same");
    assert!(centres > 9 * faults, "{faults} faults");
}

/// The peers fit the same spot as the estimators. The same noise moves both, so their centres differ by less
/// than three standard uncertainties.
#[test]
#[ignore = "runs its program for 25 s; `answers::` compares chip and PC too; .ci/run runs it"]
fn the_peers_fit_the_same_spot() {
    let default = Method::default().name();
    let mut compared = 0;
    let on_chip = on_the_chip();
    for peer in lines::all(&LINES, "peer-row") {
        let row = peer.whole("number").unwrap() as usize;
        let found = on_chip
            .iter()
            .find(|found| found.name == default && found.width == 10.5 && found.row == row)
            .expect("a row of the default estimator");
        let (centre, uncertainty) = *found.found.as_ref().expect("a centre");
        let centre = f64::from(centre) / 65536.0;
        let apart = (peer.number("centre").unwrap() - centre) / (f64::from(uncertainty) / 65536.0);
        assert!(
            apart.abs() < 3.0,
            "{} row {row}: {apart} standard deviations apart",
            peer.name
        );
        compared += 1;
    }
    assert_eq!(compared, 2 * ROWS);
}

#[test]
#[ignore = "a trace takes 80 s; .ci/run runs it"]
fn every_method_is_there_at_every_width() {
    for method in Method::ALL {
        for width in WIDTHS {
            let counted = CHIP
                .methods
                .iter()
                .find(|counted| counted.name == method.name() && counted.width as f32 == width)
                .unwrap_or_else(|| panic!("no {} at {width}", method.name()));
            assert!(
                counted.instructions > 0 && counted.code_bytes > 50,
                "{counted:?}"
            );
        }
    }
}

/// Distances are integers. Slopes are single operations of f32, which the chip has in hardware.
#[test]
#[ignore = "runs its program for 25 s; `answers::` compares chip and PC too; .ci/run runs it"]
fn the_chip_and_a_pc_make_the_same_distances() {
    let mut on_the_chip = lines::all(&LINES, "distance");
    for form in Form::ALL {
        let calibration = form.calibration().expect("usable");
        for number in 0..CENTRES {
            let line = on_the_chip.next().expect("a line for each centre");
            assert_eq!(line.name, form.name());
            let word = |key| line.number(key).expect("a whole number of 32 bits");
            let found = (word("distance") as i32, word("slope") as u32);
            let centre = calibrations::asked(number);
            let (distance, slope) = calibration.distance_at(centre).expect("in range");
            assert_eq!(found, (distance.to_bits(), slope.to_bits()), "{line:?}");
        }
    }
    assert_eq!(on_the_chip.next(), None);
}

/// At any centre, eq. (1) takes at most 60 instructions, and a PCHIP at most 120.
#[test]
#[ignore = "a trace takes 80 s; .ci/run runs it"]
fn a_distance_takes_few_instructions() {
    for (form, most) in Form::ALL.into_iter().zip([60.0, 120.0, 200.0]) {
        let counted = of_name(&CHIP.forms, form.name()).expect("counted");
        println!("{counted:?}");
        assert!(
            counted.most <= most && counted.instructions > 40.0,
            "{counted:?}"
        );
    }
}

/// Each estimator's rows at each width. No instruction is without a step, and only the step *estimate* tells
/// the estimators apart where the spot is plain.
#[test]
#[ignore = "a trace takes 80 s; .ci/run runs it"]
fn the_steps_of_whole_rows_add_up() {
    let rows = &CHIP.whole_rows;
    assert_eq!(
        rows.0.len(),
        Estimator::ALL.len() * (2 * WIDTHS.len() + 3) + 3
    );
    for WholeRow { kind, steps, .. } in &rows.0 {
        let [convert, search, estimate, check, _, distance, other] = steps.0;
        assert_eq!(other, 0, "{steps:?}");
        if *kind == READING {
            assert!(distance > 40, "{steps:?}");
            continue;
        }
        assert_eq!(distance, 0, "{steps:?}");
        // A word is loaded and stored once at least; two share an instruction at best.
        assert!(convert > rows::WORDS as u64 / 2, "{steps:?}");
        assert!(search > 0 && estimate > 0 && check > 0, "{steps:?}");
    }
    for name in Estimator::ALL.map(Estimator::name) {
        for width in WIDTHS {
            let [first, following] = [FIRST, FOLLOWING].map(|kind| {
                let row = rows.at_width(kind, name, width.into());
                row.expect("measured").total()
            });
            println!("{name}, sigma {width}: first row {first}, following {following}");
            // A following row's search for a spot below 4 pixels looks at all pixels too. The two rows have
            // other noise: two peaks more take 1200.
            let searches_in_full = f64::from(width) < 4.0;
            assert!(
                first > following || searches_in_full && following - first <= 1200,
                "{name}"
            );
        }
        let [last, following] = [LAST, FOLLOWING].map(|kind| rows.nominal(kind, name));
        assert!(last.expect("measured").frame() > following.expect("measured").frame());
    }
    // Who follows a row finds its way in so many files of the core. Seven of them hold constants, or are only
    // asked whether there is something to do.
    println!("files of the core: {:?}", CHIP.core_files);
    assert!(CHIP.core_files.len() <= 25, "{}", CHIP.core_files.len());
}

#[test]
#[ignore = "a trace takes 80 s; .ci/run runs it"]
fn the_slowest_rows_are_slow() {
    for estimator in Estimator::ALL {
        let kinds = CHIP.whole_rows.kinds(estimator);
        let [_, first, slowest] = kinds.map(|row| row.expect("measured").total());
        println!("{}: {slowest}, and {first}", estimator.name());
        assert!(slowest >= first);
    }
}
