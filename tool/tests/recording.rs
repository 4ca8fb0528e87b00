//! Records rows of the firmware on the emulated board, and measures them once more on this PC.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::io;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use simulator::scene::{Scene, Sensor, Spot, file};
use slitrange::light::ambient::AmbientMode;
use slitrange_device::protocol::packet::{Message, Packets};
use slitrange_device::settings::Settings;
use slitrange_tool::Command;
use slitrange_tool::pc::{Pc, Port};
use slitrange_tool::recording;
use virtual_board::light::{Target, of_scene};
use virtual_board::{Exposure, Firmware, LightSource, VirtualBoard};

/// A PC whose clock is the board's, with the board at its only serial port, and the bytes that the port has
/// not given yet.
struct Desk(RefCell<VirtualBoard>, RefCell<VecDeque<u8>>, Trouble);

/// What goes wrong once.
#[derive(Default)]
struct Trouble {
    /// A byte of the next command `format binary` is lost.
    loses_a_byte: Cell<bool>,
    /// Somebody presses Ctrl-C after so many bytes from the sensor.
    interrupted_in: Cell<Option<usize>>,
    /// The port fails after so many bytes from the sensor, and works again.
    fails_in: Cell<Option<usize>>,
}

/// Counts down. Whether the count is over.
fn is_over(left: &Cell<Option<usize>>, count: usize) -> bool {
    left.set(left.get().map(|left| left.saturating_sub(count)));
    left.get() == Some(0)
}

impl Desk {
    fn new() -> Self {
        let firmware = Firmware::build().expect("the firmware builds");
        let light = of_scene(Scene::white_paper(), Target::at(0.8));
        let mut board = VirtualBoard::power_on(&firmware, light).expect("the board starts");
        board
            .run_until_line(
                |line| line.starts_with("slitrange "),
                Duration::from_secs(1),
            )
            .expect("a banner");
        Self(RefCell::new(board), RefCell::default(), Trouble::default())
    }

    /// A command of the tool: how it ends, and what it says.
    fn slitrange(&self, arguments: &[&str]) -> (ExitCode, String) {
        let (result, output) = self.try_slitrange(arguments);
        (result.unwrap_or_else(|error| panic!("{error:#}")), output)
    }

    /// The same of a command that may fail.
    fn try_slitrange(&self, arguments: &[&str]) -> (anyhow::Result<ExitCode>, String) {
        println!("$ slitrange {}", arguments.join(" "));
        let all = ["slitrange"].iter().chain(arguments);
        let command = Command::try_parse_from(all).unwrap_or_else(|error| panic!("{error}"));
        let mut output = Vec::new();
        let result = command.run(self, &mut io::empty(), &mut output);
        let output = String::from_utf8(output).expect("text");
        println!("{output}");
        (result, output)
    }

    /// A command, and the sensor's answer, both as lines.
    fn ask(&self, command: &str) -> String {
        let mut board = self.0.borrow_mut();
        board.take_lines();
        board.send(&format!("{command}\r\n"));
        let answer = board.run_until_line(|line| !line.starts_with("d "), Duration::from_secs(1));
        answer.expect("an answer").text
    }
}

impl Pc for Desk {
    fn open(&self, _: &str) -> serialport::Result<Box<dyn Port + '_>> {
        self.0.borrow_mut().take_bytes();
        self.1.borrow_mut().clear();
        Ok(Box::new(self))
    }

    fn now(&self) -> Duration {
        Duration::from_nanos(self.0.borrow().now())
    }

    fn interrupted(&self) -> bool {
        is_over(&self.2.interrupted_in, 0)
    }

    fn sleep(&self, time: Duration) {
        self.0.borrow_mut().run_for(time).expect("a clean run");
    }
}

impl Port for &Desk {
    fn read(&mut self, bytes: &mut [u8], wait: Duration) -> io::Result<usize> {
        let (mut board, mut pending) = (self.0.borrow_mut(), self.1.borrow_mut());
        let until = board.now() + wait.as_nanos() as u64;
        loop {
            pending.extend(board.take_bytes().iter().map(|(_, byte)| *byte));
            // The lines would pile up.
            board.take_lines();
            if !pending.is_empty() {
                let count = io::Read::read(&mut *pending, bytes)?;
                is_over(&self.2.interrupted_in, count);
                if is_over(&self.2.fails_in, count) {
                    self.2.fails_in.set(None);
                    return Err(io::ErrorKind::BrokenPipe.into());
                }
                return Ok(count);
            }
            if board.now() >= until {
                return Err(io::ErrorKind::TimedOut.into());
            }
            board
                .run_for(Duration::from_millis(1))
                .expect("a clean run");
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut board = self.0.borrow_mut();
        let now = board.now();
        let mut bytes = bytes.to_vec();
        let binary = b"format binary";
        if bytes.windows(binary.len()).any(|it| it == binary) && self.2.loses_a_byte.take() {
            bytes.remove(bytes.len() / 2);
        }
        board.send_at(now, &bytes);
        Ok(())
    }
}

/// Bytes of a file with one changed.
fn with_a_damaged_byte(file: &Path, place: usize) {
    let mut bytes = std::fs::read(file).expect("the recording");
    bytes[place] ^= 0x10;
    std::fs::write(file, bytes).expect("the recording");
}

#[test]
fn recorded_rows_give_the_same_bits_on_a_pc() {
    let desk = Desk::new();
    // A program that ended badly left the sensor like this.
    assert_eq!(desk.ask("rows 4"), "rows 4");
    assert_eq!(desk.ask("ambient subtract"), "ambient subtract");
    desk.ask("baud 921600");
    desk.0.borrow_mut().send("format binary\r\npixels rows\r\n");
    desk.sleep(Duration::from_millis(300));

    let directory = tempfile::tempdir().expect("a directory");
    let file = directory.path().join("rows.slitrange");
    let path = file.to_str().expect("a path");
    let (code, said) = desk.slitrange(&["record", "--port", "A", "--rows", "40", path]);
    assert_eq!(code, ExitCode::SUCCESS);
    assert!(said.contains("40 rows written"), "{said}");

    // The sensor is as it was, but speaks text at the rate of every start.
    let is_as_before = || {
        // A command that was sent twice has a second answer on its way.
        desk.sleep(Duration::from_millis(100));
        for line in [
            "format text",
            "baud 115200",
            "pixels rows",
            "rows 4",
            "ambient subtract",
            "stream on",
        ] {
            let name = line.split(' ').next().expect("a name");
            assert_eq!(desk.ask(name), line);
        }
    };
    is_as_before();

    // Also after Ctrl-C and after an error, and if a byte was lost on the way to packets. A row has 6000
    // bytes.
    let other = directory.path().join("ended.slitrange");
    let record = [
        "record",
        "--port",
        "A",
        "--rows",
        "40",
        other.to_str().expect("a path"),
    ];
    desk.2.loses_a_byte.set(true);
    desk.2.interrupted_in.set(Some(30_000));
    let (code, said) = desk.slitrange(&record);
    assert!(!desk.2.loses_a_byte.get());
    desk.2.interrupted_in.set(None);
    assert_eq!(code, ExitCode::SUCCESS);
    let rows = recording::open(&other).expect("a recording").count();
    assert!((1..40).contains(&rows), "{rows}");
    assert!(
        said.starts_with(&format!("ended by Ctrl-C: {rows} rows written")),
        "{said}"
    );
    is_as_before();
    std::fs::remove_file(&other).expect("a file");
    desk.2.fails_in.set(Some(30_000));
    let (result, _) = desk.try_slitrange(&record);
    let error = format!("{:#}", result.expect_err("a port that fails"));
    assert!(error.contains("A stopped working"), "{error}");
    assert!(recording::open(&other).is_ok_and(|rows| rows.count() > 0));
    is_as_before();

    let (code, said) = desk.slitrange(&["replay", path]);
    assert_eq!(code, ExitCode::SUCCESS);
    assert!(said.contains("40 distances"), "{said}");
    assert!(said.contains("all rows give the bits"), "{said}");

    let recorded = recording::open(&file).expect("a recording");
    let settings = Settings {
        rows: 4,
        ambient: AmbientMode::Off,
        ..Settings::default()
    };
    let of_recording = Settings {
        stream: true,
        pixels: Default::default(),
        ..recorded.sensor().settings
    };
    assert_eq!(of_recording, settings);
    for row in recorded {
        assert_eq!(row.expect("a row").words.len(), 3694);
    }

    // Other settings find other centres.
    let csv = directory.path().join("rows.csv");
    let csv_path = csv.to_str().expect("a path");
    let set = ["--set", "estimator centroid", "--csv", csv_path];
    let (code, said) = desk.slitrange(&[&["replay", path], &set[..]].concat());
    assert_eq!(code, ExitCode::SUCCESS);
    assert!(said.contains("; 0 of 40 rows give the same bits"), "{said}");
    let table = std::fs::read_to_string(&csv).expect("a table");
    assert_eq!(table.lines().count(), 41, "{table}");

    // A damaged packet costs a row, and no more.
    with_a_damaged_byte(
        &file,
        std::fs::read(&file).expect("the recording").len() / 2,
    );
    let (code, said) = desk.slitrange(&["replay", path]);
    assert_eq!(code, ExitCode::SUCCESS);
    assert!(
        said.contains("39 rows of") && said.contains("1 packets are damaged"),
        "{said}"
    );

    // A record of another centre is noticed.
    let other = recording::open(&file).expect("a recording");
    let mut writer = recording::Writer::default();
    let mut bytes = writer.head(other.sensor());
    for (place, row) in other.enumerate() {
        let mut row = row.expect("a row");
        if place < 3 {
            row.words.rotate_left(1);
        }
        bytes.extend(writer.row(&row));
    }
    std::fs::write(&file, bytes).expect("the recording");
    let (code, said) = desk.slitrange(&["replay", path]);
    assert_eq!(code, ExitCode::FAILURE);
    assert!(said.contains("3 of 39 rows give other bits"), "{said}");
    desk.0.into_inner().finish().expect("a clean run");
}

/// The rows of the long run below. `SLITRANGE_ROWS` sets another number.
const MANY_ROWS: u64 = 100_000;

/// The rows that the long run records between two changes of light and settings.
const A_SCENE: u64 = 500;

/// Settings of the long run, one after the other. The estimators compute in whole numbers and in floats.
const SETTINGS_IN_TURN: [&str; 8] = [
    "estimator adaptive",
    "exposure auto",
    "estimator gauss-newton",
    "black frame",
    "estimator fraunhofer",
    "exposure 5600",
    "estimator phase-table",
    "black shielded",
];

/// Random spots, each for some rows: anywhere on the row and beyond its edges, narrow and wide, dim and
/// saturated.
fn any_spots(seed: u64) -> LightSource {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut row = 0;
    let mut centre = 0.0;
    Box::new(move |_: &Exposure| {
        row += 1;
        // The line takes one row in eleven.
        if row % 8 == 0 {
            centre = random.random_range(-20.0..3668.0);
        }
        let scene = Scene {
            seed,
            spot: Some(Spot {
                width: random.random_range(0.8_f64.ln()..130_f64.ln()).exp(),
                counts_per_second: random.random_range(4_f64.ln()..12_000_f64.ln()).exp(),
            }),
            ..Scene::white_paper()
        };
        scene.row_with_centre(row, centre, 1.0)
    })
}

/// Shows random spots, a scene of the folder, random spots, and so on.
fn show(desk: &Desk, turn: usize) -> String {
    let mut names = file::names().expect("the folder of scenes");
    names.retain(|name| {
        let scene = Scene::load(name).expect("a scene");
        scene.sensor == Sensor::Tcd1304dg
    });
    let seed = 7_001 + turn as u64;
    let mut board = desk.0.borrow_mut();
    if turn.is_multiple_of(2) {
        board.set_light(any_spots(seed));
        return "random spots".to_owned();
    }
    let name = names[turn / 2 % names.len()].clone();
    let scene = Scene {
        seed,
        ..Scene::load(&name).expect("a scene")
    };
    let target = Target::at(scene.distance);
    board.set_light(of_scene(scene, target));
    name
}

/// The firmware on the emulated board measures rows of many scenes, and a PC measures them once more: bit by
/// bit the same.
#[test]
#[ignore = "a hundred thousand rows are two hours of virtual time; SLITRANGE_ROWS sets another number"]
fn a_hundred_thousand_rows_of_the_firmware_give_the_same_bits_on_a_pc() {
    let wanted = match std::env::var("SLITRANGE_ROWS") {
        Ok(number) => number.parse().expect("SLITRANGE_ROWS is a number"),
        Err(_) => MANY_ROWS,
    };
    let desk = Desk::new();
    desk.ask("stream off");
    let directory = tempfile::tempdir().expect("a directory");
    let file = directory.path().join("rows.slitrange");
    let path = file.to_str().expect("a path");
    let (mut done, mut turn) = (0, 0);
    while done < wanted {
        let setting = SETTINGS_IN_TURN[turn % SETTINGS_IN_TURN.len()];
        // If `record` asked twice at its end, the second answer still comes.
        desk.sleep(Duration::from_millis(200));
        assert_eq!(desk.ask(setting), setting);
        let scene = show(&desk, turn);
        let slits = if scene == "comb" {
            "slits comb"
        } else {
            "slits one"
        };
        assert_eq!(desk.ask(slits), slits);
        let rows = A_SCENE.min(wanted - done);
        let count = rows.to_string();
        let (code, _) = desk.slitrange(&["record", "--port", "board", "--rows", &count, path]);
        assert_eq!(code, ExitCode::SUCCESS);
        let (code, said) = desk.slitrange(&["replay", path]);
        assert_eq!(code, ExitCode::SUCCESS, "{said}");
        let all = format!("{rows} rows of TCD1304DG");
        assert!(said.starts_with(&all), "{said}");
        assert!(!said.contains("damaged"), "{said}");
        (done, turn) = (done + rows, turn + 1);
        let seconds = desk.0.borrow().statistics().seconds;
        println!("{done} of {wanted} rows are the same, {seconds:.0} s: {scene}, {setting}");
        std::fs::remove_file(&file).expect("the recording");
    }
    desk.0.into_inner().finish().expect("a clean run");
}

#[test]
fn a_file_that_is_no_recording_is_refused() {
    let directory = tempfile::tempdir().expect("a directory");
    let file = directory.path().join("points.csv");
    let mut packets = Packets::default();
    let later = packets.encode(Message::Text(b"slitrange recording 2\r\n"));
    for (bytes, words) in [
        (&b"distance,centre\n800,1770\n"[..], "this is no recording"),
        (
            later,
            "the recording has version 2, this tool reads 1: update the tool",
        ),
    ] {
        std::fs::write(&file, bytes).expect("a file");
        let error = recording::open(&file).expect_err("no recording");
        assert!(format!("{error:#}").contains(words), "{error:#}");
    }
}
