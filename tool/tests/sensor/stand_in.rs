//! A sensor in virtual time: it speaks the core's own protocol, sees a target at the distance that a file
//! says, and has whatever trouble it is given. It is the tool's PC as well: time goes on only while the tool
//! waits.

use std::cell::RefMut;
use std::num::NonZeroU16;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use judges::frames::{self, at_centre};
use rand_distr::{Distribution, StandardNormal};
use simulator::scene::Exposure as Times;
use slitrange::Fault;
use slitrange::base::exposure::Exposure;
use slitrange::centre::spot_shape::SpotShape;
use slitrange::distance::eq1::NOMINAL;
use slitrange::frame::FrameCentre;
use slitrange::frame::comb::{Combined, SlitCentre, SlitCentres};
use slitrange::row::pixels::PixelErrors;
use slitrange::row::pixels::flat_field::{FlatField, Kind, TakeError, Taken};
use slitrange_device::protocol::command::{Command, parse};
use slitrange_device::protocol::info::{BrownOut, Clock, Hardware};
use slitrange_device::protocol::input::{Echo, Input};
use slitrange_device::protocol::row_lines::{ROW_END, RowExposure, RowHead, RowPart, RowPixels};
use slitrange_device::protocol::status::{StartCause, Vitals};
use slitrange_device::protocol::upload::Step;
use slitrange_device::session::flat::{Job, Outcome};
use slitrange_device::session::{Actions, Event, Session};
use slitrange_device::store::configuration::Configuration;
use slitrange_device::store::pixel_map::StoredMap;
use slitrange_device::store::{StoreError, Stored};
use slitrange_tool::sensor::line::FRAME;

use crate::command::*;

const HARDWARE: Hardware = Hardware {
    board: "stand-in",
    head: "TCD1304DG",
    row_us: 5700,
    longest_exposure: Exposure::LONGEST,
    clock: Clock::External,
    brown_out: BrownOut::Off,
    last_stop: None,
};

/// The noise of a frame's centre, in pixels.
pub const NOISE_PX: f64 = 0.002;
/// The shape of every spot: a laser's skew.
pub const SHAPE: SpotShape = SpotShape {
    components: [
        Pixels::from_bits(0),
        Pixels::from_bits(3277),
        Pixels::from_bits(12_288),
        Pixels::from_bits(-20),
        Pixels::from_bits(0),
    ],
    width: Pixels::from_bits(499_712),
    noise: Pixels::from_bits(131),
    rest: Pixels::from_bits(0),
};

/// The step of the stand-in's clock. A line takes that long to be sent.
const STEP: Duration = Duration::from_millis(1);
/// How long the sensor starts after power came.
const START: Duration = Duration::from_millis(50);
/// The most bytes that wait to be read. A sensor sends a row in a second, and the stand-in sends it at once.
const KEPT: usize = 4096 * 4;

/// What goes wrong. The first five are probabilities for each line.
#[derive(Clone, Copy, Debug, Default)]
pub struct Trouble {
    /// A line to or from the sensor does not arrive.
    pub lost: f64,
    /// A byte of it becomes another, or is lost.
    pub garbled: f64,
    /// A frame takes longer than anybody waits.
    pub late: f64,
    /// Power fails for a moment.
    pub restart: f64,
    /// A frame has no centre.
    pub fault: f64,
    /// The one line of an upload, here or there, that arrives spoilt: how many come before it, and whether it
    /// is lost.
    pub spoil: Option<(usize, bool)>,
    /// It hears nothing any more, once a piece of a record has come.
    pub deaf_after_piece: bool,
    /// So many times the light is wrong for a map of the pixels.
    pub wrong_light: usize,
    pub broken_flash: bool,
    /// Power fails so many times while the flash is written, which then holds what it held.
    pub restarts_on_save: usize,
    /// The tool is killed after so many uses of its port.
    pub kill_after: Option<usize>,
    pub interrupted: bool,
}

impl Trouble {
    pub fn of_line(lost: f64, garbled: f64) -> Self {
        with(Self::default(), |it| {
            (it.lost, it.garbled) = (lost, garbled)
        })
    }
}

type EachStep = Box<dyn FnMut(&mut State)>;
/// A step of the clock, and what happens at that step.
type AtStep = (usize, fn(&mut State));

/// The sensor itself, and what is known of it while it runs.
pub struct State {
    pub trouble: Trouble,
    session: Session,
    actions: Actions,
    input: Input,
    random: ChaCha8Rng,
    flash: Stored,
    now: Duration,
    started: Duration,
    /// Results of frames since then.
    results: u32,
    /// The sensor has no power until then.
    off_until: Option<Duration>,
    /// The port is not there until then.
    unplugged_until: Option<Duration>,
    /// How often the cable was pulled out.
    plugged: usize,
    pub has_saved_map: bool,
    /// The height of the spot in a row, in counts.
    pub spot_height: f64,
    /// A simulated sensor head. If there is one, the rows come from it, and `spot_height` has no effect.
    pub light: Option<SimulatedHead>,
    /// The map of the pixels of `scenes/even-light.toml`.
    pub flat: Box<FlatField>,
    /// The tool is dead: nothing that its destructors do has any effect.
    killed: bool,
    stage: PathBuf,
    /// Where the target was in the latest frame.
    seen_mm: Option<f64>,
    /// What it said and nobody has read.
    sent: VecDeque<u8>,
    /// The line that comes in.
    line: Vec<u8>,
    centre_due: Option<Duration>,
    streamed: Duration,
    each_step: Option<EachStep>,
}

impl State {
    pub fn settings(&self) -> Settings {
        *self.session.settings()
    }

    pub fn record(&self) -> Option<EncodedRecord> {
        encoded(self.session.record())
    }

    /// The record in flash. The nominal one is not written there.
    pub fn saved_record(&self) -> Option<EncodedRecord> {
        encoded(self.flash.configuration()?.record.as_ref())
    }

    /// The rows in a frame that its flash holds.
    pub fn saved_rows(&self) -> Option<u16> {
        Some(self.flash.configuration()?.settings.rows)
    }

    pub fn is_map_on(&self) -> bool {
        self.session.is_map_on()
    }

    pub fn cut_power(&mut self, time: Duration) {
        self.off_until = Some(self.now + time);
    }

    pub fn unplug(&mut self, time: Duration) {
        self.unplugged_until = Some(self.now + time);
    }

    pub fn type_line(&mut self, line: &str) {
        self.take(Event::Line(parse(line.as_bytes())));
    }

    /// Lines with `; ` between them.
    pub fn type_lines(&mut self, lines: &str) {
        lines.split("; ").for_each(|line| self.type_line(line));
    }

    /// Its flash holds this record, or nothing that can be used, and it has started.
    pub fn start_with(&mut self, record: Option<EncodedRecord>) {
        self.flash = match record {
            Some(record) => Stored::Newest(Configuration {
                settings: self.settings(),
                record: Some(record.record().clone()),
            }),
            None => Stored::Unusable,
        };
        self.start();
    }

    /// Power comes. Gives the banner.
    fn start(&mut self) -> String {
        (self.session, self.input) = (new_session(), Input::new());
        (self.off_until, self.centre_due) = (None, None);
        (self.started, self.results) = (self.now, 0);
        self.line.clear();
        self.session.start(&self.flash, &mut self.actions);
        self.actions.text.as_str().to_owned()
    }

    /// Gives the text that an event brings. Its last line ends like all others.
    fn take(&mut self, event: Event) -> String {
        self.results += u32::from(matches!(event, Event::Frame(_)));
        let time_us = (self.now - self.started).as_micros() as u64;
        let vitals = Vitals {
            uptime_us: time_us,
            results: self.results,
            result_us: time_us,
            ..Vitals::default()
        };
        self.session.take(event, &vitals, &mut self.actions);
        let mut text = self.actions.text.as_str().to_owned();
        if let Some(job) = self.actions.flat.take() {
            if let Some(outcome) = self.do_flat(job) {
                text.push_str(&self.take(Event::Flat(outcome)));
            }
            return text;
        }
        if let Some(part) = self.actions.row.take() {
            return text + &self.row(part);
        }
        if !self.actions.save {
            return text;
        }
        if self.trouble.restarts_on_save > 0 {
            self.trouble.restarts_on_save -= 1;
            self.cut_power(START);
            return text;
        }
        let result = match self.session.configuration() {
            Some(configuration) if !self.trouble.broken_flash => {
                self.flash = Stored::Newest(configuration.cloned());
                Ok(())
            }
            _ => Err(StoreError::Flash),
        };
        text.push_str(&self.take(Event::Saved(result)));
        text
    }
}

/// The row that the stand-in shows: spots of sigma 8 and some height, above 300 counts.
fn words(centres_px: &[f64], height: f64) -> Vec<u16> {
    let geometry = tcd1304dg();
    let mut words = vec![4095 - 300; geometry.words];
    for (pixel, word) in words[geometry.light].iter_mut().enumerate() {
        let spots = centres_px.iter().map(|centre_px| {
            let off = (pixel as f64 - centre_px) / 8.0;
            height * (-0.5 * off * off).exp()
        });
        // A little of everything, because pixels that are all the same are no sensor's.
        let noise = f64::from((pixel as u32 * 7919) % 7) - 3.0;
        let count = 300.0 + spots.sum::<f64>() + noise;
        *word = 4095 - count.round().min(4095.0) as u16;
    }
    words
}

/// A sensor head that is simulated, before a target at rest.
pub struct SimulatedHead {
    simulation: Simulation,
    polarity: Polarity,
    row: u64,
    laser_before: f64,
}

impl SimulatedHead {
    pub fn new(scene: Scene, polarity: Polarity) -> Self {
        Self {
            simulation: Simulation::new(scene),
            polarity,
            row: 0,
            laser_before: 0.0,
        }
    }

    /// The words of the next row, in which the laser shone for so long.
    pub fn words(&mut self, exposure: Option<Exposure>) -> Vec<u16> {
        self.row += 1;
        let laser = exposure.map_or(0.0, |exposure| f64::from(exposure.us()) * 1e-6);
        let times = Times {
            row: 5.7e-3,
            laser,
            laser_before: std::mem::replace(&mut self.laser_before, laser),
        };
        let distance = self.simulation.scene().distance;
        let outputs = self.simulation.row(self.row, distance, times);
        let mut geometry = tcd1304dg();
        geometry.polarity = self.polarity;
        let mut words = frames::words(&outputs, &geometry);
        words.rotate_right(TCD1304DG_LEAD_IN);
        words
    }
}

impl State {
    /// Sends a row: dark with the laser off, otherwise a spot of [`Self::spot_height`] at pixel 1800.25 or
    /// the images of a comb around it.
    pub fn row(&mut self, part: RowPart) -> String {
        let (geometry, settings) = (self.session.geometry(), self.settings());
        let mut measurement = Measurement::new(geometry.clone(), settings.options());
        let exposure = settings.laser.then(|| measurement.next_exposure());
        let centre_px = Pixels::from_f32(1800.25);
        let comb = Comb::nominal();
        let centres_px: Vec<f64> = match settings.slits {
            _ if !settings.laser => vec![],
            Slits::One => vec![centre_px.to_f64()],
            Slits::Comb => (comb.slits().iter())
                .map(|slit| slit.from_axis(centre_px).to_f64())
                .collect(),
        };
        let mut words = match &mut self.light {
            None => words(&centres_px, self.spot_height),
            Some(head) => head.words(exposure),
        };
        let measured = measurement.measure_alone(&mut words, exposure, None);
        let row = geometry.row(&words).expect("a row");
        let head = RowHead::new(
            part,
            &row,
            RowExposure::of_laser(exposure),
            &measured,
            settings.searched(),
        );
        let lines = RowPixels::lines(row.light(), head.sent()).map(|line| format!("{line}\r\n"));
        format!("{head}\r\n{}{ROW_END}\r\n", lines.collect::<String>())
    }

    fn do_flat(&mut self, job: Job) -> Option<Outcome> {
        let works = !self.trouble.broken_flash;
        let result = works.then_some(()).ok_or(StoreError::Flash);
        Some(match job {
            Job::Take(kind) if self.trouble.wrong_light > 0 || self.settings().laser => {
                self.trouble.wrong_light = self.trouble.wrong_light.saturating_sub(1);
                let (pixel, above) = (1760, 900);
                let error = match kind {
                    Kind::Dark => TakeError::SpotInTheDark { pixel, above },
                    Kind::Lit => TakeError::Saturated { pixels: 3648 },
                };
                Outcome::Taken(kind, Err(error))
            }
            Job::Take(kind) => Outcome::Taken(kind, self.take_rows(kind)),
            Job::Save => {
                self.has_saved_map |= works;
                Outcome::Saved(result)
            }
            Job::Erase => Outcome::Erased(result),
            Job::Load => Outcome::Loaded(
                Ok(StoredMap::Newest),
                self.flat.map().map(|map| *map.summary()),
            ),
            Job::Use(_) => return None,
        })
    }
}

impl State {
    /// As the firmware does. A person covers the sensor for dark rows, and lights it evenly for others.
    fn take_rows(&mut self, kind: Kind) -> Result<Taken, TakeError> {
        let geometry = self.session.geometry();
        let lit = Scene::load("even-light").expect("a scene");
        let scene = if kind == Kind::Dark {
            lit.covered()
        } else {
            lit
        };
        let mut head = SimulatedHead::new(scene, geometry.polarity);
        self.flat.begin(kind, &geometry)?;
        loop {
            if let Some(taken) = self.flat.add(&mut head.words(None), &geometry) {
                return taken;
            }
        }
    }
}

fn new_session() -> Session {
    Session::new(HARDWARE, tcd1304dg(), StartCause::PowerOn)
}

fn encoded(record: Option<&Record>) -> Option<EncodedRecord> {
    EncodedRecord::new(record?.clone()).ok()
}

/// A sensor, the PC that it is plugged into, and a directory for files.
pub struct StandIn {
    state: RefCell<State>,
    /// Holds the target's distance, and what a test writes.
    directory: tempfile::TempDir,
}

impl StandIn {
    /// A sensor with the nominal calibration.
    pub fn new(seed: u64) -> Self {
        let directory = tempfile::tempdir().expect("a directory");
        let state = RefCell::new(State {
            trouble: Trouble::default(),
            session: new_session(),
            actions: Actions::default(),
            input: Input::new(),
            random: ChaCha8Rng::seed_from_u64(seed),
            flash: Stored::Nothing,
            now: Duration::ZERO,
            started: Duration::ZERO,
            results: 0,
            off_until: None,
            unplugged_until: None,
            plugged: 0,
            has_saved_map: false,
            spot_height: 2000.0,
            light: None,
            flat: Box::new(FlatField::new()),
            killed: false,
            stage: directory.path().join("stage"),
            seen_mm: None,
            sent: VecDeque::new(),
            line: Vec::new(),
            centre_due: None,
            streamed: Duration::ZERO,
            each_step: None,
        });
        Self { state, directory }
    }

    pub fn state(&self) -> RefMut<'_, State> {
        self.state.borrow_mut()
    }

    pub fn each_step(&self, call: impl FnMut(&mut State) + 'static) {
        self.state().each_step = Some(Box::new(call));
    }

    /// Does something to the sensor at some steps of the clock, counted from now: milliseconds while somebody
    /// waits.
    pub fn at_steps<const N: usize>(&self, calls: [AtStep; N]) {
        let mut step = 0;
        self.each_step(move |state| {
            step += 1;
            let due = calls.iter().filter(|(at, _)| *at == step);
            due.for_each(|(_, call)| call(state));
        });
    }

    pub fn port(&self) -> String {
        self.file("port")
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    pub fn file(&self, name: &str) -> String {
        self.path(name).to_str().expect("text").to_owned()
    }

    pub fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).expect("a file")
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), bytes).expect("written");
    }

    pub fn stage_command(&self) -> String {
        format!("echo {{}} > '{}'", self.file("stage"))
    }

    /// The words of a command line. `PORT` stands for the sensor's port, `STAGE` for what moves the target,
    /// and `@name` for a file in the directory.
    pub fn words(&self, line: &str) -> Vec<String> {
        let word = |word: &str| match (word, word.strip_prefix('@')) {
            ("PORT", _) => self.port(),
            ("STAGE", _) => self.stage_command(),
            (_, Some(name)) => self.file(name),
            _ => word.to_owned(),
        };
        line.split_whitespace().map(word).collect()
    }

    /// Runs `slitrange` with the [`Self::words`] of a line and with what a person types.
    pub fn type_in(&self, line: &str, typed: &str) -> Ended {
        slitrange(self, &self.words(line), typed)
    }

    pub fn run(&self, line: &str) -> Ended {
        self.type_in(line, "")
    }

    #[track_caller]
    pub fn done(&self, line: &str) -> String {
        done(self.run(line))
    }

    #[track_caller]
    pub fn refused(&self, line: &str) -> String {
        refused(self.run(line))
    }

    /// Does something that may be killed by [`Trouble::kill_after`]. Gives what it gives, or false if killed.
    pub fn ends_before_it_is_killed(&self, call: impl FnOnce() -> bool) -> bool {
        let ended = catch_unwind(AssertUnwindSafe(call));
        let mut state = self.state();
        (state.trouble.kill_after, state.killed) = (None, false);
        match ended {
            Ok(ended) => ended,
            Err(reason) if reason.is::<Killed>() => false,
            Err(reason) => resume_unwind(reason),
        }
    }

    /// Bytes come from the PC, and go back.
    pub fn exchange(&self, bytes: &[u8]) -> Vec<u8> {
        let mut state = self.state();
        state.receive(bytes);
        state.step();
        state.sent.drain(..).collect()
    }

    /// Lets time pass until `until`, or bytes are there for a port.
    fn wait(&self, until: Duration, for_bytes: bool) {
        let mut state = self.state();
        state.step();
        while state.now < until && !(for_bytes && !state.sent.is_empty()) {
            state.now = until.min(state.now + STEP);
            state.step();
        }
    }
}

impl Pc for StandIn {
    fn open(&self, port: &str) -> serialport::Result<Box<dyn Port + '_>> {
        let mut state = self.state();
        state.step();
        if state.unplugged_until.is_some() || port != self.port() {
            return Err(io::Error::from(io::ErrorKind::NotFound).into());
        }
        state.sent.clear();
        Ok(Box::new(Plug {
            pc: self,
            plugged: state.plugged,
        }))
    }

    fn now(&self) -> Duration {
        self.state().now
    }

    fn interrupted(&self) -> bool {
        self.state().trouble.interrupted
    }

    fn sleep(&self, time: Duration) {
        self.wait(self.now() + time, false);
    }
}

/// Why a panic is none.
struct Killed;

struct Plug<'a> {
    pc: &'a StandIn,
    /// How often the cable had been pulled out when it was opened.
    plugged: usize,
}

impl Plug<'_> {
    /// Whether the port works, which it does until the cable is pulled out.
    fn works(&self) -> bool {
        let mut state = self.pc.state();
        if let Some(0) = state.trouble.kill_after {
            (state.trouble.kill_after, state.killed) = (None, true);
            drop(state);
            resume_unwind(Box::new(Killed));
        }
        if let Some(left) = &mut state.trouble.kill_after {
            *left -= 1;
        }
        state.unplugged_until.is_none() && self.plugged == state.plugged && !state.killed
    }
}

impl Port for Plug<'_> {
    fn read(&mut self, bytes: &mut [u8], wait: Duration) -> io::Result<usize> {
        if !self.works() {
            return Ok(0);
        }
        self.pc.wait(self.pc.now() + wait, true);
        let sent = &mut self.pc.state().sent;
        if sent.is_empty() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        io::Read::read(sent, bytes)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        if !self.works() {
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        self.pc.state().receive(bytes);
        self.pc.sleep(STEP);
        Ok(())
    }
}

/// The centre of a target at a distance, exactly: that of the nominal geometry.
pub fn centre_px(mm: f64) -> f64 {
    let curve = NOMINAL.expect("a curve");
    let k = curve.k() as f64 / 65536.0;
    curve.pole().to_f64() + k / (mm * 1e3 - curve.d().to_f64())
}

impl State {
    fn step(&mut self) {
        if let Some(mut call) = self.each_step.take() {
            call(self);
            self.each_step = Some(call);
        }
        let now = self.now;
        if let Some(until) = self.unplugged_until {
            self.sent.clear();
            if now < until {
                return;
            }
            self.plugged += 1;
            self.unplugged_until = None;
        }
        if let Some(until) = self.off_until {
            if now < until {
                return;
            }
            let banner = self.start();
            self.say(&banner);
        }
        let next = self.streamed + Duration::from_millis(6);
        let is_due = match self.centre_due {
            Some(due) => now >= due,
            None => self.settings().stream && now >= next,
        };
        if is_due {
            self.centre_due = None;
            self.streamed = now;
            let frame = Event::Frame(self.frame());
            let text = self.take(frame);
            self.say(&text);
        }
    }

    /// Bytes come in. Without power they are lost.
    fn receive(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if self.off_until.is_some() {
                return;
            }
            self.line.push(byte);
            if byte == b'\r' {
                let line = std::mem::take(&mut self.line);
                self.hear(&line);
            }
        }
    }

    /// A line comes in, if it does.
    fn hear(&mut self, line: &[u8]) {
        if self.random.random_bool(self.trouble.restart) {
            self.cut_power(START);
            return;
        }
        let Some(line) = self.noisy(line) else {
            return;
        };
        for byte in line {
            let mut echo = Echo::default();
            let command = match self.settings().echo {
                true => self.input.type_in(byte, &mut echo),
                false => self.input.take(byte),
            };
            self.sent.extend(echo.as_str().bytes());
            let Some(command) = command else {
                continue;
            };
            if command == Ok(Command::Centre) {
                let wait = FRAME * 11 / 10 * u32::from(self.random.random_bool(self.trouble.late));
                // Asked for twice, it is answered once.
                self.centre_due.get_or_insert(self.now + wait);
            }
            let is_piece = matches!(command, Ok(Command::Upload(Step::Piece(_))));
            let text = self.take(Event::Line(command));
            self.say(&text);
            if is_piece && self.trouble.deaf_after_piece {
                self.trouble.lost = 1.0;
            }
        }
    }

    /// The frame that ends now. In the first one after a move, the target moved half of the time.
    fn frame(&mut self) -> Result<Measured, Fault> {
        if self.random.random_bool(self.trouble.fault) {
            return Err(Fault::TooDim {
                amplitude: Counts::from_int(35),
                needed: Counts::from_int(60),
            });
        }
        let mm = std::fs::read_to_string(&self.stage).ok();
        let mm = mm.and_then(|text| text.trim().parse().ok());
        let mm = mm.or(self.seen_mm).unwrap_or(800.0);
        let before = self.seen_mm.replace(mm).unwrap_or(mm);
        let noise: f64 = StandardNormal.sample(&mut self.random);
        let settings = self.settings();
        let centre = (centre_px(mm) + centre_px(before)) / 2.0 + NOISE_PX * noise;
        let exact = at_centre(centre);
        Ok(Measured {
            frame: FrameCentre {
                uncertainty: Pixels::from_f32(NOISE_PX as f32),
                amplitude: Counts::from_int(1993),
                exposure: None,
                rows_used: settings.rows,
                rows: settings.rows,
                shape: SHAPE,
                ..exact.frame
            },
            estimator: settings.estimator,
            pixels: PixelErrors::TCD1304DG,
            comb: (settings.slits == Slits::Comb).then(|| self.combined(centre)),
            ..exact
        })
    }

    /// What the slits of a comb show of a centre: each with its own noise, and one of them nothing.
    fn combined(&mut self, centre: f64) -> Combined {
        let mut centres = SlitCentres::default();
        for (image, slit) in centres.iter_mut().zip(Comb::nominal().slits()).skip(1) {
            let noise: f64 = StandardNormal.sample(&mut self.random);
            let x0 = centre + NOISE_PX * noise;
            *image = Some(SlitCentre {
                centre: slit.from_axis(Pixels::from_bits((x0 * 65536.0).round() as i32)),
                height: 1500,
                rows: NonZeroU16::new(self.settings().rows).expect("rows"),
            });
        }
        Combined {
            shift: Pixels::default(),
            surface: Pixels::default(),
            used: 15,
            centres,
        }
    }

    fn say(&mut self, text: &str) {
        for line in text.split_inclusive("\r\n") {
            if let Some(line) = self.noisy(line.as_bytes()) {
                self.sent.extend(line);
            }
        }
        // What nobody reads is lost, as on a real line.
        let unread = self.sent.len().saturating_sub(KEPT);
        self.sent.drain(..unread);
    }

    /// What arrives of a line.
    fn noisy(&mut self, line: &[u8]) -> Option<Vec<u8>> {
        let begins = |step: &str| line.starts_with(format!("calibration {step}").as_bytes());
        let of_upload = ["begin", "data", "commit"].into_iter().any(begins);
        let spoilt = match &mut self.trouble.spoil {
            Some((0, lost)) if of_upload => Some(*lost),
            Some((before, _)) if of_upload => {
                *before -= 1;
                None
            }
            _ => None,
        };
        if spoilt.is_some() {
            self.trouble.spoil = None;
        }
        let trouble = self.trouble;
        if spoilt == Some(true) || self.random.random_bool(trouble.lost) {
            return None;
        }
        let mut line = line.to_vec();
        if spoilt == Some(false) || self.random.random_bool(trouble.garbled) {
            let at = self.random.random_range(0..line.len());
            if self.random.random() {
                line[at] ^= 1 << self.random.random_range(0..8);
            } else {
                line.remove(at);
            }
        }
        Some(line)
    }
}
