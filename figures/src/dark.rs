//! Colours that are dark enough for text on white.

use plotters::style::RGBColor;

/// What was measured, and the first of several lines.
pub const BLUE: RGBColor = RGBColor(0x15, 0x55, 0xd0);
/// What was fitted to it, or rejected.
pub const RED: RGBColor = RGBColor(0xc6, 0x20, 0x20);
/// Further lines.
pub const GREEN: RGBColor = RGBColor(0x2a, 0x78, 0x2e);
/// Further lines.
pub const PURPLE: RGBColor = RGBColor(0x7a, 0x1b, 0xaa);
/// Further lines.
pub const ORANGE: RGBColor = RGBColor(0xb3, 0x59, 0x00);
/// Levels and marks.
pub const GREY: RGBColor = RGBColor(0x77, 0x77, 0x77);
