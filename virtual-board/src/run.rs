//! Runs the board step by step, from a test or a tool. The emulator has a thread of its own and waits at each
//! stop for the next order. So nothing happens while the caller looks, and the same calls give the same run.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, Result, anyhow, bail, ensure};
use rigless::chip::uart::Rate;
use rigless::emulator::{self, Driver, Finished, Host, Settled, Start, Stop};
use rigless::session::{Reset, Session};
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::rcc;
use rigless::time::VirtualNanos;

use crate::base::{Nanos, lock};
use crate::board::{Conditions, INSTRUCTIONS_PER_SECOND, Nucleo};
use crate::firmware::Firmware;
use crate::flash::{self, SharedFlash};
use crate::hang::{self, Detour};
use crate::pins::Pins;
use crate::random::mixed;
use crate::rtt::{self, Message};
use crate::sensor_head::{LightSource, OpenLine, SensorHead};
use crate::serial_line::{Arrival, Line, SERIAL_PORT, SerialLine};
use crate::trace::Call;
use crate::violations::Violation;
use crate::watched_core::Watched;

/// How often the run stops to drain the log and look for violations. A firmware's log buffer holds about as
/// much.
const STEP: Nanos = 1_000_000;

/// The core-coupled RAM and the other RAM: where each begins and ends (RM0090 section 2.3.1).
const RAM: [(u64, u64); 2] = [(0x1000_0000, 0x1001_0000), (0x2000_0000, 0x2003_0000)];

/// The firmware's log: its control block, whether a debug probe reads it, and what it has read.
#[derive(Debug)]
struct Log {
    block: u64,
    is_read: AtomicBool,
    bytes: Mutex<Vec<u8>>,
}

/// A function to run on the emulator's thread, between two instructions.
type Errand = Box<dyn FnOnce(&mut Session<Nucleo>, &mut dyn Host, Stop) + Send>;

enum Order {
    RunTo(Nanos),
    Do(Errand),
    End,
}

/// A NUCLEO-F429ZI that runs slitrange's firmware, under the caller's control.
///
/// # Errors
/// All methods that give a `Result` fail if the emulator failed. A method that lets the board run also fails
/// if the firmware violated a limit of the sensor head or of flash, unless this was expected
/// ([`VirtualBoard::expect_violations`]).
pub struct VirtualBoard {
    firmware: Firmware,
    pins: Arc<Pins>,
    line: Arc<Mutex<SerialLine>>,
    watched: Watched,
    trap: u32,
    log: Arc<Log>,
    orders: Sender<Order>,
    stops: Receiver<Stop>,
    emulator: Option<JoinHandle<Result<Finished<Nucleo, Steps>>>>,
    now: Nanos,
    instructions: u64,
    expects_violations: bool,
}

/// The statistics of a run so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// Virtual time since power-on, s.
    pub seconds: f64,
    /// Instructions that the core executed.
    pub instructions: u64,
    /// Rows read since power-on.
    pub rows: u64,
}

impl Statistics {
    /// The statistics of the time since others of the same run.
    pub fn since(&self, before: &Self) -> Self {
        Self {
            seconds: self.seconds - before.seconds,
            instructions: self.instructions - before.instructions,
            rows: self.rows - before.rows,
        }
    }

    /// The share of the time in which the core executed nothing, 0 to 1.
    pub fn asleep(&self) -> f64 {
        1.0 - self.instructions as f64 / (INSTRUCTIONS_PER_SECOND as f64 * self.seconds)
    }
}

impl VirtualBoard {
    /// Makes a board, flashes it with `firmware`, and stops it before its first instruction. `light` is the
    /// light on its sensor.
    ///
    /// # Errors
    /// The emulator refuses the board or the firmware.
    pub fn power_on(firmware: &Firmware, light: LightSource) -> Result<Self> {
        Self::power_on_under(firmware, light, Conditions::default())
    }

    /// As [`VirtualBoard::power_on`], under other conditions.
    ///
    /// # Errors
    /// The emulator refuses the board or the firmware, or the firmware uses the sectors of the flash.
    pub fn power_on_under(
        firmware: &Firmware,
        light: LightSource,
        conditions: Conditions,
    ) -> Result<Self> {
        for (address, bytes) in firmware.image.segments() {
            let end = address + bytes.len() as u64;
            let store = flash::BASE..flash::BASE + flash::BYTES as u64;
            ensure!(
                end <= store.start || address >= store.end,
                "the firmware has something at {address:#010x} to {end:#010x}, \
                 where the calibration is kept: does memory.x reserve it?"
            );
        }
        let flash = conditions.flash.clone();
        flash.power_on(conditions.flash_word);
        let mut head = SensorHead::new(light);
        head.has_rate_limit = conditions.has_rate_limit;
        let line = Arc::<Mutex<SerialLine>>::default();
        let pins = Pins::new(head, conditions.jumpers, Arc::clone(&line));
        let trap = hang::find_trap(&firmware.image)
            .context("the firmware has no `b .`, which hang_at needs")?;
        let watched = Watched {
            flash,
            has_no_clock: Arc::new(AtomicBool::new(!conditions.has_clock)),
            warm_cores: firmware.warm_cores.clone(),
            ..Watched::default()
        };
        let log = Arc::new(Log {
            block: firmware.address_of("_SEGGER_RTT")?,
            is_read: AtomicBool::new(true),
            bytes: Mutex::default(),
        });
        let (orders, taken_orders) = channel();
        let (reported_stops, stops) = channel();
        let steps = Steps {
            orders: taken_orders,
            stops: reported_stops,
            pins: Arc::clone(&pins),
            flash: watched.flash.clone(),
            log: Arc::clone(&log),
        };
        let board = Nucleo::new(&pins, Arc::clone(&line), watched.clone(), &conditions)?;
        let session = Session::new(Box::new(board), 0, VirtualNanos(0))
            .context("opening the emulator's session")?;
        let images = [firmware.image.clone()];
        let emulator = std::thread::Builder::new()
            .name("emulator".to_owned())
            .spawn(move || Ok(emulator::run(session, &Start::new(&images), steps)?))
            .context("the emulator's thread did not start")?;
        let mut board = Self {
            firmware: firmware.clone(),
            pins,
            line,
            watched,
            trap,
            log,
            orders,
            stops,
            emulator: Some(emulator),
            now: 0,
            instructions: 0,
            expects_violations: false,
        };
        board.await_stop()?;
        Ok(board)
    }

    /// Virtual time since power-on. The core may be up to one instruction ahead.
    pub fn now(&self) -> Nanos {
        self.now
    }

    /// Lets the board run for `time`.
    pub fn run_for(&mut self, time: Duration) -> Result<()> {
        self.run_to(self.now() + nanos(time))
    }

    /// Lets the board run until a line arrives that `wanted` accepts, and returns it. Lines that arrived
    /// before count too, unless another wait has already seen them.
    ///
    /// # Errors
    /// The line does not arrive within `timeout` of virtual time.
    pub fn run_until_line(
        &mut self,
        mut wanted: impl FnMut(&str) -> bool,
        timeout: Duration,
    ) -> Result<Line> {
        let line = self.run_until(timeout, |board| board.line().find(&mut wanted))?;
        line.with_context(|| {
            let tail = self.line().tail();
            format!("the awaited line did not come within {timeout:?}; the last that came: {tail}")
        })
    }

    fn run_until<T>(
        &mut self,
        timeout: Duration,
        mut find: impl FnMut(&mut Self) -> Option<T>,
    ) -> Result<Option<T>> {
        let deadline = self.now() + nanos(timeout);
        loop {
            let found = find(self);
            if found.is_some() || self.now() >= deadline {
                return Ok(found);
            }
            self.run_to(deadline.min(self.next_step()))?;
        }
    }

    /// Lets the board run until `count` more rows have been read.
    ///
    /// # Errors
    /// The rows are not read within `timeout` of virtual time.
    pub fn run_until_rows(&mut self, count: u64, timeout: Duration) -> Result<()> {
        let first = self.statistics().rows;
        let read = |board: &Self| board.statistics().rows - first;
        let all = self.run_until(timeout, |board| (read(board) >= count).then_some(()))?;
        let read = read(self);
        all.with_context(|| format!("{read} of {count} rows were read within {timeout:?}"))
    }

    /// Sends `text` to the firmware from now on.
    pub fn send(&mut self, text: &str) {
        self.send_at(self.now(), text.as_bytes());
    }

    /// Sends a command that the firmware answers by repeating it, as one that sets a value.
    ///
    /// # Errors
    /// The firmware does not repeat the command within `timeout`.
    pub fn tell(&mut self, command: &str, timeout: Duration) -> Result<()> {
        self.send(&format!("{command}\r\n"));
        self.run_until_line(|line| line == command, timeout)
            .with_context(|| format!("the firmware did not take the command `{command}`"))?;
        Ok(())
    }

    /// Sends `bytes` to the firmware from `at` on, after all bytes that still wait.
    pub fn send_at(&mut self, at: Nanos, bytes: &[u8]) {
        self.line().say(at.max(self.now()), bytes);
    }

    /// Takes the lines that the firmware sent since the last call.
    pub fn take_lines(&mut self) -> Vec<Line> {
        self.line().take_lines()
    }

    /// Takes the bytes that the firmware sent since the last call, each with the end of its stop bit.
    pub fn take_bytes(&mut self) -> Vec<(Nanos, u8)> {
        std::mem::take(&mut self.line().bytes)
    }

    /// Takes the edges of the pin that enables the serial line's driver since the last call: when, and
    /// whether it rose.
    pub fn take_driver_edges(&mut self) -> Vec<(Nanos, bool)> {
        std::mem::take(&mut self.line().driver)
    }

    /// Takes the messages of the firmware's log since the last call.
    pub fn take_log(&mut self) -> Vec<Message> {
        let mut bytes = lock(&self.log.bytes);
        rtt::decode(&self.firmware.log_table, &mut bytes)
    }

    /// Lets a debug probe ask for the log's blocking mode, as probe-rs does, and never read the log again.
    ///
    /// # Errors
    /// The firmware has no log.
    pub fn lose_log_reader(&mut self) -> Result<()> {
        self.log.is_read.store(false, Ordering::Relaxed);
        let block = self.log.block;
        self.on_emulator(move |_, host, _| rtt::set_blocking(host, block))?
    }

    /// The size of the log's buffer in bytes, and where in it the firmware writes next.
    pub fn log_size_and_place(&mut self) -> Result<[u64; 2]> {
        let block = self.log.block;
        self.on_emulator(move |_, host, _| rtt::size_and_place(host, block))?
    }

    /// Garbles the bytes that the firmware receives from now on. Of a million bytes, `noise` have noise and
    /// `framing` have a framing error, each with flipped bits. `seed` decides which bytes.
    pub fn garble_serial_line(&mut self, noise: u32, framing: u32, seed: u64) -> Result<()> {
        self.on_emulator(move |session, _, _| {
            let errors = session.board_mut().processor.part.usart[SERIAL_PORT].errors_mut();
            errors.seed = seed;
            errors.noise = rate("noise", noise);
            errors.framing = rate("framing", framing);
        })
    }

    /// Lets the firmware's receiver take these bytes, one every 100 us, while the board runs. The line must
    /// have 115200 baud, and no other byte may wait.
    pub fn arrive(&mut self, arrivals: &[Arrival]) -> Result<()> {
        for arrival in arrivals {
            let has_stop_bit = arrival.has_stop_bit;
            let flipped = self.on_emulator(move |session, _, _| {
                let errors = session.board_mut().processor.part.usart[SERIAL_PORT].errors_mut();
                let without_stop_bit = if has_stop_bit { 0 } else { Rate::EVERY_WORD };
                errors.framing = rate("framing", without_stop_bit);
                // The emulator flips bits of a byte with a framing error: those that it would flip next.
                let mut next = *errors;
                next.next(u8::BITS).flipped
            })?;
            let [flipped, _] = flipped.to_le_bytes();
            // Later than now: the far end is asked for bytes at the next stop.
            self.send_at(self.now() + 1, &[arrival.byte ^ flipped]);
            self.run_for(Duration::from_micros(100))?;
        }
        self.garble_serial_line(0, 0, 1)
    }

    /// Shows the sensor `light` from the next read-out on.
    pub fn set_light(&mut self, light: LightSource) {
        lock(&self.pins.head).light = light;
    }

    /// Gives access to the sensor head: its rows and violations.
    pub fn head<T>(&mut self, look: impl FnOnce(&mut SensorHead) -> T) -> T {
        look(&mut lock(&self.pins.head))
    }

    /// The flash that outlives this board.
    pub fn flash(&self) -> &SharedFlash {
        &self.watched.flash
    }

    /// Disconnects the converter from the next word on, or connects it again.
    pub fn open_line(&mut self, line: Option<OpenLine>) {
        lock(&self.pins.head).open_line = line;
    }

    /// Pauses SCLK for `pause` after word `word` (from 0) of each read-out to come. `None` ends the pauses.
    pub fn pause_words(&mut self, gap: Option<(u64, Duration)>) -> Result<()> {
        let gap = gap.map(|(word, pause)| (word, nanos(pause)));
        self.on_emulator(move |session, _, _| session.board_mut().processor.pause_words(gap))
    }

    /// The 32-bit word of memory at `address`. For peripherals see [`VirtualBoard::on_emulator`].
    pub fn read_word(&mut self, address: u64) -> Result<u32> {
        Ok(self.read_words(address, 1)?[0])
    }

    /// Reads so many 32-bit words of memory from `address` on.
    ///
    /// # Errors
    /// `address` is not in memory or not a multiple of 4.
    pub fn read_words(&mut self, address: u64, count: usize) -> Result<Vec<u32>> {
        ensure_word(address)?;
        let flash = self.flash().clone();
        let words = self.on_emulator(move |_, host, _| {
            let places = (address..).step_by(4).take(count);
            let mut read = |at| flash.word(at).map_or_else(|| host.read(at, Width::W32), Ok);
            let words = places.map(|at| read(at).map(|word| word as u32));
            words.collect::<Result<_, _>>()
        })?;
        words.with_context(|| format!("reading words from {address:#010x} on"))
    }

    /// Writes 32-bit words of RAM, the first at `address`.
    ///
    /// # Errors
    /// `address` is not in RAM or not a multiple of 4.
    pub fn write_words(&mut self, address: u64, words: Vec<u32>) -> Result<()> {
        ensure_word(address)?;
        let written = self.on_emulator(move |_, host, _| {
            let mut words = (address..).step_by(4).zip(words);
            words.try_for_each(|(address, word)| host.write(address, Width::W32, word.into()))
        })?;
        written.with_context(|| format!("writing the word at {address:#010x}: is it in RAM?"))
    }

    /// Makes the firmware hang at each call of the function `symbol`, also after a reset, until
    /// [`VirtualBoard::unhang`]. Interrupts are still served.
    ///
    /// # Errors
    /// The firmware has no such symbol: it needs `#[unsafe(no_mangle)]` and `#[inline(never)]`.
    pub fn hang_at(&mut self, symbol: &str) -> Result<()> {
        self.detour(symbol, self.trap, None)
    }

    /// Makes the firmware panic at each call of the function `symbol`, also after a reset, until
    /// [`VirtualBoard::unhang`].
    ///
    /// # Errors
    /// As [`VirtualBoard::hang_at`], or the firmware has no function that panics.
    pub fn panic_at(&mut self, symbol: &str) -> Result<()> {
        let panic = u32::try_from(self.firmware.address_of(hang::PANIC)?)?;
        self.detour(symbol, panic, None)
    }

    /// Makes the firmware panic as soon as it does not sleep.
    ///
    /// # Errors
    /// The firmware has no function that panics.
    pub fn panic_now(&mut self) -> Result<()> {
        let to = u32::try_from(self.firmware.address_of(hang::PANIC)?)?;
        self.jump(Detour { to, stack: None });
        Ok(())
    }

    /// Makes the firmware jump to where there is no memory, as soon as it does not sleep.
    pub fn fault_now(&mut self) {
        let to = hang::NO_MEMORY;
        self.jump(Detour { to, stack: None });
    }

    /// Makes the firmware hang with its stack pointer at `stack`, as soon as it does not sleep.
    pub fn hang_now(&mut self, stack: u32) {
        let (to, stack) = (self.trap, Some(stack));
        self.jump(Detour { to, stack });
    }

    fn jump(&mut self, jump: Detour) {
        *lock(&self.watched.jump) = Some(jump);
    }

    /// Ends the clock from the ST-LINK, for good. rigless raises no NMI then, and the chip goes on at its old
    /// speed (silicon: at 16 MHz).
    ///
    /// # Errors
    /// The firmware does not watch the clock: the chip would stand still, with its laser on.
    pub fn end_clock(&mut self) -> Result<()> {
        let is_watched = self.on_emulator(|session, _, _| {
            let (_, clocks) = session.board_mut().processor.part.clocks();
            rcc::cr::CSSON.is_set(clocks.get(rcc::Register::Cr))
        })?;
        ensure!(is_watched, "RCC_CR.CSSON is not set");
        self.watched.has_no_clock.store(true, Ordering::Relaxed);
        // ICSR and its bit NMIPENDSET (ARMv7-M manual, section B3.2.4).
        self.probe_writes(0xE000_ED04, 1 << 31);
        Ok(())
    }

    /// Makes the firmware hang as [`VirtualBoard::hang_at`], with its stack pointer at `stack`.
    pub fn hang_with_stack_at(&mut self, symbol: &str, stack: u32) -> Result<()> {
        self.detour(symbol, self.trap, Some(stack))
    }

    fn detour(&mut self, symbol: &str, to: u32, stack: Option<u32>) -> Result<()> {
        let address = self.firmware.address_of(symbol)?;
        lock(&self.watched.detours).insert(address, Detour { to, stack });
        Ok(())
    }

    /// Lets the function `symbol` run again. A core that already hangs or has panicked needs a reset.
    ///
    /// # Errors
    /// The firmware has no such symbol.
    pub fn unhang(&mut self, symbol: &str) -> Result<()> {
        let address = self.firmware.address_of(symbol)?;
        lock(&self.watched.detours).remove(&address);
        Ok(())
    }

    /// Traces each call of the function at `address` from now on, with the functions that it calls: see
    /// [`crate::trace`].
    pub fn trace_calls_of(&mut self, address: u64) {
        lock(&self.watched.traces).functions.insert(address);
    }

    /// Traces no more calls of the function at `address`.
    pub fn stop_tracing(&mut self, address: u64) {
        lock(&self.watched.traces).functions.remove(&address);
    }

    /// Takes the calls of traced functions that returned since the last call of this method, in the order of
    /// their return.
    pub fn take_calls(&mut self) -> Vec<Call> {
        std::mem::take(&mut lock(&self.watched.traces).calls)
    }

    /// Lets a debug probe write a word to one of the core's own registers (0xE000_0000 to 0xE00F_FFFF),
    /// before the next instruction.
    pub fn probe_writes(&mut self, register: u64, word: u32) {
        let now = self.now();
        lock(&self.watched.probe_writes).push((register, word, now));
    }

    /// Lets a debug probe read a word of one of the core's own registers (0xE000_0000 to 0xE00F_FFFF), after
    /// the next instruction. `None` if the core has no such register.
    pub fn probe_reads(&mut self, register: u64) -> Result<Option<u64>> {
        let read = Arc::clone(&self.watched.probe_read);
        *lock(&read) = (Some(register), None);
        self.run_for(Duration::from_millis(1))?;
        let (_, word) = *lock(&read);
        Ok(word)
    }

    /// Drives the trigger's pin, PA3, low or high.
    pub fn drive_trigger(&mut self, high: bool) -> Result<()> {
        self.on_emulator(move |session, _, stop| {
            let processor = &mut session.board_mut().processor;
            processor.drive_trigger(high, stop.at);
        })
    }

    /// Presses the blue button, or lets go of it.
    pub fn hold_button(&mut self, is_held: bool) -> Result<()> {
        self.on_emulator(move |session, _, stop| {
            let processor = &mut session.board_mut().processor;
            processor.drive_button(is_held, stop.at);
        })
    }

    /// Presses the reset button. The flash does not end what it is doing.
    pub fn reset_pin(&mut self) -> Result<()> {
        let flash = self.flash().clone();
        self.on_emulator(move |session, host, stop| {
            flash.reset(stop.at.0, stop.at.0);
            session.reset_by_pin(stop.at, stop.instruction_count, host);
        })
    }

    /// Lets the supply dip below the level of the brown-out reset, and come back at once. The level must be
    /// above that of the power-down reset (1.7 V), which raises the flags of a power-on. The chip starts with
    /// the flag of a brown-out only (RM0090 section 6.3.21), and with noise in all of its RAM. The flash does
    /// not end what it is doing.
    pub fn dip_supply(&mut self) -> Result<()> {
        let flash = self.flash().clone();
        let done = self.on_emulator(move |session, host, stop| {
            flash.reset(stop.at.0, stop.at.0);
            // rigless knows no brown-out. Its reset by the pin keeps the flags that are raised.
            let (_, clocks) = session.board_mut().processor.part.clocks();
            let flags = clocks.get(rcc::Register::Csr);
            clocks.set(rcc::Register::Csr, rcc::csr::BORRSTF.set(flags, 1));
            session.reset_by_pin(stop.at, stop.instruction_count, host);
            RAM.into_iter()
                .flat_map(|(start, end)| (start..end).step_by(4))
                .try_for_each(|address| {
                    let noise = mixed(stop.at.0 ^ address) & u64::from(u32::MAX);
                    host.write(address, Width::W32, noise)
                })
        })?;
        done.context("filling RAM with noise")
    }

    /// All resets since power-on, each with its instant and cause: the pin (also for a dip of the supply),
    /// the firmware (`Core`) or the watchdog (`Model("IWDG")`).
    pub fn resets(&mut self) -> Result<Vec<Reset>> {
        self.on_emulator(|session, _, _| session.resets().to_vec())
    }

    /// How the run went so far.
    pub fn statistics(&self) -> Statistics {
        Statistics {
            seconds: self.now() as f64 / 1e9,
            instructions: self.instructions,
            rows: lock(&self.pins.head).row_count,
        }
    }

    /// From now on, a violated limit is recorded and does not end the run.
    pub fn expect_violations(&mut self) {
        self.expects_violations = true;
    }

    /// Runs `errand` on the emulator's thread, between two instructions. Use it for what has no method here.
    pub fn on_emulator<T: Send + 'static>(
        &mut self,
        errand: impl FnOnce(&mut Session<Nucleo>, &mut dyn Host, Stop) -> T + Send + 'static,
    ) -> Result<T> {
        let (answer, answered) = channel();
        self.order(Order::Do(Box::new(move |session, host, stop| {
            // This fails only if the caller is gone.
            let _ = answer.send(errand(session, host, stop));
        })))?;
        answered.recv().map_err(|_| self.what_ended_the_run())
    }

    /// Ends the run and reports on it.
    ///
    /// # Errors
    /// Lists all violations (unless they were expected), and all that the firmware did that the emulated
    /// processor does not model, or that the manual forbids.
    pub fn finish(mut self) -> Result<Statistics> {
        let statistics = self.statistics();
        self.order(Order::End)?;
        let finished = joined(self.emulator.take().context("the run has ended already")?)?;
        let mut faults = gaps(&finished.session);
        let contentions = finished.session.board().processor.contentions();
        if contentions > 0 {
            let what = format!("{contentions} words on SPI1 had two chips selected");
            faults.push(what);
        }
        if !self.expects_violations {
            faults.extend(self.violations());
        }
        let faults = faults.join("\n  ");
        ensure!(faults.is_empty(), "the run was not clean:\n  {faults}");
        Ok(statistics)
    }

    /// The next instant at which the run stops by itself: after a whole step, or when a byte is due. So a run
    /// is the same however the caller divides it.
    fn next_step(&self) -> Nanos {
        let step = (self.now() / STEP + 1) * STEP;
        let due = self.line().next_due().filter(|&due| due > self.now());
        due.map_or(step, |due| due.min(step))
    }

    fn run_to(&mut self, deadline: Nanos) -> Result<()> {
        while self.now() < deadline {
            let next = deadline.min(self.next_step());
            self.order(Order::RunTo(next))?;
            self.await_stop()?;
            self.now = next;
            if !self.expects_violations && self.violation_count() > 0 {
                bail!(
                    "the firmware violated the limits of the sensor head or of flash:\n  {}",
                    self.violations().join("\n  ")
                );
            }
        }
        Ok(())
    }

    fn violation_count(&self) -> u64 {
        lock(&self.pins.head).violations.count + self.flash().violations().count
    }

    fn violations(&self) -> Vec<String> {
        let of_flash = self.flash().violations();
        let head = lock(&self.pins.head);
        let all = head.violations.first.iter().chain(&of_flash.first);
        let mut lines: Vec<String> = all.map(Violation::to_string).collect();
        drop(head);
        let more = self.violation_count() - lines.len() as u64;
        if more > 0 {
            lines.push(format!("and {more} more"));
        }
        lines
    }

    fn line(&self) -> MutexGuard<'_, SerialLine> {
        lock(&self.line)
    }

    fn order(&mut self, order: Order) -> Result<()> {
        let sent = self.orders.send(order);
        sent.map_err(|_| self.what_ended_the_run())
    }

    fn await_stop(&mut self) -> Result<()> {
        let stop = self.stops.recv().map_err(|_| self.what_ended_the_run())?;
        self.instructions = stop.instruction_count;
        Ok(())
    }

    fn what_ended_the_run(&mut self) -> anyhow::Error {
        match self.emulator.take().map(joined) {
            Some(Err(error)) => error,
            Some(Ok(_)) => anyhow!("the firmware ended the run"),
            None => anyhow!("the run has ended already"),
        }
    }
}

impl Drop for VirtualBoard {
    fn drop(&mut self) {
        if let Some(emulator) = self.emulator.take() {
            // If this fails, the emulator has already ended.
            let _ = self.orders.send(Order::End);
            let _ = emulator.join();
        }
    }
}

fn rate(name: &'static str, per_million: u32) -> Rate {
    Rate { name, per_million }
}

fn ensure_word(address: u64) -> Result<()> {
    ensure!(
        address.is_multiple_of(4),
        "{address:#010x} is not the address of a word: it is no multiple of 4"
    );
    Ok(())
}

fn nanos(time: Duration) -> Nanos {
    Nanos::try_from(time.as_nanos()).unwrap_or(Nanos::MAX)
}

/// Waits for the emulator's thread. A panic on the thread (for example of a light source) becomes an error.
fn joined(
    emulator: JoinHandle<Result<Finished<Nucleo, Steps>>>,
) -> Result<Finished<Nucleo, Steps>> {
    emulator.join().unwrap_or_else(|panic| {
        let words = panic.downcast_ref::<String>().map(String::as_str);
        let words = words
            .or_else(|| panic.downcast_ref::<&str>().copied())
            .unwrap_or("no words");
        Err(anyhow!("the emulator's thread panicked: {words}"))
    })
}

/// Lists what the firmware did that the emulated processor does not model, or that the manual forbids.
fn gaps(session: &Session<Nucleo>) -> Vec<String> {
    let mut gaps: Vec<String> = session.unmapped().iter().map(ToString::to_string).collect();
    for (address, fault) in session.refused() {
        gaps.push(format!("refused at={address:#010x} {fault:?}"));
    }
    for gap in session.unimplemented().values() {
        let (instance, register) = (gap.instance, gap.register);
        let (reads, writes, pc) = (gap.reads, gap.writes, gap.program_counter);
        gaps.push(format!(
            "unimplemented {instance}.{register}: {reads} reads, {writes} writes, first from pc={pc:#010x}"
        ));
    }
    for (address, gap) in session.undefined() {
        let (instance, pc) = (gap.instance, gap.program_counter);
        let from = format!("in {instance}, first from pc={pc:#010x}");
        gaps.push(format!("undefined at={address:#010x} {from}"));
    }
    for (instance, number) in session.unrouted() {
        let what = format!("the core has no line for interrupt {number} of {instance}");
        gaps.push(what);
    }
    for told in session.told() {
        let (instance, register, reason) = (&told.instance, &told.register, &told.reason);
        gaps.push(format!("{instance}.{register}: {reason}"));
    }
    gaps
}

/// The emulator's side: waits at each stop for orders.
#[derive(Debug)]
struct Steps {
    orders: Receiver<Order>,
    stops: Sender<Stop>,
    pins: Arc<Pins>,
    flash: SharedFlash,
    log: Arc<Log>,
}

impl Driver<Nucleo> for Steps {
    fn on_settled(
        &mut self,
        session: &mut Session<Nucleo>,
        _host: &mut dyn Host,
        settled: Settled,
    ) {
        let (now, access) = match settled {
            Settled::Access { access, .. } => (access.virtual_time.0, Some(access)),
            Settled::Stop(stop) => (stop.at.0, None),
            _ => return,
        };
        let processor = &mut session.board_mut().processor;
        self.pins.look_at(processor, now);
        if let Some(end) = (self.flash).look_at(processor.flash_interface(), access.as_ref(), now) {
            processor.word_ends(end, now);
        }
    }

    fn on_stop(
        &mut self,
        session: &mut Session<Nucleo>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        if self.log.is_read.load(Ordering::Relaxed) {
            rtt::drain(host, self.log.block, &mut lock(&self.log.bytes));
        }
        self.stops.send(stop).ok()?;
        loop {
            match self.orders.recv().ok()? {
                Order::RunTo(instant) => return Some(VirtualNanos(instant)),
                Order::Do(errand) => errand(session, host, stop),
                Order::End => return None,
            }
        }
    }
}
