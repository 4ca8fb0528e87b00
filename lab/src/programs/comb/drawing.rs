//! The drawing of the nominal mask: `docs/hardware/comb.svg` for people. [`dxf`](super::dxf) writes the same
//! shapes for machines.
//!
//! Both show the mask as the sensor sees it. There the laser is to the left, the target is behind the sheet,
//! and pixels and places count to the right: a slit with a larger place is farther from the laser's beam
//! ([`Optics::behind`](simulator::optics::Optics::behind)).

use std::fmt::Write as _;

use simulator::optics::Aperture;
use slitrange::frame::comb::{NOMINAL_PLACES_UM, SLIT_WIDTH_UM};

use crate::programs::comb::tolerances::{DISTANCE, MATERIALS, ROW_OFF, Tolerances, WARMER};

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

/// The mask's edge.
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

/// The slits, in the order of their places.
pub fn slits() -> Vec<Outline> {
    let place = |um| [1e-3 * f64::from(um), 0.0];
    NOMINAL_PLACES_UM
        .map(|um| rectangle(place(um), slit_mm()))
        .to_vec()
}

/// The cross.
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
        format!(
            "{} {:.1}e-6 / K",
            MATERIALS[index].0,
            1e6 * MATERIALS[index].1
        )
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
/// Where the datum is in the picture.
const DATUM: [f64; 2] = [550.0, 395.0];

fn at([x, y]: [f64; 2]) -> [f64; 2] {
    [DATUM[0] + SCALE * x, DATUM[1] - SCALE * y]
}

fn path(svg: &mut String, outline: &Outline, style: &str) {
    let points: Vec<String> = outline
        .iter()
        .map(|&it| at(it))
        .map(|[x, y]| format!("{x:.2},{y:.2}"))
        .collect();
    let _ = writeln!(svg, r#"<polygon points="{}" {style}/>"#, points.join(" "));
}

fn line(svg: &mut String, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2], style: &str) {
    let _ = writeln!(
        svg,
        r#"<line x1="{x1:.2}" y1="{y1:.2}" x2="{x2:.2}" y2="{y2:.2}" {style}/>"#
    );
}

fn words(svg: &mut String, [x, y]: [f64; 2], style: &str, words: &str) {
    let _ = writeln!(svg, r#"<text x="{x:.2}" y="{y:.2}" {style}>{words}</text>"#);
}

/// A line with an arrow at both ends, and its text.
fn dimension(
    svg: &mut String,
    from: [f64; 2],
    to: [f64; 2],
    text: [f64; 2],
    style: &str,
    label: &str,
) {
    line(
        svg,
        from,
        to,
        r##"stroke="#1555d0" marker-start="url(#a)" marker-end="url(#a)""##,
    );
    words(svg, text, style, label);
}

/// The drawing.
pub fn svg(tolerances: &Tolerances) -> String {
    let notes = notes(tolerances);
    let slits = slits();
    let below = at([0.0, -0.5 * OUTLINE_MM[1]])[1];
    let table = below + 108.0;
    let first_note = table + 100.0;
    let height = first_note + 22.0 * notes.len() as f64 + 16.0;
    let mut svg = format!(
        r##"<svg width="{WIDTH}" height="{height}" viewBox="0 0 {WIDTH} {height}" xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="15" fill="#222222">
<title>Mask of a comb of {} slits</title>
<defs><marker id="a" viewBox="0 0 10 6" refX="10" refY="3" markerWidth="10" markerHeight="6" orient="auto-start-reverse"><path d="M0 0 L10 3 L0 6 z" fill="#1555d0"/></marker></defs>
<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>
"##,
        slits.len()
    );
    let s = &mut svg;
    words(
        s,
        [30.0, 32.0],
        r#"font-size="20" font-weight="bold""#,
        &format!("Mask: comb of {} slits", slits.len()),
    );
    words(
        s,
        [WIDTH - 30.0, 32.0],
        r#"text-anchor="end""#,
        "seen from the sensor; written by cargo comb --drawing",
    );

    path(
        s,
        &edge(),
        r##"fill="#eeeeee" stroke="#222222" stroke-width="1.5""##,
    );
    for slit in &slits {
        path(s, slit, r##"fill="#ffffff" stroke="#222222""##);
    }
    path(s, &cross(), r##"fill="#ffffff" stroke="#222222""##);
    let [x, y] = at(MARKS_MM[1]);
    let _ = writeln!(
        s,
        r##"<circle cx="{x}" cy="{y}" r="{}" fill="#ffffff" stroke="#222222"/>"##,
        SCALE * DISC_MM
    );

    // The datum's axes.
    let [half, half_height] = OUTLINE_MM.map(|it| 0.5 * it);
    let axis = r##"stroke="#888888" stroke-dasharray="14 4 3 4""##;
    line(
        s,
        at([0.0, half_height + 0.4]),
        at([0.0, -half_height - 1.2]),
        axis,
    );
    line(s, at([-half - 0.4, 0.0]), at([half + 0.4, 0.0]), axis);
    let [x, y] = at([0.0, -half_height - 1.7]);
    words(
        s,
        [x, y],
        r#"text-anchor="middle" font-weight="bold""#,
        "A: optical axis",
    );
    let [x, y] = at([-half + 0.25, 0.15]);
    words(s, [x, y], r##"fill="#666666" font-size="14""##, "laser");
    let [x, y] = at([half - 0.2, 0.15]);
    words(
        s,
        [x, y],
        r##"text-anchor="end" fill="#666666" font-size="14""##,
        "away from laser",
    );

    // Each slit's place from the datum, and its number.
    let top = at([0.0, half_height])[1];
    for (number, &um) in (1..).zip(&NOMINAL_PLACES_UM) {
        let mm = 1e-3 * f64::from(um);
        let [x, upper] = at([mm, 0.5 * slit_mm()[1]]);
        let lower = at([mm, -0.5 * slit_mm()[1]])[1];
        line(
            s,
            [x, upper - 6.0],
            [x, top - 20.0],
            r##"stroke="#1555d0" stroke-width="0.8""##,
        );
        let turned = format!(
            r##"fill="#1555d0" transform="rotate(-90 {:.2} {:.2})""##,
            x + 5.0,
            top - 26.0
        );
        words(s, [x + 5.0, top - 26.0], &turned, &format!("{mm:+.3}"));
        words(
            s,
            [x, lower + 18.0],
            r#"text-anchor="middle" font-size="14""#,
            &number.to_string(),
        );
    }
    let [x, _] = at([-half, 0.0]);
    words(s, [x, top - 40.0], r##"fill="#1555d0""##, "places from A");

    // Outline, slit and marks.
    let blue = r##"fill="#1555d0" text-anchor="middle""##;
    let [left, right] = [at([-half, 0.0])[0], at([half, 0.0])[0]];
    let y = below + 22.0;
    dimension(
        s,
        [left, y],
        [DATUM[0], y],
        [left + 0.25 * (right - left), y - 5.0],
        blue,
        &format!("{half:.1}"),
    );
    dimension(
        s,
        [DATUM[0], y],
        [right, y],
        [right - 0.25 * (right - left), y - 5.0],
        blue,
        &format!("{half:.1}"),
    );
    let y = below + 46.0;
    dimension(
        s,
        [left, y],
        [right, y],
        [left + 0.25 * (right - left), y - 5.0],
        blue,
        &format!("{:.1}", OUTLINE_MM[0]),
    );
    let x = left - 18.0;
    let turned = format!(
        r##"{blue} transform="rotate(-90 {:.2} {:.2})""##,
        x - 6.0,
        DATUM[1] - 60.0
    );
    dimension(
        s,
        [x, top],
        [x, below],
        [x - 6.0, DATUM[1] - 60.0],
        &turned,
        &format!("{:.1}", OUTLINE_MM[1]),
    );
    let x = right + 18.0;
    let mark = at(MARKS_MM[1])[1];
    line(
        s,
        [at(MARKS_MM[1])[0] + 16.0, mark],
        [x + 6.0, mark],
        r##"stroke="#1555d0" stroke-width="0.8""##,
    );
    let turned = format!(
        r##"{blue} transform="rotate(-90 {:.2} {:.2})""##,
        x + 16.0,
        0.5 * (mark + DATUM[1])
    );
    dimension(
        s,
        [x, mark],
        [x, DATUM[1]],
        [x + 16.0, 0.5 * (mark + DATUM[1])],
        &turned,
        &format!("{:.1}", MARKS_MM[1][1]),
    );
    for [mm, height] in MARKS_MM {
        let [x, y] = at([mm, height]);
        words(s, [x, y - 24.0], blue, &format!("{mm:+.1}"));
    }
    let [x, y] = at([MARKS_MM[0][0] + 0.8, MARKS_MM[0][1]]);
    words(
        s,
        [x, y + 5.0],
        r#"font-size="14""#,
        &format!("cross {} x {}", CROSS_MM[0], CROSS_MM[1]),
    );
    let [x, y] = at([MARKS_MM[1][0] - 0.5, MARKS_MM[1][1]]);
    words(
        s,
        [x, y + 5.0],
        r#"text-anchor="end" font-size="14""#,
        &format!("disc \u{2300} {}", 2.0 * DISC_MM),
    );
    let first = 1e-3 * f64::from(NOMINAL_PLACES_UM[0]);
    let [width, slit_height] = slit_mm();
    let [x, upper] = at([first - 0.45, 0.5 * slit_height]);
    let lower = at([0.0, -0.5 * slit_height])[1];
    let turned = format!(
        r##"{blue} transform="rotate(-90 {:.2} {:.2})""##,
        x - 6.0,
        DATUM[1] - 25.0
    );
    dimension(
        s,
        [x, upper],
        [x, lower],
        [x - 6.0, DATUM[1] - 25.0],
        &turned,
        &format!("{slit_height:.3}"),
    );
    for y in [upper, lower] {
        line(
            s,
            [x - 5.0, y],
            [at([first, 0.0])[0], y],
            r##"stroke="#1555d0" stroke-width="0.8""##,
        );
    }
    // A slit's width: arrows from outside.
    let y = lower + 44.0;
    let [from, to] = [first - 0.5 * width, first + 0.5 * width].map(|mm| at([mm, 0.0])[0]);
    for (end, out) in [(from, -26.0), (to, 26.0)] {
        line(
            s,
            [end, lower + 22.0],
            [end, y + 5.0],
            r##"stroke="#1555d0" stroke-width="0.8""##,
        );
        line(
            s,
            [end + out, y],
            [end, y],
            r##"stroke="#1555d0" marker-end="url(#a)""##,
        );
    }
    words(
        s,
        [to + 32.0, y + 5.0],
        r##"fill="#1555d0""##,
        &format!("{width:.3} ({} x)", slits.len()),
    );

    // The table: two lines of numbers, places and gaps.
    let column = (WIDTH - 135.0) / slits.len() as f64;
    for (row, name) in ["slit", "place", "to the next"].into_iter().enumerate() {
        let y = table + 26.0 * row as f64;
        words(s, [30.0, y], r#"font-weight="bold""#, name);
        line(
            s,
            [30.0, y + 8.0],
            [WIDTH - 20.0, y + 8.0],
            r##"stroke="#bbbbbb""##,
        );
    }
    for (index, &um) in NOMINAL_PLACES_UM.iter().enumerate() {
        let x = 128.0 + column * (index as f64 + 0.5) - 8.0;
        let middle = r#"text-anchor="middle" font-size="14""#;
        words(s, [x, table], middle, &(index + 1).to_string());
        words(
            s,
            [x, table + 26.0],
            middle,
            &format!("{:+.3}", 1e-3 * f64::from(um)),
        );
        if let Some(next) = NOMINAL_PLACES_UM.get(index + 1) {
            words(
                s,
                [x + 0.5 * column, table + 52.0],
                middle,
                &format!("{:.3}", 1e-3 * f64::from(next - um)),
            );
        }
    }
    for (index, note) in notes.iter().enumerate() {
        words(
            s,
            [30.0, first_note + 22.0 * index as f64],
            r#"xml:space="preserve""#,
            note,
        );
    }
    svg + "</svg>\n"
}
