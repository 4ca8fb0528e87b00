//! The row live at a terminal.

use std::collections::VecDeque;
use std::io::Write;
use std::time::Duration;

use anyhow::{Result, bail};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style};
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::{Axis, Block, Chart, Dataset, GraphType, Paragraph};
use slitrange::base::exposure::{Exposure, ExposureMode};
use slitrange::centre::Estimator;
use slitrange::spot::region::Region;
use slitrange_device::protocol::row_lines::{RowExposure, RowPart};
use slitrange_device::settings::{Setting, Settings, Value};

use super::RowAnswer;
use super::figure::window;
use crate::pc::Pc;
use crate::screen::{Key, line, wrap};
use crate::sensor::line::LineError;
use crate::sensor::port::PortOption;
use crate::sensor::session::{Link, Session};

/// How long to wait for a row: 1.1 s at 115,200 baud, and an emulated board may take three times as long.
const ROW: Duration = Duration::from_secs(4);
/// How long to wait between two looks for a sensor that is away.
const PAUSE: Duration = Duration::from_millis(100);
/// The rate is that of so many rows.
const RATED: usize = 10;
/// A key changes the exposure by this factor.
const STEP: f64 = 1.25;

/// Show the rows live at a terminal: pixels, fit and residuals
///
/// The sensor sends the pixels around the spot, or those of the whole row if there is no spot. By this
/// picture one aligns the optics. At 115,200 baud the line carries one whole row a second, or some windows.
/// The stream of readings pauses meanwhile.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = include_str!("scope.help.txt").trim_ascii_end())]
pub struct ScopeOptions {
    #[command(flatten)]
    port: PortOption,
    /// Begin with the whole row
    #[arg(long)]
    whole: bool,
}

/// The settings that keys change.
const CHANGED: [Setting; 3] = [Setting::Exposure, Setting::Estimator, Setting::Region];

struct Scope {
    title: String,
    whole: bool,
    /// What the sensor uses of [`CHANGED`].
    settings: Settings,
    row: Option<RowAnswer>,
    came: VecDeque<Duration>,
    /// Rows that did not arrive whole.
    spoilt: u64,
}

/// `scope`.
pub fn scope(options: &ScopeOptions, pc: &dyn Pc, output: &mut dyn Write) -> Result<()> {
    let mut session = options.port.open(pc)?;
    let before = session.settings(&CHANGED)?;
    let Some(mut screen) = pc.screen()? else {
        bail!("`scope` needs a terminal; `slitrange row --figure FILE` draws one row into a file");
    };
    let mut scope = Scope {
        title: format!("{} at {}", session.head(), session.port()),
        whole: options.whole,
        settings: before,
        row: None,
        came: VecDeque::new(),
        spoilt: 0,
    };
    let mut link = Link::There(session);
    let mut silent = 0;
    loop {
        while let Some(key) = screen.key()? {
            if key == Key::Quit {
                drop((link, screen));
                return scope.sum_up(before, output);
            }
            if let Link::There(session) = &mut link {
                // An error shows at the next row.
                let _ = scope.press(key, session);
            }
        }
        link = match link {
            Link::Gone(away, _) => {
                let mut found = away.find_again(PAUSE);
                if let Link::There(session) = &mut found {
                    silent = 0;
                    // One that started anew has forgotten what was set.
                    if let Ok(now) = session.settings(&CHANGED) {
                        scope.settings = now;
                    }
                }
                found
            }
            Link::There(mut session) => match scope.ask(&mut session) {
                Ok(()) => {
                    silent = 0;
                    Link::There(session)
                }
                Err(LineError::Silent { .. } | LineError::Refused { .. }) if silent == 0 => {
                    silent += 1;
                    scope.spoilt += 1;
                    Link::There(session)
                }
                Err(error) => Link::Gone(session.leave(), error.to_string()),
            },
        };
        let away = match &link {
            Link::There(_) => None,
            Link::Gone(_, why) => Some(why.as_str()),
        };
        screen.draw(&mut |frame| scope.draw(frame, away))?;
    }
}

impl Scope {
    /// Whether the next row must be a whole one: without a spot there is no window.
    fn part(&self) -> RowPart {
        let has_spot = self.row.as_ref().is_none_or(|row| row.centre.is_ok());
        match self.whole || !has_spot {
            true => RowPart::Whole,
            false => RowPart::Window,
        }
    }

    fn ask(&mut self, session: &mut Session<'_>) -> Result<(), LineError> {
        let command = self.part().to_string();
        match session.line().ask_once(&command, ROW, RowAnswer::read)? {
            // A window without a spot has no pixels. The whole row follows.
            Some(row) => self.row = Some(row),
            None => self.spoilt += 1,
        }
        self.came.push_back(session.line().pc().now());
        if self.came.len() > RATED {
            self.came.pop_front();
        }
        Ok(())
    }

    fn press(&mut self, key: Key, session: &mut Session<'_>) -> Result<(), LineError> {
        match key {
            Key::Char('z') => {
                self.whole = !self.whole;
                self.came.clear();
            }
            Key::Char('a') => self.set(Value::Exposure(ExposureMode::Auto), session)?,
            Key::Up | Key::Char('+') => self.change_exposure(STEP, session)?,
            Key::Down | Key::Char('-') => self.change_exposure(1.0 / STEP, session)?,
            Key::Char('e') => {
                let mut from_this = (Estimator::ALL.iter().cycle())
                    .skip_while(|estimator| **estimator != self.settings.estimator);
                if let Some(&next) = from_this.nth(1) {
                    self.set(Value::Estimator(next), session)?;
                }
            }
            Key::Char('r') => {
                if let Some(region) = self.next_region() {
                    self.set(Value::Region(region), session)?;
                }
            }
            Key::Char('R') => self.set(Value::Region(Region::ALL), session)?,
            _ => {}
        }
        Ok(())
    }

    /// Twice the window around the spot, or twice the region that is set. `None` without a spot, and with a
    /// comb, which has no region. A region of the window alone would cut the spot's foot off, and double u.
    fn next_region(&self) -> Option<Region> {
        let row = self.row.as_ref()?;
        let images = row.images();
        let pixels = match self.settings.region {
            Region::ALL => window(row, &images),
            region => usize::from(region.first())..usize::from(region.last()) + 1,
        };
        let is_set = self.settings.region != Region::ALL;
        if images.len() != 1 && !is_set || pixels.is_empty() {
            return None;
        }
        // A region of this length around the same pixels, on the row.
        let count = (2 * pixels.len()).max(Region::FEWEST);
        if count >= row.pixels {
            return Some(Region::ALL);
        }
        let middle = usize::midpoint(pixels.start, pixels.end);
        let first = middle.saturating_sub(count / 2).min(row.pixels - count);
        Region::new(first as u16, (first + count - 1) as u16)
    }

    fn set(&mut self, value: Value, session: &mut Session<'_>) -> Result<(), LineError> {
        session.set_for_good(value)?;
        self.settings.set(value);
        Ok(())
    }

    /// Changes the exposure by a factor, from the one that is set or that the latest row had.
    fn change_exposure(&mut self, factor: f64, session: &mut Session<'_>) -> Result<(), LineError> {
        let of_row = match self.row.as_ref().map(|row| row.exposure) {
            Some(RowExposure::On(exposure)) => exposure,
            _ => Exposure::LONGEST,
        };
        let from = match self.settings.exposure {
            ExposureMode::Auto => of_row,
            ExposureMode::Fixed(exposure) => exposure,
        };
        let us = (f64::from(from.us()) * factor).round() as u16;
        match Exposure::from_us(us.clamp(Exposure::SHORTEST.us(), Exposure::LONGEST.us())) {
            Some(exposure) => self.set(Value::Exposure(ExposureMode::Fixed(exposure)), session),
            None => Ok(()),
        }
    }

    fn rate(&self) -> Option<f64> {
        let time = *self.came.back()? - *self.came.front()?;
        (!time.is_zero()).then(|| (self.came.len() - 1) as f64 / time.as_secs_f64())
    }

    fn sum_up(&self, before: Settings, output: &mut dyn Write) -> Result<()> {
        for (before, now) in CHANGED.map(|it| (before.get(it), self.settings.get(it))) {
            if before != now {
                let how_long = "until the power goes or `save`";
                writeln!(output, "now {now} (it was {before}), {how_long}")?;
            }
        }
        Ok(())
    }

    fn draw(&self, frame: &mut Frame<'_>, away: Option<&str>) {
        let keys = " z zoom  up/down exposure  a auto exposure  e estimator  r/R region  q quit ";
        let block = Block::bordered().title(format!(" {} ", self.title));
        let block = block.title_bottom(keys);
        let area = block.inner(frame.area());
        frame.render_widget(block, frame.area());
        let lines = self.words(away, area.width.into());
        let height = Constraint::Length(lines.len().max(3) as u16);
        let [words, charts] = Layout::vertical([height, Constraint::Min(3)]).areas(area);
        frame.render_widget(Paragraph::new(lines), words);
        if let Some(row) = &self.row {
            self.draw_row(frame, charts, row);
        }
    }

    /// What the sensor found, how it looked, and how fast rows come, in lines of a width.
    fn words(&self, away: Option<&str>, width: usize) -> Vec<Line<'static>> {
        let red = Style::new().fg(Color::Red);
        let wrapped = |text: &str| -> Vec<Line<'static>> {
            let lines = wrap(text, width).into_iter();
            lines.map(|line| Line::styled(line, red)).collect()
        };
        if let Some(away) = away {
            return wrapped(away);
        }
        let Some(row) = &self.row else {
            return vec![Line::from("waiting for a row")];
        };
        let found = match &row.centre {
            Ok(centre) => {
                let width_px = row.width_px();
                let misfit = match centre.misfits {
                    0 => "",
                    _ => ", does not look like a spot",
                };
                vec![Line::from(format!(
                    "centre {:.3} px, u {:.3} px, height {:.0} counts, width {width_px:.2} px{misfit}",
                    centre.x_px, centre.claimed_px, centre.height_counts
                ))]
            }
            Err(none) => wrapped(&format!("{} ({})", none.fault, none.advice)),
        };
        let exposure = row.exposure_words();
        let is_auto = self.settings.exposure == ExposureMode::Auto;
        let auto = if is_auto { " (auto)" } else { "" };
        let black = row.black.map_or("no shielded pixels".to_owned(), |black| {
            format!("black level {black:.1} counts")
        });
        let full = row.full();
        let light = format!("{exposure}{auto}, {black}, {full} pixels saturated");
        let light = match full {
            0 => Line::from(light),
            _ => Line::styled(light, red),
        };
        let rate = self.rate().map(|rate| format!(", {rate:.1} rows a second"));
        let rate = rate.unwrap_or_default();
        let spoilt = match self.spoilt {
            0 => String::new(),
            count => format!(", {count} rows arrived spoilt"),
        };
        let estimator = self.settings.estimator;
        let region = match self.settings.region {
            Region::ALL => String::new(),
            region => format!(", {}", Value::Region(region)),
        };
        let how = format!("estimator {}{region}{rate}{spoilt}", estimator.name());
        [found, vec![light, Line::from(how)]].concat()
    }

    /// The pixels with the fit, and below what the fit leaves.
    fn draw_row(&self, frame: &mut Frame<'_>, area: Rect, row: &RowAnswer) {
        let images = row.images();
        let (Some(level), Some(&highest)) = (row.level(&images), row.counts.iter().max()) else {
            return;
        };
        let saturated = f64::from(row.saturated);
        let came = row.first..row.first + row.counts.len();
        let spot = window(row, &images);
        let is_window = !self.whole && !spot.is_empty();
        let shown = if is_window { spot.clone() } else { came };
        let (least, most) = (shown.start as f64, shown.end as f64);
        let pixels = row.points(&shown);
        let counts = match is_window {
            true => {
                let height = images.iter().map(|image| image.height).fold(1.0, f64::max);
                (level - 0.08 * height, level + 1.25 * height)
            }
            false => (0.0, 1.06 * saturated.max(highest.into())),
        };
        let fit = row.fit();
        let steps = || (0..=400).map(|step| least + (most - least) * f64::from(step) / 400.0);
        let fitted: Vec<(f64, f64)> = match &fit {
            Some(fit) => steps().map(|pixel| (pixel, fit(pixel))).collect(),
            None => vec![],
        };
        let across = |at: f64| [(least, at), (most, at)];
        let up = |at: usize| [(at as f64, counts.0), (at as f64, counts.1)];
        let black = row.black.map(across);
        let (full, edges) = (across(saturated), [up(spot.start), up(spot.end)]);
        let region = self.settings.region;
        let region_edges = [region.first(), region.last()].map(|pixel| up(pixel.into()));
        let mut sets = vec![line(&full, Color::DarkGray)];
        sets.extend(black.iter().map(|black| line(black, Color::DarkGray)));
        if !is_window && !spot.is_empty() {
            sets.extend(edges.iter().map(|edge| line(edge, Color::Yellow)));
        }
        if !is_window && region != Region::ALL {
            sets.extend(region_edges.iter().map(|edge| line(edge, Color::Magenta)));
        }
        if is_window {
            sets.push(line(&fitted, Color::Red));
            sets.push(dots(&pixels));
        } else {
            sets.push(line(&pixels, Color::Cyan));
        }
        let residuals: Vec<(f64, f64)> = match &fit {
            Some(fit) if is_window => {
                let left = |&(pixel, count): &(f64, f64)| (pixel, count - fit(pixel));
                pixels.iter().map(left).collect()
            }
            _ => vec![],
        };
        let below = match residuals.is_empty() {
            true => 0,
            false => (area.height / 3).max(5),
        };
        let heights = [Constraint::Min(3), Constraint::Length(below)];
        let [above, below] = Layout::vertical(heights).areas(area);
        frame.render_widget(chart(sets, (least, most), counts, "counts"), above);
        if !residuals.is_empty() {
            let sizes = residuals.iter().map(|(_, left)| left.abs());
            let largest = sizes.fold(1.0, f64::max);
            let zero = across(0.0);
            let sets = vec![line(&zero, Color::Red), dots(&residuals)];
            let range = (-1.1 * largest, 1.1 * largest);
            frame.render_widget(chart(sets, (least, most), range, "residuals"), below);
        }
    }
}

fn dots(points: &[(f64, f64)]) -> Dataset<'_> {
    let dots = Dataset::default().graph_type(GraphType::Scatter);
    dots.marker(Marker::Dot).style(Color::Cyan).data(points)
}

fn chart<'a>(
    sets: Vec<Dataset<'a>>,
    pixels: (f64, f64),
    counts: (f64, f64),
    name: &'a str,
) -> Chart<'a> {
    let names = |(from, to): (f64, f64)| {
        [from, (from + to) / 2.0, to].map(|value| Line::from(format!("{value:>6.0}")))
    };
    let axis = |title: &'a str, range: (f64, f64)| {
        let axis = Axis::default().title(title).bounds([range.0, range.1]);
        axis.labels(names(range))
    };
    let chart = Chart::new(sets).x_axis(axis("pixel", pixels));
    chart.y_axis(axis(name, counts))
}
