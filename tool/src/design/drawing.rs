//! The drawing of laser, slit, sensor and target to scale, with the dimensions of eq. (1).

use std::fmt::Write as _;

use super::Design;
use super::geometry::Geometry;

const WIDTH: f64 = 1000.0;
const HEIGHT: f64 = 640.0;
const INK: &str = "#222222";
const GREY: &str = "#666666";
const LIGHT: &str = "#d62728";

type Place = (f64, f64);

struct Svg(String);

impl Svg {
    fn line(&mut self, (from, to): (Place, Place), colour: &str, width: f64, more: &str) {
        let _ = writeln!(
            self.0,
            r#"<line x1="{:.1}" y1="{:.1}" x2="{:.1}" y2="{:.1}" stroke="{colour}" stroke-width="{width}"{more}/>"#,
            from.0, from.1, to.0, to.1
        );
    }

    fn text(&mut self, at: Place, anchor: &str, text: &str) {
        // A white rim keeps letters readable on lines.
        let _ = writeln!(
            self.0,
            r##"<text x="{:.1}" y="{:.1}" text-anchor="{anchor}" stroke="#ffffff" stroke-width="5" paint-order="stroke">{text}</text>"##,
            at.0, at.1
        );
    }

    /// A dimension: a line with an arrow at both ends, and its text in the middle or beside it.
    fn dimension(&mut self, ends: (Place, Place), text: &str, (at, anchor): (Place, &str)) {
        let arrows = r##" marker-start="url(#arrow)" marker-end="url(#arrow)""##;
        self.line(ends, GREY, 1.0, arrows);
        self.text(at, anchor, text);
    }

    fn spot(&mut self, (x, y): Place) {
        self.0 += &format!(r#"<circle cx="{x:.1}" cy="{y:.1}" r="4" fill="{LIGHT}"/>"#);
        self.0.push('\n');
    }

    fn box_around(&mut self, at: Place, (width, height): Place, fill: &str) {
        let _ = writeln!(
            self.0,
            r#"<rect x="{:.1}" y="{:.1}" width="{width:.1}" height="{height:.1}" fill="{fill}" stroke="{INK}"/>"#,
            at.0, at.1
        );
    }
}

const BROKEN: &str = r#" stroke-dasharray="6 4""#;

/// A place near the slit, in mm from the beam and along it: `along` the axis towards the beam, and `beside` it
/// along the row, in the direction in which pixels count.
fn near_slit(geometry: &Geometry, along: f64, beside: f64) -> Place {
    let (sin, cos) = geometry.angle.sin_cos();
    (
        geometry.baseline - along * cos + beside * sin,
        geometry.offset + along * sin + beside * cos,
    )
}

pub(super) fn svg(design: &Design) -> String {
    let mut svg = Svg(format!(
        r##"<svg width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}" xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="16" fill="{INK}">
<title>Laser, slit, sensor and target: the dimensions of eq. (1)</title>
<defs><marker id="arrow" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" orient="auto-start-reverse"><path d="M0,1 L9,5 L0,9" fill="none" stroke="{GREY}" stroke-width="1.5"/></marker></defs>
<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>
"##
    ));
    draw_whole(&mut svg, design);
    draw_slit_and_sensor(&mut svg, design);
    svg.0 + "</svg>\n"
}

/// Laser, beam, targets and slit, to scale.
fn draw_whole(svg: &mut Svg, design: &Design) {
    let (geometry, options) = (&design.geometry, &design.options);
    let scale = ((WIDTH - 190.0) / options.far).min(240.0 / geometry.baseline);
    // The place on the drawing, from the one in mm from the beam and along it.
    let place = |(away, along): Place| (110.0 + scale * along, HEIGHT - 110.0 - scale * away);
    let near_slit = |along: f64, beside: f64| place(near_slit(geometry, along, beside));
    let (slit, beam) = (near_slit(0.0, 0.0), place((0.0, 0.0)));

    // The optical axis, from the sensor to the beam.
    let hit = near_slit(geometry.baseline / geometry.angle.cos(), 0.0);
    let sensor = near_slit(-geometry.focal, 0.0);
    svg.line((sensor, hit), GREY, 1.0, BROKEN);
    // Light from the nearest and the farthest target to the pixels.
    for distance in [options.near, options.far] {
        let beside = (geometry.centre(distance) - geometry.axis) * geometry.pitch;
        let (x, y) = place((0.0, distance));
        svg.line(((x, y), near_slit(-geometry.focal, beside)), LIGHT, 1.2, "");
        svg.box_around((x, y - 45.0), (10.0, 90.0), "#cccccc");
        svg.spot((x, y));
    }
    svg.line((beam, place((0.0, options.far))), LIGHT, 3.0, "");
    svg.box_around((beam.0 - 60.0, beam.1 - 13.0), (60.0, 26.0), "#dddddd");
    svg.text((beam.0 - 30.0, beam.1 + 5.0), "middle", "laser");

    // The mask and the sensor's package.
    let ends = |along: f64, half: f64| (near_slit(along, -half), near_slit(along, half));
    let half = 0.5 * geometry.pixels as f64 * geometry.pitch;
    svg.line(ends(0.0, half), INK, 3.0, "");
    svg.line(ends(-geometry.focal, half), INK, 5.0, "");
    svg.text((slit.0 + 14.0, slit.1 - 10.0), "start", "slit");
    svg.text((sensor.0, sensor.1 - 24.0), "middle", "sensor");

    // Dimensions.
    let left = beam.0 - 78.0;
    svg.line(((left - 6.0, slit.1), (slit.0, slit.1)), GREY, 0.7, "");
    let half_way = 0.5 * (beam.1 + slit.1);
    svg.dimension(
        ((left, beam.1), (left, slit.1)),
        &format!("b = {} mm", options.baseline),
        ((left + 8.0, half_way), "start"),
    );
    for (distance, below, name) in [
        (options.near, 66.0, "nearest"),
        (options.far, 94.0, "farthest"),
    ] {
        let (x, y) = place((0.0, distance));
        svg.line(((x, y + 45.0), (x, y + below + 6.0)), GREY, 0.7, "");
        svg.dimension(
            ((beam.0, y + below), (x, y + below)),
            &format!("d = {distance:.0} mm, {name}"),
            ((0.5 * (beam.0 + x) + 60.0, y + below - 7.0), "middle"),
        );
    }
    svg.line((beam, (beam.0, beam.1 + 100.0)), GREY, 0.7, "");

    // u, from the baseline to the axis.
    let foot = (slit.0, slit.1 + 70.0);
    svg.line((slit, (slit.0, slit.1 + 84.0)), GREY, 0.7, "");
    let (sin, cos) = geometry.angle.sin_cos();
    let end = (slit.0 + 70.0 * sin, slit.1 + 70.0 * cos);
    let _ = writeln!(
        svg.0,
        r#"<path d="M{:.1},{:.1} A70,70 0 0 0 {:.1},{:.1}" fill="none" stroke="{GREY}" marker-end="url(#arrow)"/>"#,
        foot.0, foot.1, end.0, end.1
    );
    let angle = format!("u = {:.2}°", geometry.angle.to_degrees());
    svg.text((foot.0 + 12.0, foot.1 + 22.0), "start", &angle);
}

/// Slit and sensor, larger: the axis lies level.
fn draw_slit_and_sensor(svg: &mut Svg, design: &Design) {
    let (geometry, options) = (&design.geometry, &design.options);
    let half = 0.5 * geometry.pixels as f64 * geometry.pitch;
    let scale = (90.0 / half).min(190.0 / geometry.focal);
    let middle = (630.0, 150.0);
    // Along the axis from the slit, to the left towards the target, and along the row, upwards.
    let place = |along: f64, beside: f64| (middle.0 + scale * along, middle.1 - scale * beside);
    let _ = writeln!(
        svg.0,
        r##"<rect x="330" y="14" width="660" height="262" fill="#fafafa" stroke="#bbbbbb"/>"##
    );
    let f = geometry.focal;
    svg.line((place(-22.0, 0.0), place(f, 0.0)), GREY, 1.0, BROKEN);
    for (distance, name) in [(options.near, "nearest"), (options.far, "farthest")] {
        let pixel = geometry.centre(distance);
        let x = (pixel - geometry.axis) * geometry.pitch;
        // The light comes from the other side of the axis.
        svg.line((place(-22.0, -x * 22.0 / f), place(f, x)), LIGHT, 1.2, "");
        let (at, words) = (place(f, x), format!("{name}: pixel {pixel:.0}"));
        svg.text((at.0 + 12.0, at.1 + 5.0), "start", &words);
    }
    // The mask has a gap.
    for side in [-1.0, 1.0] {
        let ends = (place(0.0, side * 0.4), place(0.0, side * half));
        svg.line(ends, INK, 4.0, "");
    }
    svg.line((place(f, -half), place(f, half)), INK, 6.0, "");
    let (top, bottom) = (place(f, half), place(f, -half));
    let last = format!("pixel {}", geometry.pixels - 1);
    svg.text((top.0 + 12.0, top.1 + 6.0), "start", &last);
    svg.text((bottom.0 + 12.0, bottom.1 + 8.0), "start", "pixel 0");
    svg.text((top.0, top.1 - 20.0), "middle", "TCD1304DG");
    let slit = match options.comb {
        true => "comb of 16 slits, each 200 um x 3 mm".to_owned(),
        false => format!("slit {} um x 3 mm", options.slit),
    };
    svg.text((middle.0, place(0.0, half).1 - 20.0), "middle", &slit);
    let below = place(0.0, -half).1 + 18.0;
    svg.dimension(
        ((middle.0, below), (middle.0 + scale * f, below)),
        &format!("f = {f} mm"),
        ((middle.0 + 0.5 * scale * f, below - 7.0), "middle"),
    );
    let (sin, cos) = geometry.angle.sin_cos();
    svg.text((344.0, 40.0), "start", "slit and sensor");
    for (line, text) in [
        "from the slit to the".to_owned(),
        "middle of the row:".to_owned(),
        format!("{:.2} mm away from", f * cos),
        "the beam,".to_owned(),
        format!("{:.2} mm back", f * sin),
        format!("pixels of {:.0} um,", 1000.0 * geometry.pitch),
        "at right angles".to_owned(),
        "to the axis".to_owned(),
    ]
    .iter()
    .enumerate()
    {
        svg.text((344.0, 76.0 + 22.0 * line as f64), "start", text);
    }
}
