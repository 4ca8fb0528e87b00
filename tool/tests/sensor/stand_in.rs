//! A sensor in a thread behind a pseudo-terminal: it speaks the core's own protocol, sees a target at the
//! distance that a file
//! says, and has whatever trouble it is given.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::pty::openpty;
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};
use nix::unistd::ttyname;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use slitrange::distance::eq1::NOMINAL;
use slitrange::fault::Fault;
use slitrange::frame::FrameCentre;
use slitrange::protocol::command::{Command, parse};
use slitrange::protocol::info::Hardware;
use slitrange::protocol::input::Input;
use slitrange::protocol::status::{StartCause, Vitals};
use slitrange::protocol::upload::Step;
use slitrange::reading::Measured;
use slitrange::record::Record;
use slitrange::record::encoded::EncodedRecord;
use slitrange::sensor_heads::tcd1304dg;
use slitrange::session::{Actions, Event, Session};
use slitrange::settings::Settings;
use slitrange::store::configuration::Configuration;
use slitrange::store::{StoreError, Stored};
use slitrange::units::{Counts, Pixels};
use slitrange_tool::sensor::line::Waits;

const HARDWARE: Hardware = Hardware {
    board: "stand-in",
    head: "TCD1304DG",
    row_us: 5700,
};

/// The noise of a frame's centre, in pixels.
pub const NOISE_PX: f64 = 0.002;

/// Some hundred times what the stand-in takes: a machine that does much else is waited for.
pub const WAITS: Waits = Waits {
    answer: Duration::from_millis(200),
    frame: Duration::from_millis(200),
    save: Duration::from_millis(200),
    reconnect: Duration::from_secs(10),
};

/// What goes wrong, each with its probability a line.
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
}

/// What is known of the sensor while it runs.
#[derive(Debug)]
pub struct State {
    pub trouble: Trouble,
    session: Session,
    actions: Actions,
    /// What its flash holds.
    flash: Stored,
    /// Whether its flash takes anything.
    pub flash_works: bool,
    /// It has no power until then.
    pub off_until: Option<Instant>,
    /// The port is not there until then.
    pub unplugged_until: Option<Instant>,
    /// The one line of an upload, here or there, that arrives spoilt: how many come before it, and whether it
    /// is lost.
    pub spoil: Option<(usize, bool)>,
    /// It hears nothing any more, once a piece of a record has come.
    pub deaf_after_piece: bool,
    /// Power fails so many times while the flash is written, which then holds what it held.
    pub restarts_on_save: usize,
}

impl State {
    /// The settings in use.
    pub fn settings(&self) -> Settings {
        *self.session.settings()
    }

    /// The record in use.
    pub fn record(&self) -> Option<EncodedRecord> {
        encoded(self.session.record())
    }

    /// The record in flash. The nominal one is not written there.
    pub fn saved_record(&self) -> Option<EncodedRecord> {
        encoded(self.flash.configuration()?.record.as_ref())
    }

    /// Somebody else types a line.
    pub fn type_line(&mut self, line: &str) {
        self.take(Event::Line(parse(line.as_bytes())));
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
        self.session = new_session();
        self.take(Event::Started(self.flash.clone()))
    }

    /// Gives the text that an event brings. Its last line ends like all others.
    fn take(&mut self, event: Event) -> String {
        let Self {
            session, actions, ..
        } = self;
        session.take(event, &Vitals::default(), actions);
        let mut text = actions.text.as_str().to_owned();
        if !actions.save {
            return text;
        }
        if self.restarts_on_save > 0 {
            self.restarts_on_save -= 1;
            self.off_until = Some(Instant::now() + Duration::from_millis(50));
            return text;
        }
        let result = match self.session.configuration() {
            Some(configuration) if self.flash_works => {
                self.flash = Stored::Newest(configuration);
                Ok(())
            }
            _ => Err(StoreError::Flash),
        };
        text.push_str(&self.take(Event::Saved(result)));
        text
    }
}

fn new_session() -> Session {
    Session::new(HARDWARE, tcd1304dg(), StartCause::PowerOn)
}

fn encoded(record: Option<&Record>) -> Option<EncodedRecord> {
    EncodedRecord::new(record?.clone()).ok()
}

/// A sensor in a thread.
pub struct StandIn {
    pub state: Arc<Mutex<State>>,
    /// Of a directory that holds the port's name and the target's distance.
    directory: tempfile::TempDir,
    thread: Option<JoinHandle<()>>,
    ended: Arc<Mutex<bool>>,
}

impl StandIn {
    /// A sensor with the nominal calibration.
    pub fn new(seed: u64, trouble: Trouble) -> Self {
        let state = Arc::new(Mutex::new(State {
            trouble,
            session: new_session(),
            actions: Actions::default(),
            flash: Stored::Nothing,
            flash_works: true,
            off_until: None,
            unplugged_until: None,
            spoil: None,
            deaf_after_piece: false,
            restarts_on_save: 0,
        }));
        let directory = tempfile::tempdir().expect("a directory");
        let ended = Arc::new(Mutex::new(false));
        let mut sensor = Sensor {
            state: state.clone(),
            random: ChaCha8Rng::seed_from_u64(seed),
            terminal: Some(Terminal::open(&directory.path().join("port"))),
            port: directory.path().join("port"),
            stage: directory.path().join("stage"),
            input: Input::new(),
            line: Vec::new(),
            seen_mm: None,
            centre_due: None,
            streamed: Instant::now(),
        };
        let end = ended.clone();
        let thread = std::thread::spawn(move || {
            while !*end.lock().expect("no panic") {
                sensor.step();
                std::thread::sleep(Duration::from_micros(100));
            }
        });
        Self {
            state,
            directory,
            thread: Some(thread),
            ended,
        }
    }

    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no panic")
    }

    /// The serial port's name.
    pub fn port(&self) -> String {
        self.path("port").to_str().expect("text").to_owned()
    }

    /// A file beside it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    /// What moves the target.
    pub fn stage_command(&self) -> String {
        format!("echo {{}} > '{}'", self.path("stage").display())
    }
}

impl Drop for StandIn {
    fn drop(&mut self) {
        if let Ok(mut ended) = self.ended.lock() {
            *ended = true;
        }
        if let Some(thread) = self.thread.take() {
            let ended = thread.join();
            assert!(
                ended.is_ok() || std::thread::panicking(),
                "the stand-in panicked"
            );
        }
    }
}

/// The centre of a target at a distance, exactly: that of the nominal geometry.
pub fn centre_px(mm: f64) -> f64 {
    let curve = NOMINAL.expect("a curve");
    let k = curve.k() as f64 / 65536.0;
    curve.pole().to_f64() + k / (mm * 1e3 - curve.d().to_f64())
}

/// Both ends of a pseudo-terminal.
struct Terminal {
    sensor_side: File,
    /// Stays open, or reading would fail whenever no program has the terminal open.
    _program_side: OwnedFd,
}

impl Terminal {
    /// Opens one, which has that name from then on.
    fn open(port: &Path) -> Self {
        let ends = openpty(None, None).expect("a pseudo-terminal");
        let mut settings = tcgetattr(&ends.slave).expect("its settings");
        cfmakeraw(&mut settings);
        tcsetattr(&ends.slave, SetArg::TCSANOW, &settings).expect("raw");
        fcntl(&ends.master, FcntlArg::F_SETFL(OFlag::O_NONBLOCK)).expect("non-blocking");
        let path = ttyname(&ends.slave).expect("its path");
        std::os::unix::fs::symlink(path, port).expect("a name for it");
        Self {
            sensor_side: File::from(ends.master),
            _program_side: ends.slave,
        }
    }
}

/// What the thread has for itself.
struct Sensor {
    state: Arc<Mutex<State>>,
    random: ChaCha8Rng,
    terminal: Option<Terminal>,
    port: PathBuf,
    stage: PathBuf,
    input: Input,
    /// The line that comes in.
    line: Vec<u8>,
    /// Where the target was in the latest frame.
    seen_mm: Option<f64>,
    centre_due: Option<Instant>,
    streamed: Instant,
}

impl Sensor {
    fn step(&mut self) {
        let state = self.state.clone();
        let mut state = state.lock().expect("no panic");
        let now = Instant::now();
        if let Some(until) = state.unplugged_until {
            if self.terminal.take().is_some() {
                std::fs::remove_file(&self.port).expect("its name is gone");
            }
            if now < until {
                return;
            }
            state.unplugged_until = None;
            self.terminal = Some(Terminal::open(&self.port));
        }
        let mut bytes = [0; 1024];
        let terminal = self.terminal.as_mut().expect("plugged in");
        let count = match terminal.sensor_side.read(&mut bytes) {
            Ok(count) => count,
            Err(error) if error.kind() == ErrorKind::WouldBlock => 0,
            Err(error) => panic!("{error}"),
        };
        if let Some(until) = state.off_until {
            if now < until {
                return;
            }
            self.start(&mut state);
        }
        for &byte in &bytes[..count] {
            self.line.push(byte);
            if byte == b'\r' {
                let line = std::mem::take(&mut self.line);
                self.hear(&mut state, &line);
            }
        }
        let is_due = match self.centre_due {
            Some(due) => now >= due,
            None => state.settings().stream && now >= self.streamed + Duration::from_millis(6),
        };
        if is_due {
            self.centre_due = None;
            self.streamed = now;
            let frame = self.frame(&state);
            let text = state.take(Event::Frame(frame));
            self.say(&mut state, &text);
        }
    }

    /// Power is back.
    fn start(&mut self, state: &mut State) {
        state.off_until = None;
        self.input = Input::new();
        self.line.clear();
        self.centre_due = None;
        let banner = state.start();
        self.say(state, &banner);
    }

    /// A line comes in, if it does.
    fn hear(&mut self, state: &mut State, line: &[u8]) {
        if self.random.random_bool(state.trouble.restart) {
            state.off_until = Some(Instant::now() + Duration::from_millis(50));
            return;
        }
        let Some(line) = self.noisy(state, line) else {
            return;
        };
        for byte in line {
            let Some(command) = self.input.take(byte) else {
                continue;
            };
            if command == Ok(Command::Centre) {
                let late = self.random.random_bool(state.trouble.late);
                let wait = if late {
                    WAITS.frame * 11 / 10
                } else {
                    Duration::ZERO
                };
                // Asked for twice, it is answered once.
                self.centre_due.get_or_insert(Instant::now() + wait);
            }
            let is_piece = matches!(command, Ok(Command::Upload(Step::Piece(_))));
            let text = state.take(Event::Line(command));
            self.say(state, &text);
            if is_piece && state.deaf_after_piece {
                state.trouble.lost = 1.0;
            }
        }
    }

    /// The frame that ends now. In the first one after a move, the target moved half of the time.
    fn frame(&mut self, state: &State) -> Result<Measured, Fault> {
        if self.random.random_bool(state.trouble.fault) {
            return Err(Fault::TooDim {
                amplitude: Counts::from_int(35),
                needed: Counts::from_int(60),
            });
        }
        let mm = std::fs::read_to_string(&self.stage)
            .ok()
            .and_then(|text| text.trim().parse().ok())
            .or(self.seen_mm)
            .unwrap_or(800.0);
        let before = self.seen_mm.replace(mm).unwrap_or(mm);
        let noise: f64 = StandardNormal.sample(&mut self.random);
        let settings = state.settings();
        let centre = (centre_px(mm) + centre_px(before)) / 2.0 + NOISE_PX * noise;
        Ok(Measured {
            frame: FrameCentre {
                centre: Pixels::from_bits((centre * 65536.0).round() as i32),
                uncertainty: Pixels::from_f32(NOISE_PX as f32),
                amplitude: Counts::from_int(1993),
                width: Pixels::from_int(9),
                rows_used: settings.rows,
                rows: settings.rows,
                misfits: 0,
                correlated: None,
            },
            black_level: Counts::from_int(300),
            estimator: settings.estimator,
        })
    }

    fn say(&mut self, state: &mut State, text: &str) {
        for line in text.split_inclusive("\r\n") {
            let Some(line) = self.noisy(state, line.as_bytes()) else {
                continue;
            };
            // What nobody reads is lost, as on a real line.
            let terminal = self.terminal.as_mut().expect("plugged in");
            match terminal.sensor_side.write(&line) {
                Ok(_) => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(error) => panic!("{error}"),
            }
        }
    }

    /// What arrives of a line.
    fn noisy(&mut self, state: &mut State, line: &[u8]) -> Option<Vec<u8>> {
        let of_upload = [
            &b"calibration begin"[..],
            b"calibration data",
            b"calibration commit",
        ]
        .iter()
        .any(|start| line.starts_with(start));
        let spoilt = match &mut state.spoil {
            Some((0, lost)) if of_upload => Some(*lost),
            Some((before, _)) if of_upload => {
                *before -= 1;
                None
            }
            _ => None,
        };
        if spoilt.is_some() {
            state.spoil = None;
        }
        let trouble = state.trouble;
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
