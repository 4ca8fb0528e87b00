//! The contents of the flash sectors that hold calibration and map of the pixels: sectors 12 to 15, the first
//! four of bank 2.
//!
//! rigless models the registers of the flash interface (keys and lock, how long an erase takes, its
//! interrupt) but not the contents. This module adds the contents of the four sectors. They are not in the
//! core's memory map, so each load and store comes here. An erase that the registers begin sets the sector's
//! bits, and a store with PG set clears bits. If silicon would answer with an error, or would stop the core
//! until an erase ends, the access is a [`Violation`](crate::Violation) of the run, and nothing is stored.
//!
//! An erase changes the contents at its begin; the registers report its end after 400 to 800 ms. A word is
//! programmed at once, and the registers say busy for 16 to 100 us (DS9405 table 48). The board's conditions
//! choose both. DMA does not reach the sectors.
//!
//! A [`SharedFlash`] outlives its board: pass it to the next board for a power cycle. It records each
//! operation, and [`History`] gives the contents after any operation, as after a power cut.

mod contents;
mod history;

use std::sync::{Arc, Mutex, MutexGuard};

use rigless::device::RegisterFile;
use rigless::emulator::{Access, AccessKind};
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::flash::{Register, cr, sr};

pub use contents::{BASE, BYTES, Contents, FIRST_SECTOR, Operation, SECTOR_BYTES, SECTORS};
pub use history::{Done, History};

use crate::base::{Nanos, lock};
use crate::violations::Violations;

/// The flash interface's control register (RM0090 section 3.9.8).
const CONTROL: u64 = 0x4002_3C10;

/// The flash interface's status register (RM0090 section 3.9.7).
pub(crate) const STATUS: u64 = 0x4002_3C0C;

/// The flash interface's registers (RM0090 table 1).
const INTERFACE: std::ops::Range<u64> = 0x4002_3C00..0x4002_4000;

/// SNB of sector 12. The other sectors of bank 2 follow (RM0090 section 3.9.8).
const FIRST_SNB: usize = 16;

/// PSIZE for words of 32 bits (RM0090 section 3.9.8).
const WORDS: u64 = 2;

/// The four sectors. A clone is the same flash.
#[derive(Clone, Debug)]
pub struct SharedFlash(Arc<Mutex<Flash>>);

#[derive(Debug)]
struct Flash {
    contents: Contents,
    history: History,
    interface: Interface,
    /// How long a word takes, ns.
    word_time: Nanos,
    /// When the last word was programmed, and whether its end has been reported.
    word_ends: (Nanos, bool),
    /// The operations that are still done before the power is cut.
    operations_left: Option<usize>,
    violations: Violations,
}

/// The bits of the interface's registers that matter here.
#[derive(Clone, Copy, Debug, Default)]
struct Interface {
    unlocked: bool,
    /// A store programs a word.
    programs: bool,
    /// PSIZE is 32 bits.
    takes_words: bool,
    busy: bool,
}

impl Interface {
    fn of(registers: &RegisterFile) -> Self {
        let control = registers.get(Register::Cr);
        let unlocked = !cr::LOCK.is_set(control);
        Self {
            unlocked,
            programs: unlocked && cr::PG.is_set(control),
            takes_words: cr::PSIZE.get(control) == WORDS,
            busy: sr::BSY.is_set(registers.get(Register::Sr)),
        }
    }
}

impl Default for SharedFlash {
    fn default() -> Self {
        Self::holding(Contents::erased())
    }
}

impl SharedFlash {
    /// Flash that holds `contents`.
    pub fn holding(contents: Contents) -> Self {
        Self(Arc::new(Mutex::new(Flash {
            history: History::since(contents.clone()),
            contents,
            interface: Interface::default(),
            word_time: 0,
            word_ends: (0, true),
            operations_left: None,
            violations: Violations::default(),
        })))
    }

    /// The contents now.
    pub fn contents(&self) -> Contents {
        self.lock().contents.clone()
    }

    /// Replaces the contents, as if the chip were exchanged.
    pub fn put(&self, contents: Contents) {
        let mut flash = self.lock();
        flash.history = History::since(contents.clone());
        flash.contents = contents;
    }

    /// Takes the operations since the last call.
    pub fn take_history(&self) -> History {
        let mut flash = self.lock();
        let from_now = History::since(flash.contents.clone());
        std::mem::replace(&mut flash.history, from_now)
    }

    /// The number of operations since the last call of [`SharedFlash::take_history`].
    pub fn operation_count(&self) -> usize {
        self.lock().history.operations.len()
    }

    /// Cuts the power after `operations` more operations: later operations do not reach the flash until
    /// another board is powered on with it.
    pub fn cut_power_after(&self, operations: usize) {
        self.lock().operations_left = Some(operations);
    }

    /// The violations since the last power-on: accesses that silicon answers with an error or by stopping the
    /// core.
    pub fn violations(&self) -> Violations {
        self.lock().violations.clone()
    }

    fn lock(&self) -> MutexGuard<'_, Flash> {
        lock(&self.0)
    }

    /// Resets the interface and the violations: a board with this flash is powered on, of which a word takes
    /// so many ns.
    pub(crate) fn power_on(&self, word_time: Nanos) {
        let mut flash = self.lock();
        flash.word_time = word_time;
        flash.word_ends = (0, true);
        flash.interface = Interface::default();
        flash.operations_left = None;
        flash.violations = Violations::default();
    }

    /// Resets the chip: the operation under way stays half done. `seed` decides how much of it is done. Then
    /// the history starts again with these contents.
    pub(crate) fn reset(&self, now: Nanos, seed: u64) {
        let mut flash = self.lock();
        let is_busy = flash.interface.busy || now < flash.word_ends.0;
        let last = flash.history.operations.len().checked_sub(1);
        if let Some(last) = last.filter(|_| is_busy) {
            flash.contents = flash.history.torn_after(last, seed);
            flash.history = History::since(flash.contents.clone());
        }
        flash.word_ends = (0, true);
        flash.interface = Interface::default();
    }

    pub(crate) fn holds(address: u64) -> bool {
        (BASE..BASE + BYTES as u64).contains(&address)
    }

    pub(crate) fn word(&self, address: u64) -> Option<u64> {
        Self::holds(address).then(|| self.lock().contents.read(address, 4))
    }

    /// Does the core's load or store in one of the sectors. Gives the value that was loaded, or that was to
    /// be stored.
    pub(crate) fn access(&self, access: &Access) -> u64 {
        let mut flash = self.lock();
        match access.kind {
            AccessKind::Read => flash.load(access),
            AccessKind::Write => {
                flash.store(access);
                access.value
            }
        }
    }

    /// The bits of the status register that say busy, while a word is programmed.
    pub(crate) fn busy_bits(&self, now: Nanos) -> u64 {
        sr::BSY.set(0, (now < self.lock().word_ends.0).into())
    }

    /// Reads the interface's registers after `access`, or after an event that may have changed them. Gives
    /// when a word ends, once for each word.
    pub(crate) fn look_at(
        &self,
        registers: &RegisterFile,
        access: Option<&Access>,
        now: Nanos,
    ) -> Option<Nanos> {
        if access.is_some_and(|access| !INTERFACE.contains(&access.address)) {
            return None;
        }
        let mut flash = self.lock();
        let before = std::mem::replace(&mut flash.interface, Interface::of(registers));
        let access = access?;
        if access.kind == AccessKind::Write && access.address == CONTROL {
            if !before.unlocked {
                let what = "the flash's control register was written while it was locked (RM0090 section 3.6.1)";
                flash.violations.add(now, what);
            } else if flash.interface.busy && !before.busy {
                flash.erase(registers.get(Register::Cr), now);
            }
        }
        let (end, is_reported) = flash.word_ends;
        flash.word_ends.1 = true;
        (!is_reported).then_some(end)
    }
}

impl Flash {
    fn is_busy(&self, access: &Access) -> bool {
        self.interface.busy || access.virtual_time.0 < self.word_ends.0
    }

    fn load(&mut self, access: &Access) -> u64 {
        if self.is_busy(access) {
            let address = access.address;
            let what = format!(
                "a load from {address:#010x} while bank 2 is busy: the core stands still meanwhile \
                 (RM0090 section 3.6)"
            );
            self.violations.add(access.virtual_time.0, what);
        }
        self.contents.read(access.address, access.width.bytes())
    }

    fn store(&mut self, access: &Access) {
        let why_not = if self.is_busy(access) {
            "while bank 2 is busy: the core stands still meanwhile (RM0090 section 3.6)"
        } else if !self.interface.programs {
            "without unlocking the flash's control register and setting its PG (RM0090 section 3.6.4)"
        } else if !self.interface.takes_words || access.width != Width::W32 {
            "of another size than PSIZE, or of another one than 32 bits, \
             which is not modelled (RM0090 section 3.6.4)"
        } else {
            // 32 bits.
            let word = access.value as u32;
            let address = access.address;
            let now = access.virtual_time.0;
            self.done(now, Operation::Program { address, word });
            self.word_ends = (now + self.word_time, self.word_time == 0);
            return;
        };
        let what = format!("a store to {:#010x} {why_not}", access.address);
        self.violations.add(access.virtual_time.0, what);
    }

    fn erase(&mut self, control: u64, now: Nanos) {
        let is_whole_bank = cr::MER1.is_set(control);
        let number = cr::SNB.get(control) as usize;
        for sector in 0..SECTORS {
            let is_this = cr::SER.is_set(control) && number == FIRST_SNB + sector;
            if is_whole_bank || is_this {
                let sector = FIRST_SECTOR + sector;
                self.done(now, Operation::Erase { sector });
            }
        }
    }

    fn done(&mut self, at: Nanos, operation: Operation) {
        match &mut self.operations_left {
            Some(0) => return,
            Some(left) => *left -= 1,
            None => {}
        }
        self.contents.apply(operation);
        self.history.operations.push(Done { at, operation });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rigless::time::VirtualNanos;

    const READY: Interface = Interface {
        unlocked: true,
        programs: true,
        takes_words: true,
        busy: false,
    };

    fn flash(interface: Interface) -> SharedFlash {
        let flash = SharedFlash::default();
        flash.lock().interface = interface;
        flash
    }

    fn store(flash: &SharedFlash, address: u64, width: Width, value: u64) {
        let access = Access::new(AccessKind::Write, address, width, value);
        flash.access(&access.at(7, VirtualNanos(42)));
    }

    fn load(flash: &SharedFlash, address: u64, width: Width) -> u64 {
        let access = Access::new(AccessKind::Read, address, width, 0);
        flash.access(&access.at(8, VirtualNanos(42)))
    }

    #[test]
    fn a_word_is_programmed_and_read_back_at_any_width() {
        let flash = flash(READY);
        store(&flash, BASE + 8, Width::W32, 0x0403_0201);
        assert_eq!(load(&flash, BASE + 8, Width::W32), 0x0403_0201);
        assert_eq!(load(&flash, BASE + 10, Width::W16), 0x0403);
        assert_eq!(load(&flash, BASE + 9, Width::W8), 0x02);
        assert_eq!(load(&flash, BASE + 7, Width::W8), 0xFF);
        assert_eq!(flash.word(BASE + 8), Some(0x0403_0201));
        assert_eq!(flash.word(BASE + BYTES as u64), None);
        assert_eq!(flash.violations().count, 0);
        let history = flash.take_history();
        let (address, word) = (BASE + 8, 0x0403_0201);
        let operation = Operation::Program { address, word };
        assert_eq!(history.operations, [Done { at: 42, operation }]);
        assert_eq!(history.after(1), flash.contents());
        assert_eq!(history.after(0), Contents::erased());
        assert_eq!(flash.operation_count(), 0, "a new history begins");
    }

    #[test]
    fn stores_that_silicon_refuses_are_violations() {
        type Change = fn(&mut Interface);
        let cases: [(Change, Width, &str); 5] = [
            (|it| *it = Interface::default(), Width::W32, "unlocking"),
            (|it| it.programs = false, Width::W32, "PG"),
            (|it| it.takes_words = false, Width::W32, "PSIZE"),
            (|_| (), Width::W8, "32 bits"),
            (|it| it.busy = true, Width::W32, "busy"),
        ];
        for (change, width, why) in cases {
            let flash = flash(READY);
            change(&mut flash.lock().interface);
            store(&flash, BASE, width, 0);
            let violations = flash.violations().first;
            println!("{violations:?}");
            assert_eq!(violations.len(), 1);
            assert!(violations[0].what.contains(why), "{violations:?}");
            assert_eq!(violations[0].at, 42);
            assert_eq!(flash.contents(), Contents::erased());
            assert_eq!(flash.operation_count(), 0);
        }
        let flash = flash(READY);
        flash.lock().interface.busy = true;
        load(&flash, BASE + 0xFFFC, Width::W32);
        assert_eq!(flash.violations().count, 1, "the core stands still");
    }

    #[test]
    fn an_erase_clears_only_the_sector_that_the_register_names() {
        let erased_by = |control: u64| {
            let flash = SharedFlash::default();
            flash.lock().erase(control, 5);
            let history = flash.take_history();
            [12, 13, 14, 15].map(|sector| history.erases_of(sector))
        };
        // SER is bit 1, SNB begins at bit 3, MER1 is bit 15 (RM0090 section 3.9.8).
        let sector = |snb: u64| erased_by(1 << 1 | snb << 3);
        assert_eq!(sector(16), [1, 0, 0, 0]);
        assert_eq!(sector(17), [0, 1, 0, 0]);
        assert_eq!(sector(19), [0, 0, 0, 1]);
        assert_eq!(sector(20), [0, 0, 0, 0], "another one of bank 2");
        assert_eq!(sector(0), [0, 0, 0, 0], "one of bank 1");
        assert_eq!(erased_by(1 << 15), [1, 1, 1, 1], "the whole bank");
    }

    /// A word that has ended is whole, whatever comes after it.
    #[test]
    fn a_reset_cuts_off_only_what_the_flash_is_doing() {
        const WORD: Nanos = 16_000;
        for (reset_at, is_whole) in [(42 + WORD - 1, false), (42 + WORD, true)] {
            let flash = SharedFlash::default();
            flash.power_on(WORD);
            flash.lock().interface = READY;
            store(&flash, BASE, Width::W32, 0);
            flash.reset(reset_at, 3);
            let word = flash.word(BASE).expect("a word");
            assert_eq!(word == 0, is_whole, "{word:#x}");
            assert!(!flash.lock().interface.unlocked);
        }
        let flash = SharedFlash::holding(Contents::new(vec![0; BYTES]).expect("four sectors"));
        // SER is bit 1, SNB begins at bit 3 (RM0090 section 3.9.8).
        flash.lock().erase(1 << 1 | 16 << 3, 5);
        flash.lock().interface.busy = true;
        flash.reset(6, 3);
        let contents = flash.contents();
        let (sector, others) = contents.bytes().split_at(SECTOR_BYTES);
        assert!(sector.contains(&0) && sector.contains(&0xFF));
        assert!(others.iter().all(|&byte| byte == 0));
    }

    #[test]
    fn nothing_is_stored_between_a_power_cut_and_the_next_power_on() {
        let flash = flash(READY);
        flash.cut_power_after(2);
        for word in 0..4 {
            store(&flash, BASE + 4 * word, Width::W32, word);
        }
        assert_eq!(flash.operation_count(), 2);
        let words = [0, 4, 8, 12].map(|offset| flash.word(BASE + offset).expect("a word"));
        assert_eq!(words, [0, 1, 0xFFFF_FFFF, 0xFFFF_FFFF]);
        flash.power_on(0);
        assert!(!flash.lock().interface.unlocked);
        flash.lock().interface = READY;
        store(&flash, BASE + 8, Width::W32, 9);
        assert_eq!(flash.word(BASE + 8), Some(9));
        assert_eq!(flash.word(BASE), Some(0), "what was there is still there");
    }
}
