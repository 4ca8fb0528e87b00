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
    fn add(&mut self, code: u16, value: impl Display) {
        let _ = writeln!(self.0, "{code:3}\n{value}");
    }

    fn section(&mut self, name: &str, body: impl FnOnce(&mut Self)) {
        self.add(0, "SECTION");
        self.add(2, name);
        body(self);
        self.add(0, "ENDSEC");
    }

    fn point(&mut self, [x, y]: [f64; 2]) {
        self.add(10, format!("{x:.6}"));
        self.add(20, format!("{y:.6}"));
        self.add(30, "0.0");
    }

    fn closed(&mut self, layer: &str, outline: &Outline) {
        self.add(0, "POLYLINE");
        self.add(8, layer);
        self.add(66, 1);
        self.point([0.0, 0.0]);
        self.add(70, 1);
        for &corner in outline {
            self.add(0, "VERTEX");
            self.add(8, layer);
            self.point(corner);
        }
        self.add(0, "SEQEND");
        self.add(8, layer);
    }

    fn table(&mut self, name: &str, entries: usize, body: impl FnOnce(&mut Self)) {
        self.add(0, "TABLE");
        self.add(2, name);
        self.add(70, entries);
        body(self);
        self.add(0, "ENDTAB");
    }
}

pub fn write(tolerances: &Tolerances) -> String {
    let notes: Vec<String> = drawing::notes(tolerances)
        .into_iter()
        // Release 12 has no letters beyond ASCII, and this name for plus-minus.
        .map(|note| note.replace('\u{b1}', "%%p"))
        .collect();
    let mut out = Pairs::default();
    out.add(
        999,
        "Mask of slitrange's comb of slits. Units: millimetres. Written by cargo comb --drawing.",
    );
    out.section("HEADER", |it| {
        it.add(9, "$ACADVER");
        it.add(1, "AC1009");
        // 4: millimetres. Release 12 does not know it, and readers of any release take it.
        it.add(9, "$INSUNITS");
        it.add(70, 4);
        let [half, half_height] = OUTLINE_MM.map(|it| 0.5 * it);
        it.add(9, "$EXTMIN");
        it.point([-half, -half_height]);
        it.add(9, "$EXTMAX");
        it.point([half, half_height]);
    });
    out.section("TABLES", |it| {
        it.table("LTYPE", 1, |it| {
            it.add(0, "LTYPE");
            it.add(2, "CONTINUOUS");
            it.add(70, 0);
            it.add(3, "Solid line");
            it.add(72, 65);
            it.add(73, 0);
            it.add(40, "0.0");
        });
        it.table("LAYER", LAYERS.len(), |it| {
            for (name, colour) in LAYERS {
                it.add(0, "LAYER");
                it.add(2, name);
                it.add(70, 0);
                it.add(62, colour);
                it.add(6, "CONTINUOUS");
            }
        });
    });
    out.section("BLOCKS", |_| {});
    out.section("ENTITIES", |it| {
        it.closed("OUTLINE", &drawing::edge());
        for slit in drawing::slits() {
            it.closed("SLITS", &slit);
        }
        it.closed("MARKS", &drawing::cross());
        it.add(0, "CIRCLE");
        it.add(8, "MARKS");
        it.point(MARKS_MM[1]);
        it.add(40, DISC_MM);
        for (line, note) in (1..).zip(&notes) {
            it.add(0, "TEXT");
            it.add(8, "NOTES");
            it.point([
                -0.5 * OUTLINE_MM[0],
                -0.5 * OUTLINE_MM[1] - 1.8 * TEXT_MM * f64::from(line),
            ]);
            it.add(40, TEXT_MM);
            it.add(1, note);
        }
    });
    out.add(0, "EOF");
    out.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use slitrange::frame::comb::{NOMINAL_PLACES_UM, SLIT_WIDTH_UM};

    /// An entity: its type and layer, and the corners of a polyline or the middle of anything else.
    #[derive(Debug, Default)]
    struct Entity {
        kind: String,
        layer: String,
        is_closed: bool,
        points: Vec<[f64; 2]>,
    }

    /// The entities of a file, as a reader takes them from pairs of group codes and values.
    fn entities(text: &str) -> Vec<Entity> {
        let lines: Vec<&str> = text.lines().collect();
        let pairs = lines.as_chunks().0.iter();
        let mut pairs = pairs.map(|[code, value]| (code.trim().parse().expect("a code"), *value));
        assert_eq!(
            (lines.len() % 2, pairs.clone().next_back()),
            (0, Some((0, "EOF")))
        );
        let section = pairs.by_ref().find(|&pair| pair == (2, "ENTITIES"));
        section.expect("a section");
        let mut all: Vec<Entity> = vec![];
        let mut is_point = false;
        for (code, value) in pairs {
            if code == 0 {
                is_point = !["POLYLINE", "SEQEND"].contains(&value);
                match value {
                    "ENDSEC" => return all,
                    "VERTEX" | "SEQEND" => {}
                    _ => all.push(Entity {
                        kind: value.into(),
                        ..Entity::default()
                    }),
                }
                continue;
            }
            let entity = all.last_mut().expect("an entity");
            let number = || value.parse::<f64>().expect("a number");
            match code {
                8 if entity.layer.is_empty() => entity.layer = value.into(),
                8 => assert_eq!(entity.layer, value),
                70 => entity.is_closed = value == "1",
                10 if is_point => entity.points.push([number(), f64::NAN]),
                20 if is_point => entity.points.last_mut().expect("a point")[1] = number(),
                _ => {}
            }
        }
        panic!("the section does not end");
    }

    fn bounds(points: &[[f64; 2]]) -> [[f64; 2]; 2] {
        [0, 1].map(|axis| {
            let values = || points.iter().map(|point| point[axis]);
            [
                values().fold(f64::MAX, f64::min),
                values().fold(f64::MIN, f64::max),
            ]
        })
    }

    #[test]
    fn the_file_holds_the_slits_of_the_core() {
        let text = write(&Tolerances::nominal());
        assert!(text.is_ascii());
        let all = entities(&text);
        let on =
            |layer: &str| -> Vec<&Entity> { all.iter().filter(|it| it.layer == layer).collect() };
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
        assert_eq!(
            (marks[1].kind.as_str(), marks[1].points[0]),
            ("CIRCLE", MARKS_MM[1])
        );
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
