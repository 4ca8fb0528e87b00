//! The shell around the core's session: brings events to it, and carries its actions to the serial line, the
//! measurement and flash.

use core::fmt::{Display, Write as _};

use embassy_time::{Duration, Instant, Timer};
use slitrange::base::units::Units;
use slitrange::row::pixels::flat_field::FlatField;
use slitrange_device::protocol::command::Command;
use slitrange_device::protocol::info::Hardware;
use slitrange_device::protocol::modbus::MAX_BYTES;
use slitrange_device::protocol::packet::{
    Message, Packets, RowHead as RowPacket, RowWords, parts_of_text,
};
use slitrange_device::protocol::row_lines::{ROW_END, RowExposure, RowHead, RowPart, RowPixels};
use slitrange_device::protocol::selftest::RowTest;
use slitrange_device::protocol::status::{StartCause, Vitals};
use slitrange_device::session::flat::{Job, Outcome};
use slitrange_device::session::{Actions, AddressPrefix, Event, Session};
use slitrange_device::settings::Value;
use slitrange_device::settings::trigger::Trigger;
use slitrange_device::store::{Found, Store, pixel_map};
use slitrange_device::text::Text;
use static_cell::ConstStaticCell;

use crate::board::{self, CalibrationFlash, Switch, Transmitter};
use crate::counters::COUNTERS;
use crate::heads;
use crate::requests::{Flat, MEASURING, SETTINGS};
use crate::results::{FrameEnd, RESULTS};
use crate::rows::ROWS;
use crate::trigger::FRAMES;

/// The pixels of a map.
const PIXELS: usize = {
    let light = heads::geometry().light;
    light.end - light.start
};

/// The map of the pixels. All its bytes are zero at first, as `.ccm` wants it.
#[unsafe(link_section = ".ccm.flat")]
static FLAT: ConstStaticCell<FlatField> = ConstStaticCell::new(FlatField::new());

/// See the module.
pub struct Shell {
    tx: Transmitter,
    /// On while the latest distance is within `limits`.
    switch: Switch,
    started_at: Instant,
    /// Number and time of the latest result.
    results: u32,
    result_at: Instant,
    store: Store<CalibrationFlash>,
    session: Session,
    actions: Actions,
    packets: Packets,
    /// The number of the latest row that was sent whole.
    row_sent: Option<u32>,
    /// Until then a person types a line, and readings are left out.
    typing_until: Instant,
}

/// With an address, the sensor waits before it answers: an LF may come behind the CR, and the other side must
/// stop driving the line. It waits for five characters, and at least so long, in us.
const BEFORE_ANSWER_US: u64 = 500;

/// How long readings are left out after a key, unless the line ends before.
const TYPING: Duration = Duration::from_secs(10);

impl Shell {
    /// Starts a session. Not inlined, so that it uses the stack only while it runs.
    #[inline(never)]
    pub fn new(
        tx: Transmitter,
        hardware: Hardware,
        switch: Switch,
        started_by: StartCause,
        flash: CalibrationFlash,
    ) -> Self {
        Self {
            tx,
            switch,
            started_at: Instant::now(),
            results: 0,
            result_at: Instant::MIN,
            store: Store::new(flash),
            session: Session::new(hardware, heads::geometry(), started_by),
            actions: Actions::default(),
            packets: Packets::default(),
            row_sent: None,
            typing_until: Instant::MIN,
        }
    }

    /// Whether a person sees what she types. An echo would tear packets.
    pub fn echoes(&self) -> bool {
        let settings = self.session.settings();
        settings.echo
            && self.address() == 0
            && !self.session.sends_packets()
            && !self.session.speaks_modbus()
    }

    /// Whether the bytes that come are Modbus requests, for [`Self::gather`].
    pub fn speaks_modbus(&self) -> bool {
        self.session.speaks_modbus()
    }

    /// Takes bytes that may end with a Modbus request. Of too many the last are kept, as many as the longest
    /// request has.
    pub fn gather(&mut self, bytes: &[u8]) {
        let gathered = self.packets.buffer();
        if gathered.extend_from_slice(bytes).is_err() {
            let old = gathered.len().saturating_sub(MAX_BYTES);
            gathered.copy_within(old.., 0);
            gathered.truncate(MAX_BYTES);
            // Pieces are shorter than the rest of the buffer.
            let _ = gathered.extend_from_slice(bytes);
        }
    }

    /// Answers the Modbus request that was gathered, and does what it asks for.
    pub async fn answer_request(&mut self) {
        self.replace_request_by_answer();
        self.apply();
        let answer = self.packets.buffer();
        self.tx.send(answer).await;
        answer.clear();
        if self.actions.save {
            MEASURING.pause();
            self.save().await;
        }
    }

    /// The answer takes the request's place. Not inlined, so that it uses the stack only while it runs.
    #[inline(never)]
    fn replace_request_by_answer(&mut self) {
        let vitals = self.vitals();
        let Self {
            session,
            packets,
            actions,
            ..
        } = self;
        let bytes = packets.buffer();
        let answer = session.answer_modbus(bytes, &vitals, actions);
        bytes.clear();
        // An answer is shorter than a packet.
        let _ = bytes.extend_from_slice(&answer.bytes);
        self.update_switch();
    }

    /// The sensor's address on its line; 0 if it is alone.
    pub fn address(&self) -> u16 {
        self.session.connection().address
    }

    /// The silence that ends a Modbus request.
    pub fn modbus_silence(&self) -> Duration {
        Duration::from_micros(self.session.connection().modbus_silence_us())
    }

    async fn set_line(&mut self) {
        let connection = self.session.connection();
        self.tx.set_line(connection.baud, connection.bits).await;
    }

    /// The unit of lengths that name none.
    pub fn units(&self) -> Units {
        self.session.settings().units
    }

    /// Shows what a person types. Readings are left out until the line ends, so that they do not tear it.
    pub async fn show_typed(&mut self, echo: &str, is_empty: bool) {
        self.typing_until = if is_empty {
            Instant::MIN
        } else {
            Instant::now() + TYPING
        };
        self.tx.send(echo.as_bytes()).await;
    }

    /// Loads what flash holds, sends the banner, and lets measuring begin. With `plain`, the answer to `plain
    /// on` is sent in place of the banner.
    pub async fn start(&mut self, plain: bool) {
        let found = self.store.find().await;
        self.start_session(found);
        self.apply();
        if plain {
            self.update_session(Event::Line(Ok(Command::Set(Value::Plain(true)))));
        }
        self.set_line().await;
        self.send().await;
        // No answer is due, so the text is that of the banner.
        self.load_map(FLAT.take()).await;
        MEASURING.resume();
    }

    /// Not inlined, so that it uses the stack only while it runs.
    #[inline(never)]
    fn start_session(&mut self, found: Found) {
        let stored = self.store.stored(found);
        self.session.start(&stored, &mut self.actions);
    }

    /// Takes the result of a frame and carries out the actions.
    pub async fn take_frame(&mut self, frame: FrameEnd) {
        COUNTERS.results.add();
        (self.results, self.result_at) = (frame.number, frame.at);
        self.update_session(Event::Frame(frame.result));
        self.carry_out().await;
    }

    /// Carries out the actions that [`Self::update_session`] left.
    ///
    /// An event has some kilobytes, and a future that held one would take as many of static RAM.
    pub async fn carry_out(&mut self) {
        self.apply();
        if self.actions.save {
            MEASURING.pause();
            self.send().await;
            self.save().await;
        }
        if let Some(job) = self.actions.flat.take() {
            self.send().await;
            self.do_flat(job).await;
            return;
        }
        self.send().await;
        if self.actions.test {
            self.test_row().await;
            return;
        }
        if self.actions.reset {
            self.tx.drain().await;
            board::reset();
        }
        self.set_line().await;
        MEASURING.send_windows(self.session.streams_windows());
        if let Some(part) = self.actions.row.take() {
            self.send_row(part).await;
        }
    }

    /// Whether [`Self::stream_row`] is to be called now.
    pub fn streams_rows(&self) -> bool {
        self.session.streams_rows()
    }

    /// Sends the next row whole, with its result. Takes as long as the line takes for the row: 66 ms at
    /// 921600 baud.
    pub async fn stream_row(&mut self) {
        MEASURING.pause();
        let (exposed, result) = MEASURING.measure_alone().await;
        let (words, number, exposure, at) = match &exposed {
            Some(row) => (row.words.as_slice(), row.number, row.exposure, row.at),
            None => (&[][..], COUNTERS.rows.get(), None, Instant::now()),
        };
        let mut words = RowWords::new(number, words);
        let before = self.row_sent.replace(number);
        let skipped = before.map_or(0, |before| number.wrapping_sub(before).saturating_sub(1));
        let head = Message::Row(RowPacket {
            number,
            skipped,
            time_us: at.saturating_duration_since(self.started_at).as_micros(),
            exposure,
            words: words.left() as u16,
            result,
        });
        self.tx.send(self.packets.encode(head)).await;
        while let Some(message) = words.next_message() {
            self.tx.send(self.packets.encode(message)).await;
            COUNTERS.results.add();
        }
        COUNTERS.results.add();
        if let Some(row) = exposed {
            ROWS.free.send(row.words).await;
        }
        MEASURING.resume();
    }

    /// Sends a row. The row keeps its buffer until its last line is sent; the other buffers take the next
    /// rows.
    async fn send_row(&mut self, part: RowPart) {
        MEASURING.pause();
        let (exposed, measured) = MEASURING.measure_alone().await;
        let region = self.session.settings().searched();
        let geometry = self.session.geometry();
        let (row, exposure) = match &exposed {
            Some(row) => (
                geometry.row(row.words.as_slice()).ok(),
                RowExposure::of_laser(row.exposure),
            ),
            None => (None, RowExposure::Unknown),
        };
        let row = row.unwrap_or_else(|| geometry.empty_row());
        let head = RowHead::new(part, &row, exposure, &measured, region);
        self.send_line(&head).await;
        for line in RowPixels::lines(row.light(), head.sent()) {
            self.send_line(&line).await;
        }
        self.send_line(&ROW_END).await;
        if let Some(exposed) = exposed {
            ROWS.free.send(exposed.words).await;
        }
        // The last lines wait in the transmitter's buffer. A reading behind them would be late.
        while !self.tx.is_empty() {
            Timer::after_millis(10).await;
            COUNTERS.results.add();
        }
        MEASURING.resume();
    }

    /// Sends a line, and counts it as a sign of life.
    async fn send_line(&mut self, line: &dyn Display) {
        self.actions.text.clear();
        // An answer has room for several of the longest lines.
        let _ = write!(self.actions.text, "{line}\r\n");
        self.send_text().await;
        COUNTERS.results.add();
    }

    /// Looks at the next row for `selftest`, and answers.
    async fn test_row(&mut self) {
        MEASURING.pause();
        let (exposed, measured) = MEASURING.measure_alone().await;
        let mut test = None;
        if let Some(exposed) = exposed {
            let geometry = self.session.geometry();
            let row = geometry.row(exposed.words.as_slice()).ok();
            test = row.and_then(|row| RowTest::of(&row, &measured));
            ROWS.free.send(exposed.words).await;
        }
        COUNTERS.results.add();
        MEASURING.resume();
        self.update_session(Event::Tested(test));
        self.send().await;
    }

    /// Does what the session asked for with the map of the pixels. No frame is due meanwhile.
    async fn do_flat(&mut self, job: Job) {
        MEASURING.pause();
        // As in `save`.
        COUNTERS.results.add();
        match job {
            Job::Take(kind) => {
                let taken = MEASURING.take_rows(kind).await;
                if taken.is_ok() {
                    // Lit rows make a map, which is in use from now on.
                    let flat = MEASURING.take_map().await;
                    MEASURING.use_map(flat, true).await;
                }
                self.report_flat(Outcome::Taken(kind, taken)).await;
            }
            Job::Use(on) => {
                let flat = MEASURING.take_map().await;
                MEASURING.use_map(flat, on).await;
            }
            Job::Load => {
                let flat = MEASURING.take_map().await;
                self.load_map(flat).await;
            }
            Job::Save => {
                let flat = MEASURING.take_map().await;
                let saved = match flat.map() {
                    Some(map) => pixel_map::save(self.store.flash(), map).await,
                    // The session asks for a save only with a map.
                    None => Ok(()),
                };
                COUNTERS.results.add();
                self.report_flat(Outcome::Saved(saved)).await;
                // Whether the map is in use does not change.
                let is_on = self.session.is_map_on();
                MEASURING.use_map(flat, is_on).await;
            }
            Job::Erase => {
                let flat = MEASURING.take_map().await;
                flat.place().clear();
                let erased = pixel_map::erase(self.store.flash(), PIXELS).await;
                COUNTERS.results.add();
                self.report_flat(Outcome::Erased(erased)).await;
                MEASURING.use_map(flat, false).await;
            }
        }
        COUNTERS.results.add();
        MEASURING.resume();
    }

    /// Reads the map from flash, and gives it to measuring.
    async fn load_map(&mut self, flat: Flat) {
        let stored = pixel_map::load(self.store.flash(), PIXELS, flat.place()).await;
        let map = flat.map().map(|map| *map.summary());
        MEASURING.use_map(flat, true).await;
        self.report_flat(Outcome::Loaded(stored, map)).await;
    }

    async fn report_flat(&mut self, outcome: Outcome) {
        self.update_session(Event::Flat(outcome));
        self.send().await;
    }

    /// Passes an event to the session, which writes what must be done into `actions`. Call
    /// [`Self::carry_out`] then.
    #[inline(never)]
    pub fn update_session(&mut self, event: Event) {
        let vitals = self.vitals();
        self.session.take(event, &vitals, &mut self.actions);
        self.update_switch();
    }

    fn update_switch(&mut self) {
        self.switch
            .set_level(self.session.is_within_limits().into());
    }

    fn vitals(&self) -> Vitals {
        let since_start = |at: Instant| at.saturating_duration_since(self.started_at).as_micros();
        Vitals {
            results: self.results,
            result_us: since_start(self.result_at),
            ..COUNTERS.vitals(since_start(Instant::now()))
        }
    }

    fn apply(&mut self) {
        if let Some(applied) = self.actions.apply.take() {
            let trigger = applied.settings.trigger;
            board::listen_to_trigger(trigger == Trigger::Pin);
            FRAMES.set_trigger(trigger);
            SETTINGS.signal(applied);
            // Results that wait were measured with the settings before. Measuring runs in this executor, and
            // takes the new settings before the next row.
            let mut are_dropped = false;
            while RESULTS.frames.try_receive().is_ok() {
                COUNTERS.lines_dropped.add();
                are_dropped = true;
            }
            // A command that waits needs another frame.
            if are_dropped && self.session.is_frame_due() {
                FRAMES.start();
            }
        }
        if self.actions.trigger {
            FRAMES.start();
        }
    }

    async fn send(&mut self) {
        if !self.actions.may_drop {
            self.send_text().await;
            return;
        }
        if Instant::now() < self.typing_until {
            return;
        }
        match self.actions.result.take() {
            Some(result) => {
                let packet = self.packets.encode(Message::Result(result));
                self.tx.send_or_drop(packet);
                self.send_window(result.counter);
            }
            None => self.tx.send_or_drop(self.actions.text.as_bytes()),
        }
    }

    /// Sends the pixels around the spot of the latest frame, if there are any. Older ones belong to frames
    /// that answered a command.
    fn send_window(&mut self, counter: u32) {
        while let Ok((at, window)) = RESULTS.windows.try_receive() {
            if at == self.result_at {
                let packet = self.packets.encode(window.message(counter));
                self.tx.send_or_drop(packet);
                return;
            }
        }
    }

    /// Sends the text of an answer, as lines or as packets.
    async fn send_text(&mut self) {
        if !self.session.sends_packets() {
            self.send_lines().await;
            return;
        }
        for part in parts_of_text(self.actions.text.as_str()) {
            self.tx.send(self.packets.encode(Message::Text(part))).await;
        }
    }

    /// Sends the text of an answer as lines, each with the sensor's address if the sensor has one.
    async fn send_lines(&mut self) {
        if self.actions.address == 0 {
            self.tx.send(self.actions.text.as_bytes()).await;
            return;
        }
        if !self.actions.text.as_str().is_empty() {
            let characters = self.session.connection().half_characters_us(10);
            Timer::after_micros(characters.max(BEFORE_ANSWER_US)).await;
        }
        let Self { tx, actions, .. } = self;
        let mut prefix = Text::<5>::default();
        // An address has at most three digits.
        let _ = write!(prefix, "{}", AddressPrefix(actions.address));
        for line in actions
            .text
            .as_bytes()
            .split_inclusive(|&byte| byte == b'\n')
        {
            tx.send(prefix.as_bytes()).await;
            tx.send(line).await;
        }
    }

    /// Writes to flash. No frame is due meanwhile, so the line may be silent for as long as the flash takes.
    async fn save(&mut self) {
        // Signs of life before and after: the first one of the flash may take half a second, and so may the
        // first frame after the save.
        COUNTERS.results.add();
        let result = match self.session.configuration() {
            Some(configuration) => self.store.save(&configuration).await,
            // The session asks for a save only with a configuration.
            None => Ok(()),
        };
        COUNTERS.results.add();
        MEASURING.resume();
        self.update_session(Event::Saved(result));
    }
}
