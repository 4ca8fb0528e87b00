//! `cargo timing`: the pulses of a row, as the firmware gives them on the virtual board, and their drawing.

use virtual_board::sensor_head::{Edge, Level, limits};
use virtual_board::{Nanos, PIXELS};

use crate::docs;
use crate::prelude::*;
use crate::svg::Svg;

pub const FIGURE: &str = "docs/hardware/timing.svg";

pub const PAGE: &str = "docs/hardware.md";

/// The mark of its table on the page.
pub const TOOL: &str = "cargo timing";

/// Runs the firmware on the virtual board and draws the pulses of a row.
#[derive(Args)]
pub struct Options {
    /// Rewrite docs/hardware/timing.svg, and the table in docs/hardware.md
    #[arg(long)]
    write: bool,
}

pub fn main(options: &Options) -> Result<()> {
    let pulses = Pulses::of_a_row()?;
    let block = (TOOL, pulses.markdown());
    docs::print_or_write("cargo timing", options.write, PAGE, &[block])?;
    if options.write {
        std::fs::write(docs::path(FIGURE), pulses.svg())?;
    }
    Ok(())
}

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
    words: Vec<f64>,
    laser: (f64, f64),
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
    pub fn of_a_row() -> Result<Self> {
        let firmware = Firmware::build()?;
        let mut board = VirtualBoard::power_on(&firmware, Box::new(|_: &_| vec![300.0; PIXELS]))?;
        board.run_until_rows(ROWS_BEFORE, Duration::from_secs(2))?;
        board.head(|head| head.record_edges());
        board.run_for(Duration::from_millis(18))?;
        let (edges, lasers, sampled) = board.head(|head| {
            let sampled = head.last_row().map(|row| row.phase.0);
            let lasers: Vec<_> = head.laser_pulses().cloned().collect();
            (head.take_edges(), lasers, sampled)
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
        let all = |wanted: Edge| {
            let same = row.iter().filter(move |(_, edge)| *edge == wanted);
            same.map(|(at, _)| *at)
        };
        let at = |wanted| all(wanted).next();
        let laser = lasers.iter().find(|pulse| pulse.start > start)?;
        Some(Self {
            sh_rose: at(Edge::Sh(Level::High))?,
            sh_fell: at(Edge::Sh(Level::Low))?,
            chip_select_fell: at(Edge::ChipSelect(Level::Low))?,
            chip_select_rose: at(Edge::ChipSelect(Level::High))?,
            icg_rose: at(Edge::Icg(Level::High))?,
            master_clock_rose: at(Edge::MasterClockRose)?,
            words: all(Edge::WordEnded).take(WORDS).collect(),
            laser: ((laser.start - start) as f64, (laser.end - start) as f64),
            next_row: (next_row - start) as f64,
            sampled,
        })
    }

    /// The table of the page: what each time is, the time, and its limit.
    pub fn markdown(&self) -> String {
        let us = |ns: f64| format!("{:.1} us", 1e-3 * ns);
        let ms = |ns: f64| format!("{:.2} ms", 1e-6 * ns);
        let below_a_tenth = |ns: f64| match ns < 100.0 {
            true => "below 0.1 us".to_owned(),
            false => us(ns),
        };
        let select = self.chip_select_rose - self.chip_select_fell;
        let (from, to) = (limits::SH_AFTER_ICG.start(), limits::SH_AFTER_ICG.end());
        let [sh_high, sh_icg] = [limits::SH_HIGH, limits::ICG_AFTER_SH];
        let rows = [
            ("from the fall of ICG to the rise of SH", us(self.sh_rose)),
            ("SH is high", us(self.sh_fell - self.sh_rose)),
            (
                "from the fall of SH to the rise of ICG",
                us(self.icg_rose - self.sh_fell),
            ),
            ("ICG is low", us(self.icg_rose)),
            (
                "from the rise of fM to the rise of ICG",
                below_a_tenth(self.icg_rose - self.master_clock_rose),
            ),
            (
                "from the fall of ICG to that of chip select",
                us(self.chip_select_fell),
            ),
            ("chip select is low", ms(select)),
            ("a pixel is sampled", ten_percent_around(self.sampled)),
            ("from the fall of ICG to the laser", us(self.laser.0)),
            (
                "the laser is on, longest exposure",
                ms(self.laser.1 - self.laser.0),
            ),
            ("from row to row", ms(self.next_row)),
        ];
        let limits = [
            &format!("TCD1304 t2: {from} to {to} ns"),
            &format!("t3: {sh_high} ns or more"),
            &format!("t1: {sh_icg} ns or more"),
            "t1 to t3",
            "t4: while fM is high, 0.19 us",
            "after SH",
            &format!("{PIXELS} words of 1.52 us"),
            "of its time: when it has settled",
            "after SH",
            "10 us to 5.6 ms",
            "5.7 ms",
        ];
        let lines = rows.into_iter().zip(limits);
        let lines = lines.map(|((name, time), limit)| format!("| {name} | {time} | {limit} |\n"));
        "| time | virtual board | limit, or what it is |\n|---|---|---|\n".to_owned()
            + &lines.collect::<String>()
    }

    pub fn svg(&self) -> String {
        let title = "The pulses of a row, from a row on the virtual board";
        let mut svg = Svg::new([1000.0, 720.0], 15, title);
        let head = "The pulses at the start of a row, from a row on the virtual board";
        svg.text([20.0, 28.0], r#"font-size="17""#, head);
        let head = "A whole row: 5.7 ms from fall to fall of ICG";
        svg.text([20.0, 506.0], r#"font-size="17""#, head);
        self.draw_start(&mut svg);
        svg.add(WHOLE_ROW);
        self.draw_row(&mut svg);
        svg.add("</g>");
        svg.end()
    }

    fn draw_start(&self, svg: &mut Svg) {
        let panel = Panel {
            from: -1000.0,
            to: 15_900.0,
            top: 50.0,
            bottom: 444.0,
        };
        let ticks = (0..=15).map(|us| (1000.0 * f64::from(us), us));
        panel.ticks(svg, ticks, "us");
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
        let words = (0..).zip(&self.words);
        let words = words.map(|(i, end)| (end - PIXEL, format!("word {i}")));
        panel.cells(svg, 5, "SPI, PA5 PA6", words);
        let outputs = (0..4).map(|i| (self.icg_rose + f64::from(i) * PIXEL, format!("D{i}")));
        panel.cells(svg, 6, "sensor's output", outputs);
        for end in &self.words {
            panel.mark(svg, held(*end));
        }
        let place = [panel.x(held(self.words[0])), panel.low(5) - HIGH - 6.0];
        svg.text(place, r##"fill="#d62728" text-anchor="middle""##, "sampled");
    }

    fn draw_row(&self, svg: &mut Svg) {
        let panel = Panel {
            from: -200e3,
            to: 5.95e6,
            top: 518.0,
            bottom: 688.0,
        };
        let ticks = (0..=5).map(|ms| (1e6 * f64::from(ms), ms));
        panel.ticks(svg, ticks, "ms");
        let again = |at: f64| at + self.next_row;
        let twice = |rise: f64, fall: f64| [rise, fall, again(rise), again(fall)];
        let select = [
            self.chip_select_fell,
            self.chip_select_rose,
            again(self.chip_select_fell),
        ];
        let laser = [self.laser.0, self.laser.1, again(self.laser.0)];
        panel.signal(svg, 0, "ICG", true, &twice(0.0, self.icg_rose));
        panel.signal(svg, 1, "SH", false, &twice(self.sh_rose, self.sh_fell));
        panel.signal(svg, 2, "CS", true, &select);
        panel.signal(svg, 3, "laser", false, &laser);
    }
}

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

    fn low(&self, signal: usize) -> f64 {
        let step = STEP.min((self.bottom - self.top - 10.0) / 4.0);
        self.top + step * (signal as f64 + 1.0) - 6.0
    }

    fn high(&self) -> f64 {
        HIGH.min(0.6 * (self.bottom - self.top) / 4.0)
    }

    fn ticks(&self, svg: &mut Svg, ticks: impl Iterator<Item = (f64, i32)>, unit: &str) {
        for (at, number) in ticks {
            let x = self.x(at);
            svg.line([x, self.top], [x, self.bottom], r##"stroke="#dddddd""##);
            let text = format!("{number} {unit}");
            svg.text([x, self.bottom + 18.0], r#"text-anchor="middle""#, text);
        }
    }

    /// A signal that is high or low at first, and changes at each edge.
    fn signal(&self, svg: &mut Svg, number: usize, name: &str, high: bool, edges: &[f64]) {
        let (low, up) = (self.low(number), self.low(number) - self.high());
        let mut is_high = high;
        let mut path = format!("M{LEFT:.1},{:.1}", if is_high { up } else { low });
        for edge in edges.iter().filter(|edge| **edge < self.to) {
            is_high = !is_high;
            let level = if is_high { up } else { low };
            path += &format!(" H{:.1} V{level:.1}", self.x(*edge));
        }
        svg.add(format_args!(
            r##"<path d="{path} H{RIGHT:.1}" fill="none" stroke="#1f77b4" stroke-width="2"/>"##
        ));
        svg.text([LEFT - 10.0, low - 4.0], r#"text-anchor="end""#, name);
    }

    fn cells(
        &self,
        svg: &mut Svg,
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
            svg.add(format_args!(
                r##"<rect x="{from:.1}" y="{:.1}" width="{:.1}" height="{HIGH}" fill="#eef4fa" stroke="#1f77b4"/>"##,
                low - HIGH,
                to - from,
            ));
            let middle = [0.5 * (from + to), low - 9.0];
            svg.text(middle, r#"text-anchor="middle""#, text);
        }
        svg.text([LEFT - 10.0, low - 9.0], r#"text-anchor="end""#, name);
    }

    /// A time between two edges, below a signal. `side` moves the text in its own width.
    fn dimension(&self, svg: &mut Svg, number: usize, ends: (f64, f64), name: &str, side: f64) {
        let y = self.low(number) + 6.0;
        let (from, to) = (self.x(ends.0), self.x(ends.1));
        svg.add(format_args!(
            r##"<path d="M{from:.1},{:.1} v10 m0,-5 H{to:.1} m0,-5 v10" fill="none" stroke="#666666"/>"##,
            y - 5.0,
        ));
        let style = r##"text-anchor="middle" font-size="13" fill="#666666""##;
        svg.text([0.5 * (from + to) + 24.0 * side, y + 17.0], style, name);
    }

    fn mark(&self, svg: &mut Svg, at: f64) {
        let x = self.x(at);
        if x < RIGHT {
            let style = r##"stroke="#d62728" stroke-width="1.5" stroke-dasharray="4 3""##;
            svg.line([x, self.low(5) - HIGH], [x, self.low(6) + 12.0], style);
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
