//! A sensor in a thread behind a pseudo-terminal: it speaks the core's own protocol, sees a target at the distance that a file
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
use slitrange::black_level::BlackLevel;
use slitrange::centre::Estimator;
use slitrange::distance::eq1::NOMINAL;
use slitrange::fault::Fault;
use slitrange::frame::{FrameCentre, Mean};
use slitrange::measurement::Settings;
use slitrange::protocol::calibration::{FlashStatus, Shown};
use slitrange::protocol::command::{Command, Error};
use slitrange::protocol::info::{Banner, Hardware, Info};
use slitrange::protocol::input::Input;
use slitrange::protocol::piece::Piece;
use slitrange::protocol::refusal::Refusal;
use slitrange::protocol::status::StartCause;
use slitrange::protocol::upload::Upload;
use slitrange::reading::Measured;
use slitrange::record::encoded::EncodedRecord;
use slitrange::sensor_heads::tcd1304dg;
use slitrange::store::StoreError;
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
    pub settings: Settings,
    pub stream: bool,
    pub calibration: Option<EncodedRecord>,
    /// What its flash holds.
    pub saved: (Settings, Option<EncodedRecord>),
    /// Whether its flash takes anything.
    pub flash_works: bool,
    /// It has no power until then.
    pub off_until: Option<Instant>,
    /// The port is not there until then.
    pub unplugged_until: Option<Instant>,
    /// The one line of an upload, here or there, that arrives spoilt: how many come before it, and whether it is lost.
    pub spoil: Option<(usize, bool)>,
    /// Power fails so many times while the flash is written, which then holds what it held.
    pub restarts_on_save: usize,
    /// Commands that it understood.
    pub asked: Vec<Command>,
    upload: Upload,
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
        let settings = Settings {
            rows: 16,
            mean: Mean::default(),
            estimator: Estimator::default(),
            black_level: BlackLevel::Shielded,
        };
        let state = Arc::new(Mutex::new(State {
            trouble,
            settings,
            stream: true,
            calibration: EncodedRecord::nominal(),
            saved: (settings, None),
            flash_works: true,
            off_until: None,
            unplugged_until: None,
            spoil: None,
            restarts_on_save: 0,
            asked: Vec::new(),
            upload: Upload::none(),
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
        if self.centre_due.is_some_and(|due| now >= due) {
            self.centre_due = None;
            let line = match self.frame(&state) {
                Ok(measured) => measured.to_string(),
                Err(fault) => format!("{fault}\r\n({})", fault.advice()),
            };
            self.say(&mut state, &line);
        } else if state.stream && now >= self.streamed + Duration::from_millis(6) {
            self.streamed = now;
            let line = match self.frame(&state) {
                Ok(measured) => measured
                    .reading(
                        state
                            .calibration
                            .as_ref()
                            .map(|written| &written.record().calibration),
                    )
                    .map_or_else(|fault| fault.to_string(), |reading| reading.to_string()),
                Err(fault) => fault.to_string(),
            };
            self.say(&mut state, &line);
        }
    }

    /// Power is back.
    fn start(&mut self, state: &mut State) {
        state.off_until = None;
        state.settings = state.saved.0;
        state.calibration = state.saved.1.clone().or_else(EncodedRecord::nominal);
        state.stream = true;
        state.upload = Upload::none();
        self.input = Input::new();
        self.line.clear();
        self.centre_due = None;
        self.say(state, &Banner(&HARDWARE, StartCause::PowerOn).to_string());
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
            if let Some(command) = self.input.take(byte) {
                self.obey(state, command);
            }
        }
    }

    fn obey(&mut self, state: &mut State, command: Result<Command, Error>) {
        let answer = match command {
            Ok(Command::Nothing) => return,
            Ok(command) => {
                state.asked.push(command);
                self.answer(state, command)
            }
            Err(error) => Some(error.to_string()),
        };
        if let Some(answer) = answer {
            for line in answer.split("\r\n") {
                self.say(state, line);
            }
        }
    }

    fn answer(&mut self, state: &mut State, command: Command) -> Option<String> {
        let settings = &mut state.settings;
        let answer = match command {
            Command::Info => Info {
                hardware: &HARDWARE,
                geometry: &tcd1304dg(),
                settings,
                record: state.calibration.as_ref().map(EncodedRecord::record),
                on: true,
            }
            .to_string(),
            Command::Stream(on) => {
                state.stream = on.unwrap_or(state.stream);
                Command::Stream(Some(state.stream)).to_string()
            }
            Command::Rows(rows) => {
                settings.rows = rows.unwrap_or(settings.rows);
                Command::Rows(Some(settings.rows)).to_string()
            }
            Command::Estimator(estimator) => {
                settings.estimator = estimator.unwrap_or(settings.estimator);
                Command::Estimator(Some(settings.estimator)).to_string()
            }
            Command::Black(black) => {
                settings.black_level = black.unwrap_or(settings.black_level);
                Command::Black(Some(settings.black_level)).to_string()
            }
            Command::Calibration(None) => Shown {
                written: state.calibration.as_ref(),
                on: true,
                stored: match &state.saved.1 {
                    Some(saved) => FlashStatus::Record(saved.sum()),
                    None => FlashStatus::Nothing,
                },
            }
            .to_string(),
            Command::Data(offset) => match &state.calibration {
                Some(written) => match Piece::of(written.bytes(), offset) {
                    Some(piece) => piece.to_string(),
                    None => Refusal::NoPiece {
                        offset,
                        bytes: written.bytes().len(),
                    }
                    .to_string(),
                },
                None => Refusal::NoCalibration.to_string(),
            },
            Command::Upload(step) => match state.upload.take(step, &tcd1304dg()) {
                Ok(record) => {
                    if let Some(record) = record {
                        settings.estimator = record.estimator;
                        settings.black_level = record.black_level;
                        state.calibration = EncodedRecord::new(record).ok();
                    }
                    command.to_string()
                }
                Err(refusal) => refusal.to_string(),
            },
            Command::Save => {
                if state.restarts_on_save > 0 {
                    state.restarts_on_save -= 1;
                    state.off_until = Some(Instant::now() + Duration::from_millis(50));
                    "save pauses the stream".to_owned()
                } else if state.flash_works {
                    state.saved = (*settings, state.calibration.clone());
                    "save pauses the stream\r\nsave".to_owned()
                } else {
                    format!(
                        "save pauses the stream\r\n{}",
                        Refusal::NotSaved(StoreError::Flash)
                    )
                }
            }
            Command::Centre => {
                let late = self.random.random_bool(state.trouble.late);
                let after = if late {
                    WAITS.frame * 11 / 10
                } else {
                    Duration::ZERO
                };
                // Asked for twice, it is answered once.
                let due = Instant::now() + after;
                self.centre_due = Some(self.centre_due.unwrap_or(due));
                return None;
            }
            other => panic!("the stand-in does not know {other:?}"),
        };
        Some(answer)
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
        let centre = (centre_px(mm) + centre_px(before)) / 2.0 + NOISE_PX * noise;
        Ok(Measured {
            frame: FrameCentre {
                centre: Pixels::from_bits((centre * 65536.0).round() as i32),
                uncertainty: Pixels::from_f32(NOISE_PX as f32),
                amplitude: Counts::from_int(1993),
                width: Pixels::from_int(9),
                rows_used: state.settings.rows,
                rows: state.settings.rows,
                misfits: 0,
                correlated: None,
            },
            black_level: Counts::from_int(300),
            estimator: state.settings.estimator,
        })
    }

    fn say(&mut self, state: &mut State, line: &str) {
        let Some(line) = self.noisy(state, format!("{line}\r\n").as_bytes()) else {
            return;
        };
        // What nobody reads is lost, as on a real line.
        let terminal = self.terminal.as_mut().expect("plugged in");
        match terminal.sensor_side.write(&line) {
            Ok(_) => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Err(error) => panic!("{error}"),
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
