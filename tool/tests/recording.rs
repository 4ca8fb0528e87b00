//! Records rows of the firmware on the emulated board, and measures them once more on this PC.

use slitrange::light::ambient::AmbientMode;
use slitrange_device::protocol::packet::{Message, Packets};
use slitrange_tool::recording;
use virtual_board::{Exposure, LightSource};

use crate::command::*;
use crate::desk::Desk;
use crate::replay::{any_spot, scenes};

/// A board in front of white paper at a PC.
fn desk() -> Desk {
    let firmware = Firmware::build().expect("the firmware builds");
    let light = of_scene(Scene::white_paper(), Target::at(0.8));
    let mut board = VirtualBoard::power_on(&firmware, light).expect("the board starts");
    let is_banner = |line: &str| line.starts_with("slitrange ");
    let banner = board.run_until_line(is_banner, Duration::from_secs(1));
    banner.expect("a banner");
    Desk::new(board, None)
}

/// A command, and the sensor's answer, both as lines.
fn ask(desk: &Desk, command: &str) -> String {
    let mut board = desk.board.borrow_mut();
    board.take_lines();
    board.send(&format!("{command}\r\n"));
    let answer = board.run_until_line(|line| !line.starts_with("d "), Duration::from_secs(1));
    answer.expect("an answer").text
}

/// A command of the tool that ends with this exit code: what it says.
#[track_caller]
fn ends_with(desk: &Desk, code: ExitCode, line: &str) -> String {
    let (ended, said) = desk.run(line);
    assert_eq!(ended, Ok(code), "{said}");
    said
}

#[test]
fn recorded_rows_give_the_same_bits_on_a_pc() {
    let desk = desk();
    let done = |line: &str| ends_with(&desk, ExitCode::SUCCESS, line);
    // A program that ended badly left the sensor like this.
    assert_eq!(ask(&desk, "rows 4"), "rows 4");
    assert_eq!(ask(&desk, "ambient subtract"), "ambient subtract");
    ask(&desk, "baud 921600");
    let packets = "format binary\r\npixels rows\r\n";
    desk.board.borrow_mut().send(packets);
    desk.sleep(Duration::from_millis(300));
    let directory = tempfile::tempdir().expect("a directory");
    let [file, other, csv] =
        ["rows.slitrange", "ended.slitrange", "rows.csv"].map(|name| directory.path().join(name));
    let [path, other_path, csv_path] =
        [&file, &other, &csv].map(|file| file.to_str().expect("a path"));
    let said = done(&format!("record --port A --rows 40 {path}"));
    says(&said, ["40 rows written"]);

    // The sensor is as it was. At this test's end of the line, any rate is understood.
    let is_as_before = || {
        // A command that was sent twice has a second answer on its way.
        desk.sleep(Duration::from_millis(100));
        desk.board.borrow_mut().send("plain on\r\n");
        desk.sleep(Duration::from_millis(300));
        for line in [
            "format binary",
            "baud 921600",
            "pixels rows",
            "rows 4",
            "ambient subtract",
            "stream on",
        ] {
            assert_eq!(ask(&desk, line.split(' ').next().expect("a name")), line);
        }
    };
    let plain = done("settings --port A get plain");
    assert_eq!(plain, "off\n", "it sends packets again");
    is_as_before();

    // Also after Ctrl-C, an error, or a byte lost on the way to packets. A row has 6000 bytes.
    let record = format!("record --port A --rows 40 {other_path}");
    desk.trouble.loses_a_byte.set(true);
    desk.trouble.interrupted_in.set(Some(30_000));
    let said = done(&record);
    assert!(!desk.trouble.loses_a_byte.get());
    desk.trouble.interrupted_in.set(None);
    let rows = recording::open(&other).expect("a recording").count();
    assert!((1..40).contains(&rows), "{rows}");
    says(&said, [format!("ended by Ctrl-C: {rows} rows written")]);
    is_as_before();
    std::fs::remove_file(&other).expect("a file");
    desk.trouble.fails_in.set(Some(30_000));
    says(&refused(desk.run(&record)), ["A stopped working"]);
    assert!(recording::open(&other).is_ok_and(|rows| rows.count() > 0));
    is_as_before();
    let replay = format!("replay {path}");
    says(&done(&replay), ["40 distances", "all rows give the bits"]);
    let recorded = recording::open(&file).expect("a recording");
    let settings = with(Settings::default(), |it| {
        (it.rows, it.ambient) = (4, AmbientMode::Off)
    });
    // How the sensor speaks does not matter to its rows.
    let of_recording = with(recorded.sensor.settings, |it| {
        (it.stream, it.plain, it.pixels) = (true, false, Default::default());
        (it.format, it.baud) = Default::default();
    });
    assert_eq!(of_recording, settings);
    for row in recorded {
        assert_eq!(row.expect("a row").words.len(), 3694);
    }

    // Other settings find other centres.
    let set = [
        "replay",
        path,
        "--csv",
        csv_path,
        "--set",
        "estimator centroid",
    ];
    let (code, said) = slitrange(&desk, &set, "");
    assert_eq!(code, Ok(ExitCode::SUCCESS));
    says(&said, ["; 0 of 40 rows give the same bits"]);
    let table = std::fs::read_to_string(&csv).expect("a table");
    assert_eq!(table.lines().count(), 41, "{table}");

    // A damaged packet costs a row, and no more.
    let mut bytes = std::fs::read(&file).expect("the recording");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    std::fs::write(&file, bytes).expect("the recording");
    says(&done(&replay), ["39 rows of", "1 packets are damaged"]);

    // A record of another centre is noticed.
    let other = recording::open(&file).expect("a recording");
    let mut writer = recording::Writer::default();
    let mut bytes = writer.head(&other.sensor);
    for (place, row) in other.enumerate() {
        let mut row = row.expect("a row");
        if place < 3 {
            row.words.rotate_left(1);
        }
        bytes.extend(writer.row(&row));
    }
    std::fs::write(&file, bytes).expect("the recording");
    let said = ends_with(&desk, ExitCode::FAILURE, &replay);
    says(&said, ["3 of 39 rows give other bits"]);
    desk.board.into_inner().finish().expect("a clean run");
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

/// Random spots, each for some rows: anywhere and beyond the edges, of any width, dim to saturated.
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
            spot: Some(any_spot(&mut random)),
            ..Scene::white_paper()
        };
        scene.row_with_centre(row, centre, 1.0)
    })
}

/// Shows random spots, a scene of the folder, random spots, and so on.
fn show(desk: &Desk, turn: usize) -> String {
    let names = scenes();
    let seed = 7_001 + turn as u64;
    let mut board = desk.board.borrow_mut();
    if turn.is_multiple_of(2) {
        board.set_light(any_spots(seed));
        return "random spots".to_owned();
    }
    let name = names[turn / 2 % names.len()].clone();
    let scene = with(Scene::load(&name).expect("a scene"), |it| it.seed = seed);
    let target = Target::at(scene.distance);
    board.set_light(of_scene(scene, target));
    name
}

/// The firmware measures rows of many scenes, and a PC measures them once more: bit by bit the same.
#[test]
#[ignore = "a hundred thousand rows are two hours of virtual time; SLITRANGE_ROWS sets another number"]
fn a_hundred_thousand_rows_of_the_firmware_give_the_same_bits_on_a_pc() {
    let wanted = match std::env::var("SLITRANGE_ROWS") {
        Ok(number) => number.parse().expect("SLITRANGE_ROWS is a number"),
        Err(_) => MANY_ROWS,
    };
    let desk = desk();
    ask(&desk, "stream off");
    let directory = tempfile::tempdir().expect("a directory");
    let file = directory.path().join("rows.slitrange");
    let path = file.to_str().expect("a path");
    let (mut done, mut turn) = (0, 0);
    while done < wanted {
        let setting = SETTINGS_IN_TURN[turn % SETTINGS_IN_TURN.len()];
        // If `record` asked twice at its end, the second answer still comes.
        desk.sleep(Duration::from_millis(200));
        assert_eq!(ask(&desk, setting), setting);
        let scene = show(&desk, turn);
        let is_comb = scene == "comb";
        let slits = if is_comb { "slits comb" } else { "slits one" };
        assert_eq!(ask(&desk, slits), slits);
        let rows = A_SCENE.min(wanted - done);
        let record = format!("record --port board --rows {rows} {path}");
        ends_with(&desk, ExitCode::SUCCESS, &record);
        let said = ends_with(&desk, ExitCode::SUCCESS, &format!("replay {path}"));
        begins(&said, &format!("{rows} rows of TCD1304DG"));
        assert!(!said.contains("damaged"), "{said}");
        (done, turn) = (done + rows, turn + 1);
        let seconds = desk.board.borrow().statistics().seconds;
        println!("{done} of {wanted} rows are the same, {seconds:.0} s: {scene}, {setting}");
        std::fs::remove_file(&file).expect("the recording");
    }
    desk.board.into_inner().finish().expect("a clean run");
}

#[test]
fn a_file_that_is_no_recording_is_refused() {
    let directory = tempfile::tempdir().expect("a directory");
    let file = directory.path().join("points.csv");
    let mut packets = Packets::default();
    let later = packets.encode(Message::Text(b"slitrange recording 2\r\n"));
    let version = "the recording has version 2, this tool reads 1: update the tool";
    for (bytes, words) in [
        (&b"distance,centre\n800,1770\n"[..], "this is no recording"),
        (later, version),
        (b"", "it is empty: take a recording with `slitrange record`"),
    ] {
        std::fs::write(&file, bytes).expect("a file");
        let error = recording::open(&file).expect_err("no recording");
        assert!(format!("{error:#}").contains(words), "{error:#}");
    }
}

#[test]
fn a_sensor_that_shares_its_line_is_named() {
    let desk = desk();
    for (line, named) in [
        (
            "address 5",
            "a sensor with the address 5 answers at A, and the tool talks to a sensor that is alone on its line: \
             send it the line `@5 address 0` from a terminal",
        ),
        (
            "@5 format modbus",
            "a sensor speaks Modbus at A as station 5: read it by a Modbus master, or let one write 0 to its \
             holding register 4, for text",
        ),
    ] {
        assert!(ask(&desk, line).ends_with(line.trim_start_matches("@5 ")));
        assert_eq!(desk.run("settings --port A").0, Err(named.to_owned()));
    }
}
