//! The waits for flash of an STM32F429 at 168 MHz, after ST's reference manual (RM0090, chapter 3.5).
//!
//! Flash gives 128 bits at a time, a *line*, after five wait states. Between flash and core are:
//! * the line that the core reads instructions from now,
//! * the prefetched line: while flash has nothing else to do, it reads the line after the one that it gave
//!   last,
//! * a cache of 64 lines of instructions. A line goes there if it was neither cached nor prefetched. A new
//!   line takes the place of the one that was used least recently,
//! * a cache of 8 lines of data, for tables of weights and constants among the code.
//!
//! The manual does not say everything. The model assumes:
//! * A line from flash costs five cycles more than a line from a cache. If flash is just reading another line
//!   ahead, the core waits until that read has ended, and then for its own line.
//! * A line that the core reads from the cache starts no prefetch.
//! * The caches are empty at the start: other code ran before.

/// The addresses of flash.
const FLASH: std::ops::Range<u32> = 0x0800_0000..0x0820_0000;

/// Wait states: cycles that a line takes beyond the first one.
const WAIT_STATES: u64 = 5;

/// Lines of the two caches.
const INSTRUCTION_LINES: usize = 64;
const DATA_LINES: usize = 8;

/// Bytes of a line, as a power of two.
const LINE: u32 = 4;

/// What is assumed where the manual does not say it, or it depends on the instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Assumption {
    /// As the module says.
    Likely,
    /// Prefetch never helps: each line that is not cached costs its wait states, after those of a read that
    /// was under way. Data are not cached, except for the line that was read last.
    Worst,
}

/// The accelerator between flash and core.
#[derive(Debug)]
pub struct Accelerator {
    assumption: Assumption,
    /// The line that the core reads instructions from.
    current: Option<u32>,
    /// A line that flash reads ahead, and when it is there.
    prefetched: Option<(u32, u64)>,
    instructions: Cache,
    data: Cache,
    /// The cycles so far.
    now: u64,
    /// When flash can begin another read.
    idle_from: u64,
}

impl Accelerator {
    /// With empty caches.
    pub fn new(assumption: Assumption) -> Self {
        let data_lines = match assumption {
            Assumption::Likely => DATA_LINES,
            Assumption::Worst => 1,
        };
        Self {
            assumption,
            current: None,
            prefetched: None,
            instructions: Cache::new(INSTRUCTION_LINES),
            data: Cache::new(data_lines),
            now: 0,
            idle_from: 0,
        }
    }

    /// The cycles so far.
    pub fn cycles(&self) -> u64 {
        self.now
    }

    /// The core works for so many cycles.
    pub fn work(&mut self, cycles: u64) {
        self.now += cycles;
    }

    /// The core fetches an instruction of so many bytes.
    pub fn fetch(&mut self, address: u32, bytes: u32) {
        if !FLASH.contains(&address) {
            return;
        }
        for line in address >> LINE..=(address + bytes - 1) >> LINE {
            if self.current != Some(line) {
                self.fetch_line(line);
                self.current = Some(line);
            }
        }
    }

    fn fetch_line(&mut self, line: u32) {
        if self.instructions.holds(line) {
            return;
        }
        match self.prefetched {
            Some((ahead, ready)) if ahead == line && self.assumption == Assumption::Likely => {
                self.now = self.now.max(ready);
            }
            _ => {
                self.read();
                self.instructions.insert(line);
            }
        }
        let ahead = line + 1;
        if !self.instructions.contains(ahead) {
            let ready = self.now.max(self.idle_from) + WAIT_STATES + 1;
            self.prefetched = Some((ahead, ready));
            self.idle_from = ready;
        }
    }

    /// The core loads so many bytes.
    pub fn load(&mut self, address: u32, bytes: u32) {
        if !FLASH.contains(&address) {
            return;
        }
        for line in address >> LINE..=(address + bytes - 1) >> LINE {
            if !self.data.holds(line) {
                self.read();
                self.data.insert(line);
            }
        }
    }

    /// The core waits for a line from flash.
    fn read(&mut self) {
        let begins = match self.assumption {
            Assumption::Likely => self.now.max(self.idle_from),
            Assumption::Worst => self.now + WAIT_STATES,
        };
        self.now = begins + WAIT_STATES;
        self.idle_from = self.now;
    }
}

/// Lines, the one used last at the end.
#[derive(Debug)]
struct Cache {
    lines: Vec<u32>,
    most: usize,
}

impl Cache {
    fn new(most: usize) -> Self {
        Self {
            lines: Vec::with_capacity(most),
            most,
        }
    }

    fn contains(&self, line: u32) -> bool {
        self.lines.contains(&line)
    }

    /// Whether it has the line, which then is the one used last.
    fn holds(&mut self, line: u32) -> bool {
        let Some(place) = self.lines.iter().rposition(|&held| held == line) else {
            return false;
        };
        self.lines[place..].rotate_left(1);
        true
    }

    fn insert(&mut self, line: u32) {
        if self.lines.len() == self.most {
            self.lines.remove(0);
        }
        self.lines.push(line);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CODE: u32 = 0x0800_0000;

    /// Runs instructions of four bytes and one cycle each.
    fn run(accelerator: &mut Accelerator, addresses: impl IntoIterator<Item = u32>) -> u64 {
        let before = accelerator.cycles();
        for address in addresses {
            accelerator.fetch(address, 4);
            accelerator.work(1);
        }
        accelerator.cycles() - before
    }

    /// A line holds four instructions and takes six cycles to read. So code without jumps takes six cycles a
    /// line with prefetch, and 4 + 5 + 5 in the worst case.
    #[test]
    fn straight_code_waits_for_flash() {
        let lines = 100;
        let code = || (CODE..).step_by(4).take(4 * lines);
        let likely = run(&mut Accelerator::new(Assumption::Likely), code());
        let worst = run(&mut Accelerator::new(Assumption::Worst), code());
        // The first line waits five cycles. Each line after it is there six cycles after the one before. The
        // last line is executed in four.
        assert_eq!(likely, 5 + 6 * (lines as u64 - 1) + 4);
        assert_eq!(worst, 14 * lines as u64);
    }

    /// A loop of 60 lines stays in the cache after some turns; one of 100 lines does not.
    #[test]
    fn a_short_loop_runs_from_the_cache() {
        for assumption in [Assumption::Likely, Assumption::Worst] {
            let mut accelerator = Accelerator::new(assumption);
            let turn = |lines: usize| (CODE..).step_by(4).take(4 * lines);
            for _ in 0..60 {
                run(&mut accelerator, turn(60));
            }
            assert_eq!(run(&mut accelerator, turn(60)), 4 * 60, "{assumption:?}");
            let mut accelerator = Accelerator::new(assumption);
            for _ in 0..100 {
                run(&mut accelerator, turn(100));
            }
            assert!(run(&mut accelerator, turn(100)) > 4 * 100, "{assumption:?}");
        }
    }

    #[test]
    fn data_wait_once_a_line() {
        let table = CODE + 0x1000;
        let mut accelerator = Accelerator::new(Assumption::Likely);
        for address in (table..).step_by(2).take(32) {
            accelerator.load(address, 2);
        }
        assert_eq!(accelerator.cycles(), 4 * 5);
        // Again, from the cache of eight lines.
        accelerator.load(table, 64);
        assert_eq!(accelerator.cycles(), 4 * 5);
        accelerator.load(0x2000_0000, 4);
        assert_eq!(accelerator.cycles(), 4 * 5);
        let mut accelerator = Accelerator::new(Assumption::Worst);
        for address in [table, table + 16, table] {
            accelerator.load(address, 2);
        }
        assert_eq!(accelerator.cycles(), 3 * 10);
    }
}
