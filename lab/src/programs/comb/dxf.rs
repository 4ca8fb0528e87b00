//! The mask as a DXF file of release 12 (AC1009), for laser cutters and mask writers:
//! `docs/hardware/comb.dxf`.
//!
//! The file has closed polylines, a circle and texts, in millimetres, on these layers: OUTLINE, SLITS, MARKS
//! and NOTES. Do not cut NOTES. The view is that of [`crate::programs::comb::drawing`].

use std::fmt::{Display, Write as _};

use crate::programs::comb::drawing::{self, DISC_MM, MARKS_MM, OUTLINE_MM, Outline};
use crate::programs::comb::tolerances::Tolerances;

/// Layers and their colours: numbers of AutoCAD's palette.
const LAYERS: [(&str, u8); 4] = [("OUTLINE", 7), ("SLITS", 1), ("MARKS", 5), ("NOTES", 8)];

/// Height of the notes in millimetres.
const TEXT_MM: f64 = 0.4;

/// A file under way: pairs of a group code and a value, each on its own line.
#[derive(Default)]
struct Pairs(String);

impl Pairs {
    /// Adds pairs that are written with bars between them: `0 VERTEX|8 SLITS`.
    fn add(&mut self, pairs: impl Display) {
        for pair in pairs.to_string().split('|') {
            let (code, value) = pair.split_once(' ').unwrap_or((pair, ""));
            let _ = writeln!(self.0, "{code:>3}\n{value}");
        }
    }

    fn point(&mut self, [x, y]: [f64; 2]) {
        self.add(format_args!("10 {x:.6}|20 {y:.6}|30 0.0"));
    }

    fn closed(&mut self, layer: &str, outline: &Outline) {
        self.add(format_args!("0 POLYLINE|8 {layer}|66 1"));
        self.point([0.0, 0.0]);
        self.add("70 1");
        for &corner in outline {
            self.add(format_args!("0 VERTEX|8 {layer}"));
            self.point(corner);
        }
        self.add(format_args!("0 SEQEND|8 {layer}"));
    }
}

pub fn write(tolerances: &Tolerances) -> String {
    let [half, half_height] = OUTLINE_MM.map(|it| 0.5 * it);
    let mut out = Pairs::default();
    out.add("999 Mask of slitrange's comb of slits. Units: millimetres. Written by cargo comb --drawing.");
    // 4: millimetres. Release 12 does not know it, and readers of any release take it.
    out.add("0 SECTION|2 HEADER|9 $ACADVER|1 AC1009|9 $INSUNITS|70 4|9 $EXTMIN");
    out.point([-half, -half_height]);
    out.add("9 $EXTMAX");
    out.point([half, half_height]);
    out.add("0 ENDSEC|0 SECTION|2 TABLES|0 TABLE|2 LTYPE|70 1");
    out.add("0 LTYPE|2 CONTINUOUS|70 0|3 Solid line|72 65|73 0|40 0.0|0 ENDTAB");
    out.add(format_args!("0 TABLE|2 LAYER|70 {}", LAYERS.len()));
    for (name, colour) in LAYERS {
        out.add(format_args!(
            "0 LAYER|2 {name}|70 0|62 {colour}|6 CONTINUOUS"
        ));
    }
    out.add("0 ENDTAB|0 ENDSEC|0 SECTION|2 BLOCKS|0 ENDSEC|0 SECTION|2 ENTITIES");
    out.closed("OUTLINE", &drawing::edge());
    for slit in drawing::slits() {
        out.closed("SLITS", &slit);
    }
    out.closed("MARKS", &drawing::cross());
    out.add("0 CIRCLE|8 MARKS");
    out.point(MARKS_MM[1]);
    out.add(format_args!("40 {DISC_MM}"));
    for (line, note) in (1..).zip(drawing::notes(tolerances)) {
        out.add("0 TEXT|8 NOTES");
        out.point([-half, -half_height - 1.8 * TEXT_MM * f64::from(line)]);
        // Release 12 has no letters beyond ASCII, and this name for plus-minus.
        let note = note.replace('\u{b1}', "%%p");
        out.add(format_args!("40 {TEXT_MM}|1 {note}"));
    }
    out.add("0 ENDSEC|0 EOF");
    out.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use slitrange::frame::comb::{NOMINAL_PLACES_UM, SLIT_WIDTH_UM};
    use statistics::least_and_most;

    /// An entity: its type and layer, and the corners of a polyline or the middle of anything else.
    #[derive(Debug)]
    struct Entity<'a> {
        kind: &'a str,
        layer: &'a str,
        is_closed: bool,
        points: Vec<[f64; 2]>,
    }

    /// The entities of a file, as a reader takes them from pairs of group codes and values. The code 0 begins
    /// an entity, a corner of the one before, or its end.
    fn entities(text: &str) -> Vec<Entity<'_>> {
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len() % 2, 0);
        let pairs = lines.as_chunks().0.iter();
        let pairs = pairs.map(|[code, value]| (code.trim().parse().expect("a code"), *value));
        let pairs: Vec<(u32, &str)> = pairs.collect();
        assert_eq!(pairs.last(), Some(&(0, "EOF")));
        let groups = pairs.chunk_by(|_, next| next.0 != 0);
        let mut groups = groups.skip_while(|group| !group.contains(&(2, "ENTITIES")));
        groups.next().expect("a section");
        let mut all: Vec<Entity<'_>> = vec![];
        for group in groups.take_while(|group| group[0].1 != "ENDSEC") {
            let value = |code: u32| Some(group.iter().find(|pair| pair.0 == code)?.1);
            let number = |code| value(code)?.parse::<f64>().ok();
            let point = || [10, 20].map(|code| number(code).expect("a number"));
            let (kind, layer) = (group[0].1, value(8).expect("a layer"));
            let is_closed = value(70) == Some("1");
            if !["VERTEX", "SEQEND"].contains(&kind) {
                all.push(Entity {
                    kind,
                    layer,
                    is_closed,
                    points: vec![],
                });
            }
            let entity = all.last_mut().expect("an entity");
            assert_eq!(entity.layer, layer);
            if !["POLYLINE", "SEQEND"].contains(&kind) {
                entity.points.push(point());
            }
        }
        all
    }

    fn bounds(points: &[[f64; 2]]) -> [[f64; 2]; 2] {
        [0, 1].map(|axis| least_and_most(points.iter().map(|point| point[axis])).into())
    }

    #[test]
    fn the_file_holds_the_slits_of_the_core() {
        let text = write(&Tolerances::nominal());
        assert!(text.is_ascii());
        let all = entities(&text);
        let on = |layer: &str| Vec::from_iter(all.iter().filter(|it| it.layer == layer));
        let slits = on("SLITS");
        assert_eq!(slits.len(), NOMINAL_PLACES_UM.len());
        for (slit, um) in slits.into_iter().zip(NOMINAL_PLACES_UM) {
            assert!(slit.is_closed && slit.kind == "POLYLINE" && slit.points.len() == 4);
            let [[left, right], [bottom, top]] = bounds(&slit.points);
            assert!((0.5 * (left + right) - 1e-3 * f64::from(um)).abs() < 1e-6);
            assert!((right - left - 1e-3 * f64::from(SLIT_WIDTH_UM)).abs() < 1e-6);
            assert!((top - 1.5).abs() < 1e-6 && (bottom + 1.5).abs() < 1e-6);
        }
        let outline = on("OUTLINE");
        assert_eq!(outline.len(), 1);
        assert!(outline[0].is_closed);
        assert_eq!(bounds(&outline[0].points), [[-12.5, 12.5], [-6.0, 6.0]]);
        let marks = on("MARKS");
        assert_eq!(marks.len(), 2);
        assert!(marks[0].is_closed && marks[0].points.len() == 12);
        assert_eq!((marks[1].kind, marks[1].points[0]), ("CIRCLE", MARKS_MM[1]));
        assert!(on("NOTES").iter().all(|it| it.kind == "TEXT"));
        assert_eq!(all.len(), 1 + 16 + 2 + on("NOTES").len());
    }

    /// The view is right: what the sensor sees to the right is farther from the laser, and has larger pixels.
    #[test]
    fn a_larger_place_has_a_longer_baseline_and_larger_pixels() {
        let optics = simulator::optics::Optics::nominal();
        let [first, .., last] = NOMINAL_PLACES_UM.map(|um| optics.behind(1e-6 * f64::from(um)));
        assert!(last.baseline > first.baseline);
        assert!(last.centre(0.8) > first.centre(0.8));
    }

    #[test]
    fn the_repository_holds_these_files() {
        let tolerances = Tolerances::nominal();
        for (name, expected) in [
            (crate::programs::comb::DXF, write(&tolerances)),
            (crate::programs::comb::SVG, drawing::svg(&tolerances)),
        ] {
            let found = std::fs::read_to_string(crate::docs::path(name)).expect(name);
            assert!(
                found == expected,
                "{name} differs: run cargo comb --drawing"
            );
        }
    }
}
