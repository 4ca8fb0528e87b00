//! Functions that the tests share: they boot a board and ask it. Also the imports that most tests need.

pub use rand::{Rng, SeedableRng};
pub use rand_chacha::ChaCha8Rng;
use rigless::soc::stm32f427::generated::spi1;
pub use rigless::soc::stm32f427::generated::usart6::Register as Usart;
pub use simulator::scene::{Scene, Simulation, Spot};
pub use simulator::with;
pub use slitrange::base::exposure::ExposureMode;
pub use slitrange::frame::comb::Slits;
pub use slitrange::{
    BlackLevel, Calibration, CalibrationErrors, Counts, Estimator, Fault, Mean, Measurement,
    Micrometres, Options, Pixels, sensor_heads,
};
pub use slitrange_device::protocol::calibration::FlashStatus;
pub use slitrange_device::protocol::piece::Piece;
pub use slitrange_device::protocol::refusal::Refusal;
pub use slitrange_device::protocol::row_lines::{ROW_END, RowPixels};
pub use slitrange_device::record::Record;
pub use slitrange_device::record::encoded::EncodedRecord;
pub use slitrange_device::settings::Settings;
pub use slitrange_device::store::Stored;
pub use slitrange_device::store::configuration::Configuration;
pub use slitrange_device::store::pixel_map::StoredMap;
use std::ops::{Deref, DerefMut};
pub use std::sync::OnceLock;
pub use std::time::Duration;
use virtual_board::Statistics;
pub use virtual_board::board::Conditions;
use virtual_board::board::INSTRUCTIONS_PER_SECOND;
pub use virtual_board::flash::{BASE, BYTES, Contents, Operation, SECTOR_BYTES};
pub use virtual_board::light::{LIGHT, Target, of_scene};
use virtual_board::port_pin::{OUTPUT, Pin};
use virtual_board::stm32f429::Stm32f429;
pub use virtual_board::{
    Exposure, Firmware, LightSource, Line, Nanos, OpenLine, PIXELS, Row, SharedFlash, VirtualBoard,
};

/// The longest wait in virtual time: longer than any frame and any answer.
pub const PATIENCE: Duration = Duration::from_secs(1);

/// Core cycles that an instruction takes on these boards: 1, or 2 with `SLITRANGE_MIPS=84`.
pub fn cycles_an_instruction() -> f64 {
    INSTRUCTIONS_PER_SECOND as f64 / Conditions::default().instructions_per_second as f64
}

/// How much further apart the times are at which pixels are sampled, in parts of a pixel's time, than with
/// one instruction a cycle. A loop that waits for an edge takes up to 10 instructions a turn, and three of
/// them move a row: the rise of the clock, the start of the transfer, and the end of a word. A pixel lasts
/// 256 cycles.
pub fn slower_sampling() -> f64 {
    30.0 * (cycles_an_instruction() - 1.0) / 256.0
}

pub fn conditions(change: impl FnOnce(&mut Conditions)) -> Conditions {
    with(Conditions::default(), change)
}

/// A board with one instruction a cycle, whatever `SLITRANGE_MIPS` says: for tests of figures that hold at
/// this speed only.
pub fn full_speed() -> Conditions {
    conditions(|it| it.instructions_per_second = INSTRUCTIONS_PER_SECOND)
}

/// SPI1, which serves the converter.
pub const CONVERTER_BUS: usize = 0;

/// A distance in the middle of the calibrated range, m.
pub const DISTANCE: f64 = 0.80;

/// The ELF file that `cargo fw` builds.
pub fn firmware() -> &'static Firmware {
    static FIRMWARE: OnceLock<Firmware> = OnceLock::new();
    FIRMWARE.get_or_init(|| Firmware::build().expect("the firmware builds"))
}

/// A board whose run ends when it is dropped. The run must then have been clean.
pub struct CleanBoard(Option<VirtualBoard>);

impl CleanBoard {
    /// A board before its first instruction.
    pub fn power_on(light: LightSource, conditions: Conditions) -> Self {
        Self::of(VirtualBoard::power_on_under(firmware(), light, conditions))
    }

    pub fn of(board: anyhow::Result<VirtualBoard>) -> Self {
        Self(Some(board.expect("the board starts")))
    }

    pub fn finish(mut self) -> anyhow::Result<Statistics> {
        self.0.take().expect("it is there until its end").finish()
    }
}

impl Drop for CleanBoard {
    fn drop(&mut self) {
        // A test that has failed already must not panic again.
        if let Some(board) = self.0.take()
            && !std::thread::panicking()
        {
            board.finish().expect("a clean run");
        }
    }
}

impl Deref for CleanBoard {
    type Target = VirtualBoard;

    fn deref(&self) -> &VirtualBoard {
        self.0.as_ref().expect("it is there until its end")
    }
}

impl DerefMut for CleanBoard {
    fn deref_mut(&mut self) -> &mut VirtualBoard {
        self.0.as_mut().expect("it is there until its end")
    }
}

pub fn boot(light: LightSource) -> (CleanBoard, Line) {
    boot_under(light, Conditions::default())
}

pub fn boot_under(light: LightSource, conditions: Conditions) -> (CleanBoard, Line) {
    let mut board = CleanBoard::power_on(light, conditions);
    let banner = await_banner(&mut board);
    (board, banner)
}

pub fn boot_with(flash: &SharedFlash, light: LightSource) -> CleanBoard {
    boot_under(light, conditions(|it| it.flash = flash.clone())).0
}

/// Cuts the power and restores it, in this light.
pub fn power_cycle(board: CleanBoard, light: LightSource) -> CleanBoard {
    let flash = board.flash().clone();
    drop(board);
    boot_with(&flash, light)
}

pub fn press_reset(board: &mut VirtualBoard) -> Line {
    board.reset_pin().expect("the emulator");
    await_banner(board)
}

/// The next banner. Its line may begin with text that a reset cut off.
pub fn await_banner(board: &mut VirtualBoard) -> Line {
    await_line(board, |line| line.contains("slitrange "))
}

pub fn await_line(board: &mut VirtualBoard, wanted: impl FnMut(&str) -> bool) -> Line {
    let line = board.run_until_line(wanted, PATIENCE);
    line.unwrap_or_else(|error| panic!("{error:#}"))
}

/// Sends a command and waits for its answer, the same text. Any lines may come before.
#[track_caller]
pub fn tell(board: &mut VirtualBoard, command: &str) {
    board.tell(command, PATIENCE).expect("the same text");
}

pub fn await_text(board: &mut VirtualBoard, text: &str) -> Line {
    let line = board.run_until_line(|line| line == text, PATIENCE);
    line.unwrap_or_else(|error| panic!("{text:?}: {error:#}"))
}

pub fn take_texts(board: &mut VirtualBoard) -> Vec<String> {
    let lines = board.take_lines().into_iter();
    lines.map(|line| line.text).collect()
}

pub fn take_results(board: &mut VirtualBoard) -> Vec<String> {
    let mut lines = take_texts(board);
    lines.retain(|line| is_result(line));
    lines
}

pub fn run_ms(board: &mut VirtualBoard, ms: u64) {
    board.run_for(Duration::from_millis(ms)).expect("a run");
}

pub fn say(board: &mut VirtualBoard, line: &str, ms: u64) {
    board.send(&format!("{line}\r\n"));
    run_ms(board, ms);
}

/// A board with white paper at [`DISTANCE`] and `rows` rows in a frame.
pub fn measuring(rows: u16) -> CleanBoard {
    measuring_in(paper(), rows)
}

pub fn measuring_in(light: LightSource, rows: u16) -> CleanBoard {
    measuring_under(light, rows, Conditions::default())
}

pub fn measuring_under(light: LightSource, rows: u16, conditions: Conditions) -> CleanBoard {
    let (mut board, _) = boot_under(light, conditions);
    set(&mut board, &format!("rows {rows}"));
    board
}

pub fn paper() -> LightSource {
    of_scene(Scene::white_paper(), Target::at(DISTANCE))
}

/// White paper whose spot is `height` counts high and lies at pixel `centre`.
pub fn spot_at(centre: f64, height: f64) -> LightSource {
    // The scene's light is per second. With an exposure of one second it is the height, whatever the
    // firmware's exposure is.
    let scene = Scene::white_paper().with_height(height);
    let mut row = 0;
    Box::new(move |_: &Exposure| {
        row += 1;
        scene.row_with_centre(row, centre, 1.0)
    })
}

pub fn run_into_a_row(board: &mut VirtualBoard) {
    board.run_until_rows(1, PATIENCE).expect("a row");
    run_ms(board, 3);
}

pub fn with_processor<T: Send + 'static>(
    board: &mut VirtualBoard,
    errand: impl FnOnce(&mut Stm32f429) -> T + Send + 'static,
) -> T {
    let done = board.on_emulator(|session, _, _| errand(&mut session.board_mut().processor));
    done.expect("the emulator")
}

/// Changes a register of the serial port, as a flipped bit would.
pub fn change_serial_port(board: &mut VirtualBoard, register: Usart, change: fn(u64) -> u64) {
    // USART3, in rigless's order.
    with_processor(board, move |it| {
        let (_, registers) = it.part.serial_port(2);
        registers.set(register, change(registers.get(register)));
    });
}

/// Garbles so many of a million bytes that the firmware receives from now on.
pub fn garble(board: &mut VirtualBoard, noise: u32, framing: u32) {
    let done = board.garble_serial_line(noise, framing, 3);
    done.expect("the emulator");
}

/// Switches off SPI1's requests for DMA, as a flipped bit in its register would.
pub fn stop_the_transfer(board: &mut VirtualBoard) {
    with_processor(board, |it| {
        it.part.serial(CONVERTER_BUS).1.set(spi1::Register::Cr2, 0)
    });
}

#[track_caller]
pub fn assert_no_reset(board: &mut VirtualBoard) {
    assert_eq!(board.resets().expect("resets"), []);
}

/// The level of a pin. `None` if it is no output.
pub fn output(board: &mut VirtualBoard, port: &'static str, number: u64) -> Option<bool> {
    with_processor(board, move |it| {
        let pin = Pin::of(&it.part, port, number);
        (pin.mode == OUTPUT).then_some(pin.is_high)
    })
}

/// The level of the switching output.
pub fn switching_output(board: &mut VirtualBoard) -> Option<bool> {
    output(board, "GPIOE", 11)
}

/// Whether a line is a frame's result: a reading or a fault.
pub fn is_result(line: &str) -> bool {
    is_reading(line) || line.starts_with("f ")
}

pub fn is_reading(line: &str) -> bool {
    line.starts_with("d ")
}

#[track_caller]
pub fn assert_readings(lines: &[String]) {
    let all = lines.iter().all(|line| is_reading(line));
    assert!(!lines.is_empty() && all, "{lines:#?}");
}

pub fn keep_all_rows(board: &mut VirtualBoard) {
    board.head(|head| head.keeps_all_rows = true);
}

pub fn kept_rows(board: &mut VirtualBoard) -> Vec<Row> {
    board.head(|head| head.rows().cloned().collect())
}

/// Sends a command. Gives the first line after it that is no result.
pub fn ask(board: &mut VirtualBoard, command: &str) -> String {
    board.send(&format!("{command}\r\n"));
    let answer = board.run_until_line(|line| !is_result(line), PATIENCE);
    let answer = answer.unwrap_or_else(|error| panic!("no answer to {command:?}: {error:#}"));
    answer.text
}

/// Sends a command that sets a value. The answer must be the same text.
#[track_caller]
pub fn set(board: &mut VirtualBoard, command: &str) {
    assert_eq!(ask(board, command), command);
}

/// For how long the laser was on since power-on.
pub fn laser_time(board: &mut VirtualBoard) -> virtual_board::Nanos {
    let now = board.now();
    board.head(move |head| head.laser_time(now))
}

/// Runs until the laser has just gone on.
pub fn run_into_a_pulse(board: &mut VirtualBoard) {
    for wanted in [false, true] {
        let is_reached = |board: &mut VirtualBoard| {
            let now = board.now();
            board.head(move |head| head.laser_pulses().any(|it| it.contains(&now)) == wanted)
        };
        while !is_reached(board) {
            board.run_for(Duration::from_micros(20)).expect("a run");
        }
    }
}

pub fn ask_for_lines(board: &mut VirtualBoard, command: &str, count: usize) -> Vec<String> {
    let mut lines = 0;
    ask_until(board, command, |_| {
        lines += 1;
        lines >= count
    })
}

/// Sends a command and gives the answer's lines up to the last one.
pub fn ask_until(
    board: &mut VirtualBoard,
    command: &str,
    mut is_last: impl FnMut(&str) -> bool,
) -> Vec<String> {
    let mut lines = vec![ask(board, command)];
    while !is_last(&lines[lines.len() - 1]) {
        let line = board.run_until_line(|line| !is_result(line), PATIENCE);
        let line = line.unwrap_or_else(|error| panic!("{lines:#?} and then: {error:#}"));
        lines.push(line.text);
    }
    lines
}

/// Stops the stream, and lets the results that wait go.
pub fn stop_the_stream(board: &mut VirtualBoard) {
    set(board, "stream off");
    run_ms(board, 50);
    board.take_lines();
}

/// Sends a command that pauses the stream, which the first line says. Gives the second line.
pub fn ask_in_a_pause(board: &mut VirtualBoard, command: &str, longest: Duration) -> String {
    let pause = ask(board, command);
    let (of, _) = pause.split_once(" pauses the stream").expect("a pause");
    assert!(command.starts_with(of), "{pause}");
    let answer = board.run_until_line(|line| !is_result(line), longest);
    answer.expect("an answer").text
}

/// Saves. An erase takes 400 ms here.
pub fn save(board: &mut VirtualBoard) {
    let answer = ask_in_a_pause(board, "save", Duration::from_millis(900));
    assert_eq!(answer, "save");
}

pub fn results(board: &mut VirtualBoard, count: usize) -> Vec<String> {
    let result = |_| await_line(board, is_result).text;
    (0..count).map(result).collect()
}

/// The next `count` results of frames that began after this call. It skips two: one that waits for the serial
/// line, and one whose frame is not complete.
pub fn fresh_results(board: &mut VirtualBoard, count: usize) -> Vec<String> {
    results(board, 2);
    results(board, count)
}

/// Lines of the answer to `status`.
const STATUS_LINES: usize = 18 + Fault::KINDS;

#[derive(Debug)]
pub struct Status(pub Vec<String>);

impl Status {
    /// Asks for the status. With one row in a frame, the serial line has room for one such answer in 91 ms:
    /// then ask only once.
    pub fn ask(board: &mut VirtualBoard) -> Self {
        Self(ask_for_lines(board, "status", STATUS_LINES))
    }

    pub fn count(&self, name: &str) -> u64 {
        let name = format!("status {name} ");
        let mut lines = self.0.iter();
        let count = lines.find_map(|line| line.strip_prefix(&name)?.parse().ok());
        count.unwrap_or_else(|| panic!("no count of {name:?} in {self:#?}"))
    }

    pub fn faults(&self) -> u64 {
        let names = Fault::NAMES.iter();
        names.map(|name| self.count(&format!("fault {name}"))).sum()
    }

    /// Asserts that nothing was lost: no row, no line and no byte.
    pub fn assert_nothing_lost(&self) {
        self.assert_none(&["rows lost", "rows failed", "fault sensor silent"]);
        self.assert_none(&["lines dropped", "serial overrun"]);
    }

    pub fn assert_none(&self, names: &[&str]) {
        for name in names {
            assert_eq!(self.count(name), 0, "{name}: {self:#?}");
        }
    }
}

pub fn number(line: &str, before: &str, after: &str) -> f64 {
    let parse = || {
        let (_, rest) = line.split_once(before)?;
        let number = match after {
            "" => rest,
            after => rest.split_once(after)?.0,
        };
        number.parse().ok()
    };
    parse().unwrap_or_else(|| panic!("no number between {before:?} and {after:?} in {line:?}"))
}
