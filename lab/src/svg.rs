//! A drawing under way, as SVG.

use std::fmt::Display;

/// The text of a file whose last tag is still to come.
pub struct Svg(pub String);

impl Svg {
    /// An empty drawing of a size in pixels, on white.
    pub fn new([width, height]: [f64; 2], font_size: u32, title: &str) -> Self {
        Self(format!(
            r##"<svg width="{width}" height="{height}" viewBox="0 0 {width} {height}" xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="{font_size}" fill="#222222">
<title>{title}</title>
<rect width="{width}" height="{height}" fill="#ffffff"/>
"##
        ))
    }

    pub fn add(&mut self, line: impl Display) {
        self.0 += &format!("{line}\n");
    }

    pub fn line(&mut self, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2], style: &str) {
        self.add(format_args!(
            r#"<line x1="{x1:.2}" y1="{y1:.2}" x2="{x2:.2}" y2="{y2:.2}" {style}/>"#
        ));
    }

    pub fn text(&mut self, [x, y]: [f64; 2], style: &str, text: impl Display) {
        self.add(format_args!(
            r#"<text x="{x:.2}" y="{y:.2}" {style}>{text}</text>"#
        ));
    }

    pub fn end(self) -> String {
        self.0 + "</svg>\n"
    }
}

pub fn points(places: impl IntoIterator<Item = [f64; 2]>) -> String {
    let places = places.into_iter().map(|[x, y]| format!("{x:.2},{y:.2}"));
    places.collect::<Vec<_>>().join(" ")
}
