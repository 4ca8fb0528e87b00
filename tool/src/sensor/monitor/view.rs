//! The live view of `monitor`.

use std::time::Duration;

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style};
use ratatui::text::Line;
use ratatui::widgets::{Axis, Block, Chart, Paragraph, Wrap};
use statistics::least_and_most;
use tui_big_text::{BigText, PixelSize};

use super::statistics::Statistics;
use crate::screen::line;
use crate::sensor::stream::FrameResult;

/// What the view shows.
pub struct View<'a> {
    /// The sensor head and its port.
    pub title: &'a str,
    /// The time since `monitor` began.
    pub now: Duration,
    /// The latest result.
    pub latest: Option<&'a FrameResult>,
    /// What to say instead of a result: the sensor is away.
    pub away: Option<&'a str>,
    /// All results.
    pub statistics: &'a Statistics,
    /// The rows that the sensor lost since `monitor` began, and the lines that it dropped.
    pub lost: Option<(u32, u32)>,
    /// The file that is written, and its lines.
    pub recording: Option<(&'a str, u64)>,
}

/// The columns of the statistics.
const STATISTICS: u16 = 36;

impl View<'_> {
    /// Draws it.
    pub fn draw(&self, frame: &mut Frame<'_>) {
        let block = Block::bordered().title(format!(" {} ", self.title));
        let area = block.inner(frame.area());
        frame.render_widget(block.title_bottom(" q quits "), frame.area());
        let heights = [
            Constraint::Length(5),
            Constraint::Length(2),
            Constraint::Min(3),
        ];
        let [value, middle, below] = Layout::vertical(heights).areas(area);
        self.draw_value(frame, value);
        let has_reading = |it: &&FrameResult| self.away.is_none() && it.distance_mm.is_some();
        let text = self.latest.filter(has_reading).map(details);
        let text = Paragraph::new(text.unwrap_or_default()).wrap(Wrap { trim: true });
        frame.render_widget(text, middle);
        let [trend, statistics] =
            Layout::horizontal([Constraint::Min(10), Constraint::Length(STATISTICS)]).areas(below);
        self.draw_trend(frame, trend);
        frame.render_widget(Paragraph::new(self.statistics()), statistics);
    }

    /// The distance in large figures, or why there is none.
    fn draw_value(&self, frame: &mut Frame<'_>, area: Rect) {
        let fault = |words: &str| {
            Paragraph::new(vec![Line::default(), Line::from(words.to_owned())])
                .style(Style::new().fg(Color::Red).bold())
        };
        match (self.away, self.latest.map(|it| (it, it.distance_mm))) {
            (Some(away), _) => frame.render_widget(fault(away), area),
            (_, Some((result, None))) => {
                frame.render_widget(fault(&format!("fault: {}", result.fault)), area);
            }
            (_, Some((_, Some(mm)))) => {
                let text = BigText::builder()
                    .pixel_size(PixelSize::Quadrant)
                    .style(Style::new().fg(Color::Green))
                    .lines(vec![Line::from(format!("{mm:.4} mm"))])
                    .build();
                frame.render_widget(text, area);
            }
            (None, None) => frame.render_widget(Paragraph::new("\nno reading so far"), area),
        }
    }

    fn draw_trend(&self, frame: &mut Frame<'_>, area: Rect) {
        let points: Vec<(f64, f64)> = (self.statistics.latest())
            .filter_map(|(at, mm)| Some((at.as_secs_f64(), mm?)))
            .collect();
        let (Some(first), Some(last)) = (points.first(), points.last()) else {
            return;
        };
        let (least, most) = least_and_most(points.iter().map(|(_, mm)| mm));
        // A distance that does not change is in the middle.
        let room = (0.05 * (most - least)).max(1e-4);
        let (least, most) = (least - room, most + room);
        let times = (first.0, last.0.max(first.0 + 1e-3));
        let axis = |title: &'static str, (from, to): (f64, f64), digits: usize| {
            let names = [from, to].map(|value| Line::from(format!("{value:.digits$}")));
            let axis = Axis::default().title(title).bounds([from, to]);
            axis.labels(names)
        };
        let chart = Chart::new(vec![line(&points, Color::Cyan)])
            .x_axis(axis("s", times, 1))
            .y_axis(axis("mm", (least, most), 4));
        frame.render_widget(chart, area);
    }

    fn statistics(&self) -> Vec<Line<'static>> {
        let statistics = self.statistics;
        let number = |value: Option<f64>, digits: usize, unit: &str| {
            value.map_or("-".to_owned(), |value| format!("{value:.digits$} {unit}"))
        };
        let line = |name: &str, value: String| Line::from(format!(" {name:<19}{value}"));
        let (extremes, deviation) = (statistics.extremes_mm, statistics.readings.deviation());
        let mut lines = vec![
            line("mean", number(statistics.readings.mean(), 4, "mm")),
            line("standard deviation", number(deviation, 4, "mm")),
            line("smallest", number(extremes.map(|it| it.0), 4, "mm")),
            line("largest", number(extremes.map(|it| it.1), 4, "mm")),
            line("results a second", number(statistics.rate(), 1, "")),
            line("readings", statistics.readings.count.to_string()),
            line("faults", statistics.all_faults().to_string()),
        ];
        for (kind, count) in &statistics.faults {
            lines.push(line(&format!("  {kind}"), count.to_string()).style(Color::Red));
        }
        if let Some((rows, dropped)) = self.lost {
            lines.push(line("rows lost", rows.to_string()));
            lines.push(line("lines dropped", dropped.to_string()));
        }
        if statistics.unreadable > 0 {
            lines.push(line("unreadable lines", statistics.unreadable.to_string()));
        }
        lines.push(line("time", format!("{:.0} s", self.now.as_secs_f64())));
        if let Some((name, count)) = self.recording {
            lines.push(Line::default());
            lines.push(Line::from(format!(" {count} lines in {name}")));
        }
        lines
    }
}

/// What else a reading says. Flags are explained.
pub fn details(reading: &FrameResult) -> String {
    let rows = reading.rows_used.zip(reading.rows);
    let four = |value: Option<f64>| value.map(|it| format!("{it:.4}"));
    let height = reading.height_counts.map(|it| format!("{it:.0}"));
    let exposure = reading.exposure_us.map(|it| it.to_string());
    let mut text = String::new();
    for (name, value, unit) in [
        ("u", four(reading.u_mm), " mm"),
        ("r", four(reading.r_mm), " mm"),
        ("centre", four(reading.centre_px), " px"),
        ("height", height, " counts"),
        ("rows", rows.map(|(used, all)| format!("{used}/{all}")), ""),
        ("exposure", exposure, " us"),
        ("slits", reading.slits.map(|it| it.to_string()), ""),
    ] {
        text += &value.map_or(String::new(), |value| format!("{name} {value}{unit}  "));
    }
    if reading.is_difference {
        text += "relative to `zero`  ";
    }
    for letter in reading.flags.split(' ').filter(|it| !it.is_empty()) {
        text += match letter {
            "m" => "misfit ",
            "c" => "correlated ",
            "g" => "not calibrated ",
            "s" => "other settings ",
            "h" => "held ",
            other => other,
        };
        text += " ";
    }
    text.trim_end().to_owned()
}
