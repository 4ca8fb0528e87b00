//! The steps of whole rows: a bar an estimator, in a panel each for following, first and slowest rows.

use cost_on_chip::methods::Method;
use figures::axes::{self, Area, Axis, Scale, TEXT, TITLE, panel, text};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::style::{CHARACTER, bold, is_default};
use crate::prelude::*;
use crate::programs::cost::chip::steps::{NAMES, Steps};
use crate::programs::cost::report::Measured;

/// The colours of the steps in their order. Grey is for instructions that are no step of a row.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0x9e, 0xb9, 0xd9),
    RGBColor(0x3b, 0x75, 0xaf),
    RGBColor(0xd6, 0x5a, 0x31),
    RGBColor(0xf0, 0xb7, 0x4f),
    RGBColor(0x7a, 0x9a, 0x60),
    RGBColor(0x80, 0x80, 0x80),
    RGBColor(0x80, 0x80, 0x80),
];

const TITLES: [&str; 3] = [
    "A row that follows another of its frame",
    "The first row of a frame",
    "The slowest row that we know",
];

/// Pixels for the estimators' names, and for the figures beside the bars.
const BESIDE: u32 = 70;
const FIGURES: i32 = 140;

pub fn draw(measured: &Measured, path: &Path) -> anyhow::Result<()> {
    let root = axes::figure(path, 900)?;
    let root = root.titled(
        "From a row's words to its centre with its check: instructions by step",
        bold(TITLE, BLACK),
    )?;
    let (legend, root) = root.split_vertically(2 * TEXT + 14);
    let rows = &measured.chip.whole_rows;
    draw_legend(&legend, measured)?;
    for (i, area) in root.split_evenly((TITLES.len(), 1)).iter().enumerate() {
        let bars: Vec<(Estimator, &Steps)> = Estimator::ALL
            .into_iter()
            .filter_map(|estimator| Some((estimator, rows.kinds(estimator)[i]?)))
            .collect();
        draw_bars(area, TITLES[i], &bars)?;
    }
    Ok(root.present()?)
}

fn draw_legend(area: &Area<'_>, measured: &Measured) -> anyhow::Result<()> {
    let (mut x, y) = (24, 4);
    for (name, colour) in NAMES.into_iter().zip(COLOURS).take(5) {
        let corners = [(x, y), (x + TEXT, y + TEXT - 2)];
        area.draw(&Rectangle::new(corners, colour.filled()))?;
        area.draw(&Text::new(name, (x + TEXT + 6, y), text(TEXT, BLACK)))?;
        let characters = name.len() as f64;
        x += TEXT + 34 + (characters * CHARACTER * f64::from(TEXT)) as i32;
    }
    if let Some([mean, distance]) = measured.chip.whole_rows.once_a_frame() {
        let label = format!("once a frame: mean {mean}, distance {distance}");
        area.draw(&Text::new(label, (24, y + TEXT + 6), text(TEXT, BLACK)))?;
    }
    Ok(())
}

fn draw_bars(area: &Area<'_>, title: &str, bars: &[(Estimator, &Steps)]) -> anyhow::Result<()> {
    let most = bars.iter().map(|(_, row)| row.total()).max();
    let most = most.unwrap_or(1) as f64;
    let x = Axis::linear((0.0, most * 1.02), "instructions", 6, 0);
    let heights = (0.0, bars.len().max(1) as f64);
    let y = Axis::new(Scale::Linear, heights, "", &[], |_| String::new());
    let inside = area.margin(0, 0, BESIDE, 0);
    let mut panel = panel(&inside, title, FIGURES, &x, &y)?;
    for (place, (_, row)) in bars.iter().enumerate() {
        let [top, bottom] = [0.15, 0.85].map(|part| bars.len() as f64 - place as f64 - part);
        let mut from = 0.0;
        for (colour, instructions) in COLOURS.into_iter().zip(row.0) {
            let to = from + instructions as f64;
            panel.draw_series([Rectangle::new([(from, top), (to, bottom)], colour.filled())])?;
            from = to;
        }
    }
    let (left, top) = area.get_base_pixel();
    for (place, (estimator, row)) in bars.iter().enumerate() {
        let middle = bars.len() as f64 - place as f64 - 0.5;
        let [(left_end, y), (right_end, _)] =
            [0.0, most * 1.02].map(|x| panel.backend_coord(&(x, middle)));
        let style = match is_default(Method::Estimator(*estimator)) {
            true => bold(TEXT, BLACK),
            false => text(TEXT, BLACK),
        };
        for (x, side, label) in [
            (left_end - 8, HPos::Right, estimator.name().to_owned()),
            (right_end + 8, HPos::Left, row.total().to_string()),
        ] {
            let style = style.clone().pos(Pos::new(side, VPos::Center));
            area.draw(&Text::new(label, (x - left, y - top), style))?;
        }
    }
    Ok(())
}
