//! The drawing of the nominal mask: `docs/hardware/comb.svg` for people. [`dxf`](super::dxf) writes the same
//! shapes for machines.
//!
//! Both show the mask as the sensor sees it. There the laser is to the left, the target is behind the sheet,
//! and pixels and places count to the right: a slit with a larger place is farther from the laser's beam
//! ([`Optics::behind`](simulator::optics::Optics::behind)).

use simulator::optics::Aperture;
use slitrange::frame::comb::{NOMINAL_PLACES_UM, SLIT_WIDTH_UM};

use crate::programs::comb::tolerances::{DISTANCE, MATERIALS, ROW_OFF, Tolerances, WARMER};
use crate::svg::{self, Svg};

/// Length and height of the mask in millimetres. The slits span 14.9 mm x 3 mm. At least 4.5 mm are left
/// on all sides of them, to clamp the mask and to keep light beside the slits from the row.
pub const OUTLINE_MM: [f64; 2] = [25.0, 12.0];

/// The middles of the marks, from the datum. They are not in the line of the row: their light falls 4.2 mm
/// beside the row.
pub const MARKS_MM: [[f64; 2]; 2] = [[-10.5, 4.0], [10.5, 4.0]];

/// Length and width of the left mark's arms: a cross.
const CROSS_MM: [f64; 2] = [1.0, 0.1];

/// Radius of the right mark: a disc. It is at the end away from the laser.
pub const DISC_MM: f64 = 0.25;

/// A closed outline in millimetres from the datum, x in the row's direction.
pub type Outline = Vec<[f64; 2]>;

fn rectangle([x, y]: [f64; 2], [width, height]: [f64; 2]) -> Outline {
    let (w, h) = (0.5 * width, 0.5 * height);
    vec![
        [x - w, y - h],
        [x + w, y - h],
        [x + w, y + h],
        [x - w, y + h],
    ]
}

pub fn edge() -> Outline {
    rectangle([0.0, 0.0], OUTLINE_MM)
}

/// Width and height of a slit in millimetres. The height is that of the simulated slits.
pub fn slit_mm() -> [f64; 2] {
    let height = match Aperture::PAPER_SLIT {
        Aperture::Slit { height, .. } => 1e3 * height,
        Aperture::Lens { .. } => unreachable!("the paper's slit is a slit"),
    };
    [1e-3 * f64::from(SLIT_WIDTH_UM), height]
}

pub fn slits() -> Vec<Outline> {
    let place = |um| [1e-3 * f64::from(um), 0.0];
    NOMINAL_PLACES_UM
        .map(|um| rectangle(place(um), slit_mm()))
        .to_vec()
}

pub fn cross() -> Outline {
    let [x, y] = MARKS_MM[0];
    let (a, b) = (0.5 * CROSS_MM[0], 0.5 * CROSS_MM[1]);
    let corners = [
        [-b, -a],
        [b, -a],
        [b, -b],
        [a, -b],
        [a, b],
        [b, b],
        [b, a],
        [-b, a],
        [-b, b],
        [-a, b],
        [-a, -b],
        [-b, -b],
    ];
    corners.map(|[dx, dy]| [x + dx, y + dy]).to_vec()
}

/// What the drawing says beside its dimensions, a line each.
pub fn notes(it: &Tolerances) -> Vec<String> {
    let um = |metres: f64| format!("{:.0} um", 1e6 * metres);
    let (loose, tight) = (it.calibrated, it.uncalibrated);
    let width = it.width * f64::from(SLIT_WIDTH_UM);
    let over = |angle: f64| um(angle * 1e-3 * OUTLINE_MM[0]);
    let growth = |index: usize| {
        let (name, growth) = MATERIALS[index];
        format!("{name} {:.1}e-6 / K", 1e6 * growth)
    };
    vec![
        "1. Lengths in mm. Seen from the sensor: laser to the left, target behind the sheet, pixels count \
             to the right."
            .into(),
        "2. Datum A: the optical axis, half-way between the outline's sides. Places are those of a slit's \
             middle."
            .into(),
        format!(
            "3. Places, each from the datum: \u{b1} {} if each slit is calibrated; \u{b1} {:.1} um if \
                 only eq. (1) is.",
            um(loose.place), 1e6 * tight.place
        ),
        format!("4. Width of a slit: \u{b1} {width:.0} um. Height: + 0.5 / - 0. Slits square to the line \
             of places: \u{b1} {:.2} deg.", loose.square.to_degrees()),
        format!("5. Flat within {}. Outline \u{b1} 0.1. Marks on the line y = {}, as places; they may go \
             through.", um(loose.flatness), MARKS_MM[0][1]),
        format!(
            "6. Mount: turned about the axis by at most {:.2} deg ({} over the length); one end nearer to \
                 the sensor by at most {:.2} deg ({}).",
            loose.rotation.to_degrees(), over(loose.rotation), loose.tilt.to_degrees(), over(loose.tilt)
        ),
        format!("    The row of pixels lies within {} mm of the line y = 0. Hold the mask at the \
             datum, so that it grows to both sides.", 1e3 * ROW_OFF),
        "7. Material: (a) chrome on glass, optical density 3 or more, chrome towards the sensor; (b) \
             stainless steel foil of 0.05,"
            .into(),
        "    laser-cut or etched, blackened on both sides, wider side of the cut towards the target."
            .into(),
        format!("    Expansion: {}, {}. {WARMER} K move a distance at {DISTANCE} m by {} \
             or {}.", growth(0), growth(1), um(it.warmer[0]), um(it.warmer[1])),
        "8. The disc is at the end away from the laser. Turned end for end, the mask gives wrong \
             distances or none.".into(),
    ]
}

/// Pixels of the picture for a millimetre.
const SCALE: f64 = 38.0;
const WIDTH: f64 = 1100.0;
const DATUM: [f64; 2] = [550.0, 395.0];

fn at([x, y]: [f64; 2]) -> [f64; 2] {
    [DATUM[0] + SCALE * x, DATUM[1] - SCALE * y]
}

fn beside([x, y]: [f64; 2], [dx, dy]: [f64; 2]) -> [f64; 2] {
    [x + dx, y + dy]
}

/// Styles of texts and of lines. Blue is what belongs to a dimension.
const MIDDLE: &str = r#"text-anchor="middle" font-size="14""#;
const BOLD: &str = r#"font-weight="bold""#;
const BLUE: &str = r##"fill="#1555d0" text-anchor="middle""##;
const HELP: &str = r##"stroke="#1555d0" stroke-width="0.8""##;
const HOLE: &str = r##"fill="#ffffff" stroke="#222222""##;

fn turned(svg: &mut Svg, place: [f64; 2], style: &str, text: &str) {
    let [x, y] = place;
    let style = format!(r#"{style} transform="rotate(-90 {x:.2} {y:.2})""#);
    svg.text(place, &style, text);
}

fn arrows(svg: &mut Svg, from: [f64; 2], to: [f64; 2]) {
    let style = r##"stroke="#1555d0" marker-start="url(#a)" marker-end="url(#a)""##;
    svg.line(from, to, style);
}

/// A horizontal dimension, with its text at a part of its length.
fn across(svg: &mut Svg, [from, to]: [f64; 2], y: f64, part: f64, label: f64) {
    arrows(svg, [from, y], [to, y]);
    let middle = [from + part * (to - from), y - 5.0];
    svg.text(middle, BLUE, format_args!("{label:.1}"));
}

fn upright(svg: &mut Svg, x: f64, [from, to]: [f64; 2], text: [f64; 2], label: &str) {
    arrows(svg, [x, from], [x, to]);
    turned(svg, text, BLUE, label);
}

fn outline(svg: &mut Svg, outline: Outline, style: &str) {
    let points = svg::points(outline.into_iter().map(at));
    svg.add(format_args!(r#"<polygon points="{points}" {style}/>"#));
}

pub fn svg(tolerances: &Tolerances) -> String {
    let notes = notes(tolerances);
    let count = NOMINAL_PLACES_UM.len();
    let [half, half_height] = OUTLINE_MM.map(|it| 0.5 * it);
    let (top, below) = (at([0.0, half_height])[1], at([0.0, -half_height])[1]);
    let table = below + 108.0;
    let first_note = table + 100.0;
    let height = first_note + 22.0 * notes.len() as f64 + 16.0;
    let title = format!("Mask of a comb of {count} slits");
    let mut svg = Svg::new([WIDTH, height], 15, &title);
    let s = &mut svg;
    s.add(
        r##"<defs><marker id="a" viewBox="0 0 10 6" refX="10" refY="3" markerWidth="10" markerHeight="6" orient="auto-start-reverse"><path d="M0 0 L10 3 L0 6 z" fill="#1555d0"/></marker></defs>"##,
    );
    let head = format!("Mask: comb of {count} slits");
    s.text([30.0, 32.0], r#"font-size="20" font-weight="bold""#, head);
    let origin = "seen from the sensor; written by cargo comb --drawing";
    s.text([WIDTH - 30.0, 32.0], r#"text-anchor="end""#, origin);

    let sheet = r##"fill="#eeeeee" stroke="#222222" stroke-width="1.5""##;
    outline(s, edge(), sheet);
    for hole in slits().into_iter().chain([cross()]) {
        outline(s, hole, HOLE);
    }
    let ([x, y], r) = (at(MARKS_MM[1]), SCALE * DISC_MM);
    s.add(format_args!(
        r#"<circle cx="{x}" cy="{y}" r="{r}" {HOLE}/>"#
    ));

    // The datum's axes.
    let axis = r##"stroke="#888888" stroke-dasharray="14 4 3 4""##;
    let (above, under) = ([0.0, half_height + 0.4], [0.0, -half_height - 1.2]);
    s.line(at(above), at(under), axis);
    s.line(at([-half - 0.4, 0.0]), at([half + 0.4, 0.0]), axis);
    let style = r#"text-anchor="middle" font-weight="bold""#;
    s.text(at([0.0, -half_height - 1.7]), style, "A: optical axis");
    let grey = r##"fill="#666666" font-size="14""##;
    s.text(at([-half + 0.25, 0.15]), grey, "laser");
    let style = format!(r#"text-anchor="end" {grey}"#);
    s.text(at([half - 0.2, 0.15]), &style, "away from laser");

    // Each slit's place from the datum, and its number.
    let [width, slit_height] = slit_mm();
    let [upper, lower] = [0.5, -0.5].map(|part| at([0.0, part * slit_height])[1]);
    for (number, &um) in (1..).zip(&NOMINAL_PLACES_UM) {
        let mm = 1e-3 * f64::from(um);
        let [x, _] = at([mm, 0.0]);
        s.line([x, upper - 6.0], [x, top - 20.0], HELP);
        let place = [x + 5.0, top - 26.0];
        turned(s, place, r##"fill="#1555d0""##, &format!("{mm:+.3}"));
        s.text([x, lower + 18.0], MIDDLE, number);
    }
    let [left, right] = [-half, half].map(|x| at([x, 0.0])[0]);
    s.text([left, top - 40.0], r##"fill="#1555d0""##, "places from A");

    // Outline, slit and marks.
    across(s, [left, DATUM[0]], below + 22.0, 0.5, half);
    across(s, [DATUM[0], right], below + 22.0, 0.5, half);
    across(s, [left, right], below + 46.0, 0.25, OUTLINE_MM[0]);
    let label = |mm: f64| format!("{mm:.1}");
    let text = [left - 24.0, DATUM[1] - 60.0];
    upright(s, left - 18.0, [top, below], text, &label(OUTLINE_MM[1]));
    let [cross, disc] = MARKS_MM.map(at);
    s.line(beside(disc, [16.0, 0.0]), [right + 24.0, disc[1]], HELP);
    let text = [right + 34.0, 0.5 * (disc[1] + DATUM[1])];
    let height = label(MARKS_MM[1][1]);
    upright(s, right + 18.0, [disc[1], DATUM[1]], text, &height);
    for (mark, [mm, _]) in [cross, disc].into_iter().zip(MARKS_MM) {
        s.text(beside(mark, [0.0, -24.0]), BLUE, format_args!("{mm:+.1}"));
    }
    let [length, arm] = CROSS_MM;
    let text = format!("cross {length} x {arm}");
    s.text(beside(cross, [0.8 * SCALE, 5.0]), r#"font-size="14""#, text);
    let (place, text) = (beside(disc, [-0.5 * SCALE, 5.0]), 2.0 * DISC_MM);
    let style = r#"text-anchor="end" font-size="14""#;
    s.text(place, style, format_args!("disc \u{2300} {text}"));
    let first = 1e-3 * f64::from(NOMINAL_PLACES_UM[0]);
    let [x, _] = at([first - 0.45, 0.0]);
    let text = [x - 6.0, DATUM[1] - 25.0];
    upright(s, x, [upper, lower], text, &format!("{slit_height:.3}"));
    for y in [upper, lower] {
        s.line([x - 5.0, y], [at([first, 0.0])[0], y], HELP);
    }
    // A slit's width: arrows from outside.
    let y = lower + 44.0;
    let [from, to] = [-0.5, 0.5].map(|part| at([first + part * width, 0.0])[0]);
    for (end, out) in [(from, -26.0), (to, 26.0)] {
        s.line([end, lower + 22.0], [end, y + 5.0], HELP);
        let arrow = r##"stroke="#1555d0" marker-end="url(#a)""##;
        s.line([end + out, y], [end, y], arrow);
    }
    let text = format!("{width:.3} ({count} x)");
    s.text([to + 32.0, y + 5.0], r##"fill="#1555d0""##, text);

    // The table: two lines of numbers, places and gaps.
    let column = (WIDTH - 135.0) / count as f64;
    for (row, name) in (0..).zip(["slit", "place", "to the next"]) {
        let y = table + 26.0 * f64::from(row);
        s.text([30.0, y], BOLD, name);
        let rule = r##"stroke="#bbbbbb""##;
        s.line([30.0, y + 8.0], [WIDTH - 20.0, y + 8.0], rule);
    }
    for (index, &um) in NOMINAL_PLACES_UM.iter().enumerate() {
        let x = 128.0 + column * (index as f64 + 0.5) - 8.0;
        let mm = 1e-3 * f64::from(um);
        s.text([x, table], MIDDLE, index + 1);
        s.text([x, table + 26.0], MIDDLE, format_args!("{mm:+.3}"));
        if let Some(next) = NOMINAL_PLACES_UM.get(index + 1) {
            let gap = 1e-3 * f64::from(next - um);
            let place = [x + 0.5 * column, table + 52.0];
            s.text(place, MIDDLE, format_args!("{gap:.3}"));
        }
    }
    for (index, note) in (0..).zip(&notes) {
        let y = first_note + 22.0 * f64::from(index);
        s.text([30.0, y], r#"xml:space="preserve""#, note);
    }
    svg.end()
}
