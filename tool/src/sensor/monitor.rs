//! The readings of a sensor as they come: as a live view, as lines, or as a file.

pub mod recording;
pub mod statistics;
mod view;

use std::io::{self, Write};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::Result;
use slitrange::base::exposure::Exposure;
use slitrange_device::settings::columns::Column;
use slitrange_device::settings::{Setting, Value};

use self::recording::Recording;
use self::statistics::Statistics;
use self::view::{View, details};
use super::line::LineError;
use super::port::PortOption;
use super::session::{Link, Session};
use super::stream::{FrameResult, Kind, frame_result};
use crate::pc::{Pc, utc};
use crate::screen::{Key, Screen};

/// How long to wait for a line before keys are read and the view is drawn.
const TICK: Duration = Duration::from_millis(50);
/// The view is drawn so often.
const DRAWN: Duration = Duration::from_millis(100);
/// After so long without a line the sensor is asked whether it is there. 64 rows take 0.4 s.
const SILENT: Duration = Duration::from_secs(3);
/// After so much time the view no longer shows the last reading as if it were new.
const STALE: Duration = Duration::from_secs(1);
/// So often the view asks how many rows were lost. The answer takes the line for 50 ms, and nobody asks while
/// a file is written, so that no reading is dropped for it.
const STATUS: Duration = Duration::from_secs(10);
/// So often a line says how a recording goes.
const PROGRESS: Duration = Duration::from_secs(10);

/// Show the readings as they come, and record them
///
/// At a terminal: a live view with the distance, its trend and statistics. q or Ctrl-C ends it. Into a pipe,
/// and with --plain: a line for each reading. The sensor is left as it was found. If the setting `output` has
/// no distance, `monitor` adds it until its end; with --csv, also the columns `counter` and
/// `time`, unless a frame is one row.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(after_help = include_str!("monitor.help.txt").trim_ascii_end())]
pub struct MonitorOptions {
    #[command(flatten)]
    pub(crate) port: PortOption,
    /// Write lines instead of the live view
    #[arg(long)]
    pub(crate) plain: bool,
    /// Write each reading and fault to a new file
    #[arg(long, value_name = "FILE")]
    pub(crate) csv: Option<PathBuf>,
    /// End after so many readings and faults
    #[arg(long)]
    pub(crate) count: Option<u64>,
    /// End after this time
    #[arg(long)]
    pub(crate) seconds: Option<f64>,
}

/// The readings so far, and how they came.
struct Monitor<'a> {
    options: &'a MonitorOptions,
    pc: &'a dyn Pc,
    output: &'a mut dyn Write,
    as_lines: bool,
    /// The sensor head and its port.
    sensor: String,
    /// The same, and what `monitor` changed for its time.
    title: String,
    began: Duration,
    statistics: Statistics,
    latest: Option<FrameResult>,
    recording: Option<Recording>,
    /// Rows lost and lines dropped: at the beginning, and now.
    lost: Option<[(u32, u32); 2]>,
    /// When the last line came.
    heard: Duration,
    /// When the last reading or fault came.
    reading_came: Duration,
    results: u64,
    /// The file gets an exposure for each reading. The sensor's lines leave the longest one out.
    has_exposures: bool,
}

/// `monitor`.
pub fn monitor(options: &MonitorOptions, pc: &dyn Pc, output: &mut dyn Write) -> Result<()> {
    // From now on, Ctrl-C ends the loop below, and the sensor's settings are put back.
    pc.interrupted();
    let began = pc.now();
    let session = options.port.open(pc)?;
    let sensor = format!("{} at {}", session.head(), session.port());
    let recording = options.csv.as_deref().map(Recording::create).transpose()?;
    let mut screen = if options.plain { None } else { pc.screen()? };
    let mut monitor = Monitor {
        options,
        pc,
        output,
        as_lines: screen.is_none(),
        title: sensor.clone(),
        sensor,
        began,
        statistics: Statistics::default(),
        latest: None,
        recording,
        lost: None,
        heard: began,
        reading_came: began,
        results: 0,
        has_exposures: false,
    };
    let ended = monitor.run(session, &mut screen);
    drop(screen);
    match ended {
        // Who reads the lines has read enough.
        Err(error) if is_broken_pipe(&error) => Ok(()),
        Err(error) => Err(error),
        Ok(()) => monitor.sum_up(),
    }
}

/// Seconds to the millisecond.
fn seconds(at: Duration) -> f64 {
    at.as_millis() as f64 / 1e3
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let error = error.downcast_ref::<io::Error>();
    error.is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
}

impl<'a> Monitor<'a> {
    fn run(
        &mut self,
        session: Session<'a>,
        screen: &mut Option<Box<dyn Screen + '_>>,
    ) -> Result<()> {
        let mut link = self.start(session);
        if self.as_lines {
            writeln!(self.output, "sensor {}", self.title)?;
        }
        let (mut drawn, mut progress, mut asked) = (None, self.pc.now(), self.pc.now());
        while !self.is_done() {
            link = match link {
                Link::There(session) => self.listen(session)?,
                Link::Gone(away, _) => match away.find_again(TICK) {
                    Link::There(session) => self.start(session),
                    gone => gone,
                },
            };
            let now = self.pc.now();
            if let Link::There(session) = &mut link
                && !self.as_lines
                && self.recording.is_none()
                && now > asked + STATUS
            {
                asked = now;
                // An error shows at the next line.
                let _ = session.line().tell("status");
            }
            if let Some(screen) = screen {
                if drawn.is_none_or(|drawn| now >= drawn + DRAWN) {
                    drawn = Some(now);
                    self.draw(&mut **screen, &link)?;
                }
                if screen.key()? == Some(Key::Quit) {
                    break;
                }
            } else if self.recording.is_some() && now >= progress + PROGRESS {
                progress = now;
                let (seconds, line) = (self.time().as_secs_f64(), self.statistics.line());
                let faults = self.statistics.all_faults();
                writeln!(self.output, "{seconds:.0} s: {line}, {faults} faults")?;
            }
        }
        if let (Link::There(session), Some([_, now])) = (&mut link, &mut self.lost)
            && let Ok(lost) = session.losses()
        {
            *now = lost;
        }
        Ok(())
    }

    fn start(&mut self, mut session: Session<'a>) -> Link<'a> {
        self.heard = self.pc.now();
        let lost = self.prepare(&mut session);
        match lost.and_then(|lost| session.stream().map(|()| lost)) {
            Ok(lost) => {
                // A sensor that started anew counts from zero.
                self.lost = Some(match self.lost {
                    Some([first, _]) if first.0 <= lost.0 && first.1 <= lost.1 => [first, lost],
                    _ => [lost, lost],
                });
                Link::There(session)
            }
            Err(error) => Link::Gone(session.leave(), error.to_string()),
        }
    }

    /// Asks what `monitor` must know, and sets its columns. Gives the rows lost and lines dropped.
    fn prepare(&mut self, session: &mut Session<'_>) -> Result<(u32, u32), LineError> {
        self.statistics.leaves_out = session.value(Setting::Rate)? != Value::Rate(0);
        let Value::Output(columns) = session.value(Setting::Output)? else {
            return session.losses();
        };
        let mut wanted = vec![Column::Distance];
        // At 115200 baud, longer lines do not fit in the time of one row.
        if self.recording.is_some() && session.value(Setting::Rows)? != Value::Rows(1) {
            wanted.extend([Column::Counter, Column::Time]);
        }
        let all = wanted.iter().fold(columns, |all, column| all.with(*column));
        self.has_exposures = self.recording.is_some() && columns.has(Column::Exposure);
        if all != columns {
            session.borrow(Value::Output(all))?;
            wanted.retain(|column| !columns.has(*column));
            let added: Vec<_> = wanted
                .iter()
                .map(|column| format!("`{}`", column.name()))
                .collect();
            self.title = format!(
                "{}; `output` also has {} for now",
                self.sensor,
                added.join(", ")
            );
        }
        session.losses()
    }

    fn listen(&mut self, mut session: Session<'a>) -> Result<Link<'a>> {
        let is_there = match session.line().next_line(TICK) {
            Ok(Some(line)) => self.take(&line).map(Ok)?,
            Ok(None) if self.pc.now() < self.heard + SILENT => return Ok(Link::There(session)),
            Ok(None) => match session.line().answers() {
                // Somebody else sent `stream off`.
                Ok(false) => session.stream(),
                streams => streams.map(|_| ()),
            },
            Err(error) => Err(error),
        };
        let Err(error) = is_there else {
            self.heard = self.pc.now();
            return Ok(Link::There(session));
        };
        let (fault, at) = (error.to_string(), self.time());
        if self.as_lines {
            writeln!(self.output, "{:>9.3} s   {fault}", at.as_secs_f64())?;
        }
        if let Some(recording) = &mut self.recording {
            recording.add(&FrameResult {
                time_s: seconds(at),
                utc: utc(),
                kind: Kind::Gap,
                fault: fault.clone(),
                ..FrameResult::default()
            })?;
        }
        Ok(Link::Gone(session.leave(), fault))
    }

    fn take(&mut self, line: &str) -> Result<()> {
        let at = self.time();
        let Some(mut result) = frame_result(line) else {
            match line.strip_prefix("status ") {
                Some(status) => self.take_status(status),
                // The answer to `stream on` may come twice.
                None if line.starts_with("stream ") => {}
                None => self.statistics.unreadable += 1,
            }
            return Ok(());
        };
        self.results += 1;
        self.reading_came = self.pc.now();
        self.statistics.take(at, &result);
        result.time_s = seconds(at);
        result.utc = utc();
        if self.has_exposures && result.distance_mm.is_some() {
            result.exposure_us.get_or_insert(Exposure::LONGEST.us());
        }
        if let Some(recording) = &mut self.recording {
            recording.add(&result)?;
        } else if self.as_lines {
            write!(self.output, "{:>9.3} s   ", at.as_secs_f64())?;
            match result.distance_mm {
                Some(mm) => writeln!(self.output, "{mm:>10.4} mm   {}", details(&result))?,
                None => writeln!(self.output, "fault: {}", result.fault)?,
            }
        }
        self.latest = Some(result);
        Ok(())
    }

    fn take_status(&mut self, status: &str) {
        let Some([_, (rows, dropped)]) = &mut self.lost else {
            return;
        };
        for (name, lost) in [("rows lost ", rows), ("lines dropped ", dropped)] {
            let number = status.strip_prefix(name).and_then(|it| it.parse().ok());
            *lost = number.unwrap_or(*lost);
        }
    }

    fn time(&self) -> Duration {
        self.pc.now() - self.began
    }

    fn is_done(&self) -> bool {
        let MonitorOptions { count, seconds, .. } = self.options;
        count.is_some_and(|count| self.results >= count)
            || seconds.is_some_and(|seconds| self.time().as_secs_f64() >= seconds)
            || self.pc.interrupted()
    }

    /// Rows lost and lines dropped since the beginning.
    fn losses(&self) -> Option<(u32, u32)> {
        let [first, now] = self.lost?;
        Some((now.0.wrapping_sub(first.0), now.1.wrapping_sub(first.1)))
    }

    fn draw(&self, screen: &mut dyn Screen, link: &Link<'_>) -> Result<()> {
        let since = self.pc.now().saturating_sub(self.reading_came);
        let stale = format!("no reading for {:.0} s", since.as_secs_f64());
        let view = View {
            title: &self.title,
            now: self.time(),
            latest: self.latest.as_ref(),
            away: match link {
                Link::There(_) => (since > STALE).then_some(&*stale),
                Link::Gone(_, why) => Some(why),
            },
            statistics: &self.statistics,
            lost: self.losses(),
            recording: (self.recording.as_ref()).map(|it| (&*it.name, it.lines)),
        };
        Ok(screen.draw(&mut |frame| view.draw(frame))?)
    }

    fn sum_up(self) -> Result<()> {
        let (lost, seconds) = (self.losses(), self.time().as_secs_f64());
        let (statistics, output) = (&self.statistics, self.output);
        let (line, faults) = (statistics.line(), statistics.faults_line());
        writeln!(output, "{seconds:.1} s: {line}\n{faults}")?;
        if let Some((rows, dropped)) = lost {
            writeln!(output, "{rows} rows lost, {dropped} lines dropped")?;
        }
        let (missing, unreadable) = (statistics.missing, statistics.unreadable);
        if missing > 0 {
            writeln!(output, "{missing} results did not arrive, by their numbers")?;
        }
        if unreadable > 0 {
            let what = "lines could not be read: check the cable";
            writeln!(output, "{unreadable} {what}")?;
        }
        if let Some(recording) = &self.recording {
            let Recording { name, lines, .. } = recording;
            writeln!(output, "written: {name}, {lines} lines")?;
        }
        Ok(())
    }
}
