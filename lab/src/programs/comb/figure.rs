//! The figure of docs/physics.md that shows how a comb works.

use simulator::scene::comb::Comb;
use simulator::scene::{Scene, Simulation};
use simulator::with;
use slitrange::frame::comb::NOMINAL_PLACES_UM;

use crate::comb::with_speckle;
use crate::svg::{self, Svg};

/// The light of the row that is drawn: a surface of metal at 0.8 m.
struct RowOfMetal {
    counts: Vec<f32>,
    centres: Vec<f64>,
    black: f32,
}

impl RowOfMetal {
    fn new(base: &Scene) -> Self {
        let scene = with(with_speckle(base, 1e-3, 1), |it| {
            it.comb = Some(Comb::nominal())
        });
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
    let title = "A comb of slits: each slit shows the spot once on the row";
    let mut svg = Svg::new([1000.0, 800.0], 17, title);
    let s = &mut svg;
    s.add(
        r##"<rect x="20" y="458" width="110" height="34" rx="4" fill="#dddddd" stroke="#222222"/>
<text x="75" y="481" text-anchor="middle">laser</text>
<line x1="130" y1="475" x2="800" y2="475" stroke="#d62728" stroke-width="3"/>
<rect x="800" y="390" width="20" height="130" fill="#bbbbbb" stroke="#222222"/>
<text x="810" y="382" text-anchor="middle">target</text>
<circle cx="800" cy="475" r="6" fill="#d62728"/>
<text x="760" y="500" text-anchor="end">spot</text>
<defs><marker id="a" viewBox="0 0 10 8" refX="9" refY="4" markerWidth="10" markerHeight="8" orient="auto"><path d="M0 0 L10 4 L0 8 z" fill="#1f77b4"/></marker></defs>
<text x="24" y="318" fill="#1f77b4">line sensor:</text><text x="24" y="340" fill="#1f77b4">16 images on one row</text>
<text x="610" y="120" font-size="16" fill="#666666">Not to scale: 300 mm from beam to mask,</text>
<text x="610" y="142" font-size="16" fill="#666666">50 mm from mask to sensor, 15 mm of slits.</text>
<text x="610" y="176" font-size="16" fill="#666666">Each slit sees other speckle: its image is</text>
<text x="610" y="198" font-size="16" fill="#666666">brighter or darker, and off by some pixels.</text>"##,
    );
    let spot = [800.0, 475.0];
    let mask = [290.0, 225.0];
    let length = f64::hypot(spot[0] - mask[0], spot[1] - mask[1]);
    // Towards the target, and along the row: away from the laser's beam, to the right of the one and up.
    let axis = [(spot[0] - mask[0]) / length, (spot[1] - mask[1]) / length];
    let along = [axis[1], -axis[0]];
    let gap = 150.0;
    let at = |depth: f64, place: f64| [0, 1].map(|i| mask[i] + depth * axis[i] + place * along[i]);
    let places = NOMINAL_PLACES_UM.map(|um| 1.1e-2 * f64::from(um));
    // Light through each slit.
    let heights = row.centres.iter().map(|&it| row.height(it));
    let highest = heights.fold(0.0, f32::max);
    for (&place, &centre) in places.iter().zip(&row.centres) {
        let opacity = 0.25 + 0.75 * row.height(centre) / highest;
        let style = format!(r##"stroke="#d62728" stroke-width="1.2" opacity="{opacity:.2}""##);
        s.line(spot, at(-gap, place * (1.0 + gap / length)), &style);
    }
    // The mask: bars between the slits.
    let mut edges = vec![-115.0];
    edges.extend(places.iter().flat_map(|place| [place - 2.2, place + 2.2]));
    edges.push(115.0);
    for bar in edges.chunks(2) {
        let style = r##"stroke="#222222" stroke-width="5""##;
        s.line(at(0.0, bar[0]), at(0.0, bar[1]), style);
    }
    let sensor = r##"stroke="#1f77b4" stroke-width="10""##;
    s.line(at(-gap - 6.0, -140.0), at(-gap - 6.0, 140.0), sensor);
    let [from, to] = [-100.0, 100.0].map(|place| at(-gap - 22.0, place));
    let arrow = r##"stroke="#1f77b4" stroke-width="1.5" marker-end="url(#a)""##;
    s.line(from, to, arrow);
    let [x, y] = at(0.0, 120.0);
    s.text([x + 8.0, y + 2.0], "", "mask with 16 slits");
    let style = r##"fill="#1f77b4" text-anchor="end""##;
    s.text([to[0] - 8.0, to[1] + 4.0], style, "pixels count");

    // A row.
    let (left, right, top, bottom) = (60.0, 980.0, 585.0, 750.0);
    let (first, last) = (600.0, 3000.0);
    let x_of = |pixel: f64| left + (right - left) * (pixel - first) / (last - first);
    let y_of = |counts: f32| bottom - (bottom - top) * f64::from(counts / (1.08 * highest));
    let grey = r##"stroke="#888888""##;
    s.line([left, bottom], [right, bottom], grey);
    for pixel in (600..=3000).step_by(400) {
        let x = x_of(f64::from(pixel));
        s.line([x, bottom], [x, bottom + 6.0], grey);
        let style = r#"text-anchor="middle" font-size="15""#;
        s.text([x, bottom + 24.0], style, pixel);
    }
    let style = r#"text-anchor="middle" font-size="16""#;
    s.text([520.0, bottom + 44.0], style, "pixel");
    for (number, &centre) in (1..).zip(&row.centres) {
        let (x, y) = (x_of(centre), y_of(row.height(centre)) - 8.0);
        let broken = r##"stroke="#1f77b4" stroke-width="0.8" stroke-dasharray="3 3""##;
        s.line([x, bottom], [x, top], broken);
        s.text([x, y], r#"text-anchor="middle" font-size="14""#, number);
    }
    let pixels = (first as usize..last as usize).step_by(2);
    let points = pixels.map(|pixel| [x_of(pixel as f64), y_of(row.counts[pixel] - row.black)]);
    s.add(format_args!(
        r##"<polyline points="{}" fill="none" stroke="#d62728" stroke-width="1.5"/>"##,
        svg::points(points)
    ));
    let words = "A simulated row: metal at 0.8 m, laser spot of 1 mm. Broken: where each slit shows a target \
                 without speckle.";
    s.text([left, 562.0], r#"font-size="16""#, words);
    svg.end()
}
