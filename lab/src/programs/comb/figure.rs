//! The figure of docs/physics.md that shows how a comb works.

use std::fmt::Write as _;

use simulator::scene::comb::Comb;
use simulator::scene::{Scene, Simulation};
use slitrange::frame::comb::NOMINAL_PLACES_UM;

use crate::comb::with_speckle;

const WIDTH: f64 = 1000.0;
const HEIGHT: f64 = 800.0;

/// The light of the row that is drawn: a surface of metal at 0.8 m.
struct RowOfMetal {
    counts: Vec<f32>,
    centres: Vec<f64>,
    black: f32,
}

impl RowOfMetal {
    fn new(base: &Scene) -> Self {
        let scene = Scene {
            comb: Some(Comb::nominal()),
            ..with_speckle(base, 1e-3, 1)
        };
        let simulation = Simulation::on_surface(scene.clone(), 8);
        let row = simulation.row(0, 0.8, scene.exposure);
        Self {
            counts: row[scene.geometry().light].to_vec(),
            centres: simulation.true_centres(0, 0.8),
            black: scene.black_level.map_or(0.0, |it| it.counts as f32),
        }
    }

    /// The highest of the pixels around an image, above the black level.
    fn height(&self, centre: f64) -> f32 {
        let middle = centre.round() as usize;
        let near = &self.counts[middle - 20..=middle + 20];
        near.iter().copied().fold(0.0, f32::max) - self.black
    }
}

/// The figure: beam, mask and sensor from above (not to scale), and a simulated row.
pub fn svg(base: &Scene) -> String {
    let row = RowOfMetal::new(base);
    let mut svg = format!(
        r##"<svg width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}" xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="17" fill="#222222">
<title>A comb of slits: each slit shows the spot once on the row</title>
<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>
<rect x="20" y="458" width="110" height="34" rx="4" fill="#dddddd" stroke="#222222"/>
<text x="75" y="481" text-anchor="middle">laser</text>
<line x1="130" y1="475" x2="800" y2="475" stroke="#d62728" stroke-width="3"/>
<rect x="800" y="390" width="20" height="130" fill="#bbbbbb" stroke="#222222"/>
<text x="810" y="382" text-anchor="middle">target</text>
<circle cx="800" cy="475" r="6" fill="#d62728"/>
<text x="760" y="500" text-anchor="end">spot</text>
"##
    );
    let s = &mut svg;
    let spot = [800.0, 475.0];
    let mask = [290.0, 225.0];
    let length = f64::hypot(spot[0] - mask[0], spot[1] - mask[1]);
    // Towards the target, and along the row: away from the laser's beam, to the right of the one and up.
    let axis = [(spot[0] - mask[0]) / length, (spot[1] - mask[1]) / length];
    let along = [axis[1], -axis[0]];
    let gap = 150.0;
    let at = |depth: f64, place: f64| {
        [
            mask[0] + depth * axis[0] + place * along[0],
            mask[1] + depth * axis[1] + place * along[1],
        ]
    };
    let places = NOMINAL_PLACES_UM.map(|um| 1.1e-2 * f64::from(um));
    // Light through each slit.
    let highest = row
        .centres
        .iter()
        .map(|&it| row.height(it))
        .fold(0.0, f32::max);
    for (&place, &centre) in places.iter().zip(&row.centres) {
        let [x, y] = at(-gap, place * (1.0 + gap / length));
        let opacity = 0.25 + 0.75 * row.height(centre) / highest;
        let _ = writeln!(
            s,
            r##"<line x1="{}" y1="{}" x2="{x:.1}" y2="{y:.1}" stroke="#d62728" stroke-width="1.2" opacity="{opacity:.2}"/>"##,
            spot[0], spot[1]
        );
    }
    // The mask: bars between the slits.
    let mut edges = vec![-115.0];
    for place in places {
        edges.extend([place - 2.2, place + 2.2]);
    }
    edges.push(115.0);
    for bar in edges.chunks(2) {
        let ([x1, y1], [x2, y2]) = (at(0.0, bar[0]), at(0.0, bar[1]));
        let _ = writeln!(
            s,
            r##"<line x1="{x1:.1}" y1="{y1:.1}" x2="{x2:.1}" y2="{y2:.1}" stroke="#222222" stroke-width="5"/>"##
        );
    }
    let ([x1, y1], [x2, y2]) = (at(-gap - 6.0, -140.0), at(-gap - 6.0, 140.0));
    let _ = writeln!(
        s,
        r##"<line x1="{x1:.1}" y1="{y1:.1}" x2="{x2:.1}" y2="{y2:.1}" stroke="#1f77b4" stroke-width="10"/>"##
    );
    let ([x3, y3], [x4, y4]) = (at(-gap - 22.0, -100.0), at(-gap - 22.0, 100.0));
    let _ = writeln!(
        s,
        r##"<defs><marker id="a" viewBox="0 0 10 8" refX="9" refY="4" markerWidth="10" markerHeight="8" orient="auto"><path d="M0 0 L10 4 L0 8 z" fill="#1f77b4"/></marker></defs>
<line x1="{x3:.1}" y1="{y3:.1}" x2="{x4:.1}" y2="{y4:.1}" stroke="#1f77b4" stroke-width="1.5" marker-end="url(#a)"/>"##
    );
    let [x, y] = at(0.0, 120.0);
    let _ = writeln!(
        s,
        r#"<text x="{:.1}" y="{:.1}">mask with 16 slits</text>"#,
        x + 8.0,
        y + 2.0
    );
    let _ = writeln!(
        s,
        r##"<text x="24" y="318" fill="#1f77b4">line sensor:</text><text x="24" y="340" fill="#1f77b4">16 images on one row</text>"##
    );
    let _ = writeln!(
        s,
        r##"<text x="{:.1}" y="{:.1}" fill="#1f77b4" text-anchor="end">pixels count</text>"##,
        x4 - 8.0,
        y4 + 4.0
    );
    let _ = writeln!(
        s,
        r##"<text x="610" y="120" font-size="16" fill="#666666">Not to scale: 300 mm from beam to mask,</text>
<text x="610" y="142" font-size="16" fill="#666666">50 mm from mask to sensor, 15 mm of slits.</text>
<text x="610" y="176" font-size="16" fill="#666666">Each slit sees other speckle: its image is</text>
<text x="610" y="198" font-size="16" fill="#666666">brighter or darker, and off by some pixels.</text>"##
    );

    // A row.
    let (left, right, top, bottom) = (60.0, 980.0, 585.0, 750.0);
    let (first, last) = (600.0, 3000.0);
    let x_of = |pixel: f64| left + (right - left) * (pixel - first) / (last - first);
    let y_of = |counts: f32| bottom - (bottom - top) * f64::from(counts / (1.08 * highest));
    let points: Vec<String> = (first as usize..last as usize)
        .step_by(2)
        .map(|pixel| {
            format!(
                "{:.1},{:.1}",
                x_of(pixel as f64),
                y_of(row.counts[pixel] - row.black)
            )
        })
        .collect();
    let _ = writeln!(
        s,
        r##"<line x1="{left}" y1="{bottom}" x2="{right}" y2="{bottom}" stroke="#888888"/>"##
    );
    for pixel in (600..=3000).step_by(400) {
        let x = x_of(f64::from(pixel));
        let _ = writeln!(
            s,
            r##"<line x1="{x:.1}" y1="{bottom}" x2="{x:.1}" y2="{}" stroke="#888888"/><text x="{x:.1}" y="{}" text-anchor="middle" font-size="15">{pixel}</text>"##,
            bottom + 6.0,
            bottom + 24.0
        );
    }
    let _ = writeln!(
        s,
        r##"<text x="520" y="{}" text-anchor="middle" font-size="16">pixel</text>"##,
        bottom + 44.0
    );
    for (number, &centre) in (1..).zip(&row.centres) {
        let x = x_of(centre);
        let y = y_of(row.height(centre)) - 8.0;
        let _ = writeln!(
            s,
            r##"<line x1="{x:.1}" y1="{bottom}" x2="{x:.1}" y2="{top}" stroke="#1f77b4" stroke-width="0.8" stroke-dasharray="3 3"/><text x="{x:.1}" y="{y:.1}" text-anchor="middle" font-size="14">{number}</text>"##
        );
    }
    let _ = writeln!(
        s,
        r##"<polyline points="{}" fill="none" stroke="#d62728" stroke-width="1.5"/>"##,
        points.join(" ")
    );
    let _ = writeln!(
        s,
        r##"<text x="{left}" y="562" font-size="16">A simulated row: metal at 0.8 m, laser spot of 1 mm. Broken: where each slit shows a target without speckle.</text>"##
    );
    svg + "</svg>\n"
}
