//! The pulses of a row, as the firmware gives them on the virtual board, and their drawing.

use std::fmt::Write as _;
use std::time::Duration;

use anyhow::{Context, Result};
use virtual_board::sensor_head::{Edge, Level, limits};
use virtual_board::{Firmware, Nanos, PIXELS, VirtualBoard};

/// The drawing.
pub const FIGURE: &str = "docs/hardware/timing.svg";

/// The page that shows it.
pub const PAGE: &str = "docs/hardware.md";

/// The mark of its table on the page.
pub const TOOL: &str = "cargo timing";

/// Rows before the one that is drawn. The first ones choose the rise of ICG anew.
const ROWS_BEFORE: u64 = 20;

/// The pulses of a row in nanoseconds, from the fall of ICG.
#[derive(Clone, Debug)]
pub struct Pulses {
    pub(crate) sh_rose: f64,
    pub(crate) sh_fell: f64,
    chip_select_fell: f64,
    chip_select_rose: f64,
    pub(crate) icg_rose: f64,
    /// The rise of fM before the rise of ICG.
    pub(crate) master_clock_rose: f64,
    /// The ends of the first words.
    words: Vec<f64>,
    /// When the laser goes on and off.
    laser: (f64, f64),
    /// The fall of ICG for the next row.
    next_row: f64,
    /// The part of a pixel's time at which the converter holds it.
    sampled: f64,
}

/// The words of which the ends are kept.
const WORDS: usize = 7;

/// fM's period, SCLK's period, and the time of a pixel, which is that of a word, in nanoseconds.
pub(crate) const MASTER_CLOCK: f64 = 1e9 / 2.625e6;
const SERIAL_CLOCK: f64 = 1e9 / 10.5e6;
const PIXEL: f64 = 4.0 * MASTER_CLOCK;

/// The start tag of the lower picture.
pub(crate) const WHOLE_ROW: &str = r#"<g id="whole-row">"#;

/// When the converter holds its input for a word that ends at `end`, in nanoseconds.
fn held(end: f64) -> f64 {
    end - (f64::from(limits::WORD_BITS) - limits::HOLD_AFTER) * SERIAL_CLOCK
}

/// The ten percent in which a part of 0 to 1 lies: from 70 % to below 80 % for 0.7.
fn ten_percent_around(part: f64) -> String {
    let from = 10.0 * (10.0 * part).floor();
    format!("{from:.0} to {:.0} %", from + 10.0)
}

impl Pulses {
    /// Runs the firmware on the virtual board until it has read some rows in the dark.
    ///
    /// # Errors
    /// The firmware cannot be built, or violates a limit of the sensor head.
    pub fn of_a_row() -> Result<Self> {
        let firmware = Firmware::build()?;
        let dark = Box::new(|_: &_| vec![300.0; PIXELS]);
        let mut board = VirtualBoard::power_on(&firmware, dark)?;
        board.run_until_rows(ROWS_BEFORE, Duration::from_secs(2))?;
        board.head(|head| head.record_edges());
        board.run_for(Duration::from_millis(18))?;
        let (edges, lasers, sampled) = board.head(|head| {
            let sampled = head.last_row().map(|row| row.phase.0);
            (
                head.take_edges(),
                head.laser_pulses().cloned().collect::<Vec<_>>(),
                sampled,
            )
        });
        board.finish()?;
        Self::of(&edges, &lasers, sampled.context("no row")?).context("no whole row")
    }

    fn of(
        edges: &[(Nanos, Edge)],
        lasers: &[std::ops::Range<Nanos>],
        sampled: f64,
    ) -> Option<Self> {
        let falls: Vec<usize> = (0..edges.len())
            .filter(|&i| edges[i].1 == Edge::Icg(Level::Low))
            .collect();
        let (start, next_row) = (edges.get(*falls.first()?)?.0, edges.get(*falls.get(1)?)?.0);
        let row: Vec<(f64, Edge)> = (edges.iter())
            .filter(|(at, _)| (start..next_row).contains(at))
            .map(|&(at, edge)| ((at - start) as f64, edge))
            .collect();
        let at = |wanted: Edge| {
            row.iter()
                .find(|(_, edge)| *edge == wanted)
                .map(|(at, _)| *at)
        };
        let laser = lasers.iter().find(|pulse| pulse.start > start)?;
        Some(Self {
            sh_rose: at(Edge::Sh(Level::High))?,
            sh_fell: at(Edge::Sh(Level::Low))?,
            chip_select_fell: at(Edge::ChipSelect(Level::Low))?,
            chip_select_rose: at(Edge::ChipSelect(Level::High))?,
            icg_rose: at(Edge::Icg(Level::High))?,
            master_clock_rose: at(Edge::MasterClockRose)?,
            words: (row.iter())
                .filter(|(_, edge)| *edge == Edge::WordEnded)
                .map(|(at, _)| *at)
                .take(WORDS)
                .collect(),
            laser: ((laser.start - start) as f64, (laser.end - start) as f64),
            next_row: (next_row - start) as f64,
            sampled,
        })
    }

    /// What each time is, the time, and its limit.
    pub fn times(&self) -> Vec<(&'static str, String, String)> {
        let us = |ns: f64| format!("{:.1} us", 1e-3 * ns);
        let ms = |ns: f64| format!("{:.2} ms", 1e-6 * ns);
        let below_a_tenth = |ns: f64| match ns < 100.0 {
            true => "below 0.1 us".to_owned(),
            false => us(ns),
        };
        let (from, to) = (limits::SH_AFTER_ICG.start(), limits::SH_AFTER_ICG.end());
        vec![
            (
                "from the fall of ICG to the rise of SH",
                us(self.sh_rose),
                format!("TCD1304 t2: {from} to {to} ns"),
            ),
            (
                "SH is high",
                us(self.sh_fell - self.sh_rose),
                format!("t3: {} ns or more", limits::SH_HIGH),
            ),
            (
                "from the fall of SH to the rise of ICG",
                us(self.icg_rose - self.sh_fell),
                format!("t1: {} ns or more", limits::ICG_AFTER_SH),
            ),
            ("ICG is low", us(self.icg_rose), "t1 to t3".to_owned()),
            (
                "from the rise of fM to the rise of ICG",
                below_a_tenth(self.icg_rose - self.master_clock_rose),
                "t4: while fM is high, 0.19 us".to_owned(),
            ),
            (
                "from the fall of ICG to that of chip select",
                us(self.chip_select_fell),
                "while SH is high".to_owned(),
            ),
            (
                "chip select is low",
                ms(self.chip_select_rose - self.chip_select_fell),
                format!("{PIXELS} words of 1.52 us"),
            ),
            (
                "a pixel is sampled",
                ten_percent_around(self.sampled),
                "of its time: when it has settled".to_owned(),
            ),
            (
                "from the fall of ICG to the laser",
                us(self.laser.0),
                "after SH".to_owned(),
            ),
            (
                "the laser is on, longest exposure",
                ms(self.laser.1 - self.laser.0),
                "10 us to 5.6 ms".to_owned(),
            ),
            ("from row to row", ms(self.next_row), "5.7 ms".to_owned()),
        ]
    }

    /// The table of the page.
    pub fn markdown(&self) -> String {
        let lines = self.times().into_iter();
        let lines = lines.map(|(name, time, limit)| format!("| {name} | {time} | {limit} |\n"));
        "| time | virtual board | limit, or what it is |\n|---|---|---|\n".to_owned()
            + &lines.collect::<String>()
    }

    /// The drawing.
    pub fn svg(&self) -> String {
        let mut svg = r##"<svg width="1000" height="720" viewBox="0 0 1000 720" xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="15" fill="#222222">
<title>The pulses of a row, from a row on the virtual board</title>
<rect width="1000" height="720" fill="#ffffff"/>
<text x="20" y="28" font-size="17">The pulses at the start of a row, from a row on the virtual board</text>
<text x="20" y="506" font-size="17">A whole row: 5.7 ms from fall to fall of ICG</text>
"##
        .to_owned();
        self.draw_start(&mut svg);
        let _ = writeln!(svg, "{WHOLE_ROW}");
        self.draw_row(&mut svg);
        svg + "</g>\n</svg>\n"
    }

    fn draw_start(&self, svg: &mut String) {
        let panel = Panel {
            from: -1000.0,
            to: 10_900.0,
            top: 50.0,
            bottom: 444.0,
        };
        panel.ticks(
            svg,
            (0..=10).map(|us| (1000.0 * f64::from(us), format!("{us}"))),
            "us",
        );
        let fm: Vec<f64> = (-60..60)
            .map(|half| self.master_clock_rose + 0.5 * MASTER_CLOCK * f64::from(half))
            .filter(|at| (panel.from..panel.to).contains(at))
            .collect();
        // An even number of half periods from a rise is a rise.
        let halves = (fm[0] - self.master_clock_rose) / (0.5 * MASTER_CLOCK);
        let fm_high = (halves.round() as i64).rem_euclid(2) != 0;
        panel.signal(svg, 0, "fM, PE9", fm_high, &fm);
        panel.signal(svg, 1, "ICG, PF12", true, &[0.0, self.icg_rose]);
        panel.signal(svg, 2, "SH, PF13", false, &[self.sh_rose, self.sh_fell]);
        panel.signal(svg, 3, "CS, PD14", true, &[self.chip_select_fell]);
        panel.signal(svg, 4, "laser, PD15", false, &[self.laser.0]);
        panel.dimension(svg, 2, (0.0, self.sh_rose), "t2", -1.0);
        panel.dimension(svg, 2, (self.sh_rose, self.sh_fell), "t3", 0.0);
        panel.dimension(svg, 2, (self.sh_fell, self.icg_rose), "t1", 0.0);
        let words = self
            .words
            .iter()
            .enumerate()
            .map(|(i, &end)| (end - PIXEL, format!("word {i}")));
        panel.cells(svg, 5, "SPI, PA5 PA6", words);
        let outputs = (0..4).map(|i| (self.icg_rose + f64::from(i) * PIXEL, format!("D{i}")));
        panel.cells(svg, 6, "sensor's output", outputs);
        for end in &self.words {
            panel.mark(svg, held(*end));
        }
        let _ = writeln!(
            svg,
            r##"<text x="{:.0}" y="{:.0}" fill="#d62728" text-anchor="middle">sampled</text>"##,
            panel.x(held(self.words[0])),
            panel.low(5) - HIGH - 6.0
        );
    }

    fn draw_row(&self, svg: &mut String) {
        let panel = Panel {
            from: -200e3,
            to: 5.95e6,
            top: 518.0,
            bottom: 688.0,
        };
        panel.ticks(
            svg,
            (0..=5).map(|ms| (1e6 * f64::from(ms), format!("{ms}"))),
            "ms",
        );
        let again = |at: f64| at + self.next_row;
        panel.signal(
            svg,
            0,
            "ICG",
            true,
            &[0.0, self.icg_rose, again(0.0), again(self.icg_rose)],
        );
        panel.signal(
            svg,
            1,
            "SH",
            false,
            &[
                self.sh_rose,
                self.sh_fell,
                again(self.sh_rose),
                again(self.sh_fell),
            ],
        );
        panel.signal(
            svg,
            2,
            "CS",
            true,
            &[
                self.chip_select_fell,
                self.chip_select_rose,
                again(self.chip_select_fell),
            ],
        );
        panel.signal(
            svg,
            3,
            "laser",
            false,
            &[self.laser.0, self.laser.1, again(self.laser.0)],
        );
    }
}

/// A panel with a time axis and signals below each other.
struct Panel {
    /// Nanoseconds at the left end and at the right end.
    from: f64,
    to: f64,
    top: f64,
    bottom: f64,
}

const LEFT: f64 = 150.0;
const RIGHT: f64 = 985.0;
const STEP: f64 = 54.0;
const HIGH: f64 = 28.0;

impl Panel {
    fn x(&self, ns: f64) -> f64 {
        LEFT + (RIGHT - LEFT) * (ns - self.from) / (self.to - self.from)
    }

    /// The line of a signal's low level.
    fn low(&self, signal: usize) -> f64 {
        let step = STEP.min((self.bottom - self.top - 10.0) / 4.0);
        self.top + step * (signal as f64 + 1.0) - 6.0
    }

    fn high(&self) -> f64 {
        HIGH.min(0.6 * (self.bottom - self.top) / 4.0)
    }

    fn ticks(&self, svg: &mut String, ticks: impl Iterator<Item = (f64, String)>, unit: &str) {
        for (at, text) in ticks {
            let x = self.x(at);
            let _ = writeln!(
                svg,
                r##"<line x1="{x:.1}" y1="{:.0}" x2="{x:.1}" y2="{:.0}" stroke="#dddddd"/>
<text x="{x:.1}" y="{:.0}" text-anchor="middle">{text} {unit}</text>"##,
                self.top,
                self.bottom,
                self.bottom + 18.0
            );
        }
    }

    /// A signal that is high or low at first, and changes at each edge.
    fn signal(&self, svg: &mut String, number: usize, name: &str, high: bool, edges: &[f64]) {
        let level = |high: bool| {
            if high {
                self.low(number) - self.high()
            } else {
                self.low(number)
            }
        };
        let mut is_high = high;
        let mut path = format!("M{LEFT:.1},{:.1}", level(is_high));
        for edge in edges.iter().filter(|edge| **edge < self.to) {
            let x = self.x(*edge);
            let _ = write!(path, " H{x:.1} V{:.1}", level(!is_high));
            is_high = !is_high;
        }
        let _ = writeln!(
            svg,
            r##"<path d="{path} H{RIGHT:.1}" fill="none" stroke="#1f77b4" stroke-width="2"/>
<text x="{:.0}" y="{:.1}" text-anchor="end">{name}</text>"##,
            LEFT - 10.0,
            self.low(number) - 4.0
        );
    }

    /// A row of cells that begin at these times.
    fn cells(
        &self,
        svg: &mut String,
        number: usize,
        name: &str,
        cells: impl Iterator<Item = (f64, String)>,
    ) {
        let low = self.low(number);
        for (start, text) in cells {
            let (from, to) = (self.x(start), self.x(start + PIXEL));
            if to > RIGHT {
                continue;
            }
            let _ = writeln!(
                svg,
                r##"<rect x="{from:.1}" y="{:.1}" width="{:.1}" height="{HIGH}" fill="#eef4fa" stroke="#1f77b4"/>
<text x="{:.1}" y="{:.1}" text-anchor="middle">{text}</text>"##,
                low - HIGH,
                to - from,
                0.5 * (from + to),
                low - 9.0
            );
        }
        let _ = writeln!(
            svg,
            r##"<text x="{:.0}" y="{:.1}" text-anchor="end">{name}</text>"##,
            LEFT - 10.0,
            low - 9.0
        );
    }

    /// A time between two edges, below a signal. `side` moves the text in its own width.
    fn dimension(
        &self,
        svg: &mut String,
        number: usize,
        (from, to): (f64, f64),
        name: &str,
        side: f64,
    ) {
        let y = self.low(number) + 6.0;
        let (from, to) = (self.x(from), self.x(to));
        let text = 0.5 * (from + to) + 24.0 * side;
        let _ = writeln!(
            svg,
            r##"<path d="M{from:.1},{:.1} v10 m0,-5 H{to:.1} m0,-5 v10" fill="none" stroke="#666666"/>
<text x="{text:.1}" y="{:.1}" text-anchor="middle" font-size="13" fill="#666666">{name}</text>"##,
            y - 5.0,
            y + 17.0
        );
    }

    /// The moment at which the converter holds its input.
    fn mark(&self, svg: &mut String, at: f64) {
        let x = self.x(at);
        if x < RIGHT {
            let _ = writeln!(
                svg,
                r##"<line x1="{x:.1}" y1="{:.1}" x2="{x:.1}" y2="{:.1}" stroke="#d62728" stroke-width="1.5" stroke-dasharray="4 3"/>"##,
                self.low(5) - HIGH,
                self.low(6) + 12.0
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::ten_percent_around;

    #[test]
    fn a_part_lies_in_ten_percent() {
        for (part, text) in [
            (0.7, "70 to 80 %"),
            (0.69, "60 to 70 %"),
            (0.0, "0 to 10 %"),
            (0.999, "90 to 100 %"),
        ] {
            assert_eq!(ten_percent_around(part), text);
        }
    }
}
