//! Tests that pages of docs/ are what programs write. Tests start in the order of their names. So the
//! firmware's build, for the pulses, begins among the first and has the others beside it.

use judges::hard_cases::report::{self, Catalogue};
use virtual_board::Nanos;
use virtual_board::sensor_head::limits;

use crate::docs;
use crate::timing::{FIGURE, MASTER_CLOCK, PAGE, Pulses, TOOL, WHOLE_ROW};

#[test]
fn hard_cases_agree_with_the_catalogue() {
    let page = "docs/hard-cases.md";
    let text = std::fs::read_to_string(docs::path(page)).expect(page);
    let tables = Catalogue::run().markdown();
    let due = docs::with_block(&text, report::CATALOGUE, &tables).expect("marks");
    let differing = text.lines().zip(due.lines()).find(|(is, due)| is != due);
    assert!(
        text == due,
        "{page} is not what `cargo hard-cases --write` writes. (is, due): {differing:#?}"
    );
}

/// A quarter of a second of the firmware. The limits are those of the data sheets, and the texts on the
/// page are those of this row.
#[test]
fn the_pulses_are_those_of_the_firmware() {
    let pulses = Pulses::of_a_row().expect("a row");
    println!("{pulses:?}");
    let t1 = pulses.icg_rose - pulses.sh_fell;
    assert!(limits::SH_AFTER_ICG.contains(&(pulses.sh_rose as Nanos)));
    assert!(pulses.sh_fell - pulses.sh_rose >= limits::SH_HIGH as f64);
    assert!(t1 >= limits::ICG_AFTER_SH as f64);
    let t4 = pulses.icg_rose - pulses.master_clock_rose;
    assert!((0.0..0.5 * MASTER_CLOCK).contains(&t4));
    let page = std::fs::read_to_string(docs::path(PAGE)).expect(PAGE);
    let due = docs::with_block(&page, TOOL, &pulses.markdown()).expect("marks");
    assert!(
        page == due,
        "{PAGE} is not what `cargo timing --write` writes"
    );
    // A pixel of the upper picture is 14 ns. The program sees the time after a turn of a loop, up to 15
    // instructions or 90 ns, which are 6.3 pixels. Three more are for a program of another layout.
    //
    // A pixel of the lower picture is 7.4 us. A row comes at its time within 2 us (`rows_come_on_time` of
    // the firmware's tests), which are 0.3 pixels, and two numbers are rounded by 0.05 pixels each.
    let figure = std::fs::read_to_string(docs::path(FIGURE)).expect(FIGURE);
    let due = pulses.svg();
    let [is, due] = [&figure, &due].map(|svg| svg.split_once(WHOLE_ROW));
    let (is, due) = is.zip(due).expect("two pictures");
    for (is, due, most) in [(is.0, due.0, 10.0), (is.1, due.1, 0.4)] {
        let (is, due) = (numbers(is), numbers(due));
        assert!(is.len() == due.len(), "cargo timing --write");
        let moved = (is.iter().zip(&due))
            .map(|(is, due)| (is - due).abs())
            .fold(0.0, f64::max);
        println!("edges have moved by up to {moved:.1} pixels, of {most} allowed");
        assert!(
            moved <= most,
            "an edge has moved by {moved} pixels: cargo timing --write"
        );
    }
}

fn numbers(svg: &str) -> Vec<f64> {
    svg.split(|c: char| !c.is_ascii_digit() && c != '.')
        .filter_map(|number| number.parse().ok())
        .collect()
}
