//! Cores that have run a program before, with what the emulator translated of it. The next board with the
//! same program continues in one of them. Without this, each test translates the firmware again, which takes
//! most of its time.
//!
//! A board starts in a new core. The firmware switches the MPU on among its first instructions, and then a
//! core drops all its translations. From there on the board continues in a warm core, if one waits: the state
//! moves over ([`Processor::save`], [`Processor::load`]), and the translations of the warm core stay.
//!
//! The run is the same, because a translation holds no state of the program. rigless relies on this for a
//! debugger that goes back: it loads a state into a core that has run (rigless 0.4.0, `Processor::load`).

use std::collections::BTreeMap;
use std::fmt;
use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, MutexGuard};

use rigless::emulator::{Error, Processor, ProcessorConstructor, Queued};
use rigless::soc::{Endian, Width};
use rigless::time::VirtualNanos;

/// The MPU's control register, and its bit that switches the MPU on (ARMv7-M manual, section B3.5.5).
const MPU_CTRL: u64 = 0xE000_ED94;
const ENABLE: u64 = 1;

/// The most cores that wait. A test program runs fewer boards at once.
const MOST: usize = 8;

/// The cores that wait for a board with their program. A clone is the same pool.
#[derive(Clone, Debug, Default)]
pub(crate) struct WarmCores(Arc<Mutex<Vec<Warm>>>);

#[derive(Debug)]
struct Warm {
    core: Box<dyn Processor>,
    places: Vec<Place>,
}

impl WarmCores {
    fn lock(&self) -> MutexGuard<'_, Vec<Warm>> {
        crate::base::lock(&self.0)
    }

    pub(crate) fn count(&self) -> usize {
        self.lock().len()
    }

    fn take(&self, places: &[Place]) -> Option<Box<dyn Processor>> {
        let mut waiting = self.lock();
        let index = waiting.iter().position(|warm| warm.places == places)?;
        Some(waiting.swap_remove(index).core)
    }

    fn give(&self, core: Box<dyn Processor>, places: Vec<Place>) {
        let mut waiting = self.lock();
        if waiting.len() < MOST {
            waiting.push(Warm { core, places });
        }
    }
}

/// Where a piece of memory begins, its length, and whether the program may write to it.
type Place = (u64, u64, bool);

/// A piece of memory in the core, and its bytes in this process.
#[derive(Clone, Copy)]
struct Mapping {
    place: Place,
    host: *mut u8,
}

// SAFETY: only the thread that runs the core uses the pointer, to map the memory into another core.
unsafe impl Send for Mapping {}

/// A board's core, which changes places with a warm core when it can.
pub(crate) struct BoardCore {
    core: Box<dyn Processor>,
    make: ProcessorConstructor,
    endian: Endian,
    pool: WarmCores,
    mappings: Vec<Mapping>,
    breakpoints: BTreeMap<u64, u32>,
    /// The pages whose accesses go to the bus.
    routes: Vec<u64>,
    /// Whether the MPU is on, and the board continues in this core until a reset or a register that is set
    /// from outside.
    is_settled: bool,
    /// Whether the core has something that neither its saved state nor this struct holds.
    is_spoilt: bool,
    /// Whether the program asked for a reset in a core that has left.
    reset_is_asked: bool,
}

impl fmt::Debug for BoardCore {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.core.fmt(formatter)
    }
}

impl Deref for BoardCore {
    type Target = dyn Processor;

    fn deref(&self) -> &Self::Target {
        &*self.core
    }
}

impl DerefMut for BoardCore {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut *self.core
    }
}

impl BoardCore {
    /// A new core. Warm ones come from `pool`, which must be for one program only.
    pub(crate) fn new(
        make: ProcessorConstructor,
        endian: Endian,
        pool: WarmCores,
    ) -> Result<Self, Error> {
        Ok(Self {
            core: make(endian)?,
            make,
            endian,
            pool,
            mappings: Vec::new(),
            breakpoints: BTreeMap::new(),
            routes: Vec::new(),
            is_settled: false,
            is_spoilt: false,
            reset_is_asked: false,
        })
    }

    /// Continues in a warm core, if the MPU is on and this has not been done since the last reset. Call it
    /// between two runs of the core.
    pub(crate) fn settle(&mut self) {
        if self.is_settled || self.is_spoilt {
            return;
        }
        let control = self.debugger_access(None, MPU_CTRL, Width::W32, VirtualNanos(0));
        if control.unwrap_or_default() & ENABLE == 0 {
            return;
        }
        self.is_settled = true;
        if let Some(warm) = self.pool.take(&self.places()) {
            // On an error the board stays where it is.
            let _ = self.move_to(warm);
        }
    }

    fn places(&self) -> Vec<Place> {
        self.mappings.iter().map(|mapping| mapping.place).collect()
    }

    fn move_to(&mut self, mut core: Box<dyn Processor>) -> Result<Box<dyn Processor>, Error> {
        core.load(&self.core.save())?;
        core.take_reset_request();
        // Twice: the new memory may lie where the core had memory of the board before, and the core sees the
        // two as one until it has all of the new.
        for mapping in self.mappings.iter().chain(&self.mappings) {
            let (start, length, is_writable) = mapping.place;
            // SAFETY: what the caller of `map` below has promised.
            unsafe { core.map(start, length, mapping.host, is_writable) };
            if is_writable {
                core.ask(Queued::Invalidate(start, start + length));
            }
        }
        for (&address, &count) in &self.breakpoints {
            for _ in 0..count {
                core.add_breakpoint(address);
                self.core.remove_breakpoint(address);
            }
        }
        for &page in &self.routes {
            core.ask(Queued::Route(page));
            self.core.ask(Queued::Unroute(page));
        }
        debug_assert_eq!(core.retired(), self.core.retired());
        self.reset_is_asked |= self.core.take_reset_request();
        Ok(std::mem::replace(&mut self.core, core))
    }

    /// Lets the core wait for the next board, if it is settled and not spoilt, and continues in a new one.
    ///
    /// The waiting core keeps the addresses of memory that may be freed. It does not use them: rigless keeps
    /// them in its page table only (0.4.0, `emulator/core.rs`), nothing runs a core that waits, and
    /// [`Self::move_to`] maps memory to the same places before the core runs again.
    fn leave(&mut self) {
        if !self.is_settled || self.is_spoilt || std::thread::panicking() {
            return;
        }
        let places = self.places();
        let left = (self.make)(self.endian).and_then(|new| self.move_to(new));
        if let Ok(left) = left {
            self.pool.give(left, places);
        }
    }

    // What follows takes the place of the core's own methods.

    /// As [`Processor::map`].
    ///
    /// # Safety
    /// As [`Processor::map`], until this is dropped.
    pub(crate) unsafe fn map(&mut self, start: u64, length: u64, host: *mut u8, writable: bool) {
        let place = (start, length, writable);
        self.mappings.push(Mapping { place, host });
        // SAFETY: what the caller promises.
        unsafe { self.core.map(start, length, host, writable) }
    }

    /// As [`Processor::reset`], which drops the translations: so it resets a new core.
    pub(crate) fn reset(&mut self) {
        self.leave();
        self.core.reset();
        (self.is_settled, self.reset_is_asked) = (false, false);
    }

    pub(crate) fn take_reset_request(&mut self) -> bool {
        std::mem::take(&mut self.reset_is_asked) | self.core.take_reset_request()
    }

    pub(crate) fn ask(&mut self, queued: Queued) {
        match queued {
            Queued::Route(page) => self.routes.push(page),
            Queued::Unroute(page) => self.routes.retain(|&routed| routed != page),
            // Somebody changes the program: no other board has the same.
            Queued::Invalidate(start, end) if self.is_settled => {
                let of_program = |&(at, length, is_writable): &Place| {
                    !is_writable && start < at + length && at < end
                };
                self.is_spoilt |= self.places().iter().any(of_program);
            }
            _ => {}
        }
        self.core.ask(queued);
    }

    pub(crate) fn add_breakpoint(&mut self, address: u64) -> bool {
        let is_kept = self.core.add_breakpoint(address);
        if is_kept {
            *self.breakpoints.entry(address).or_default() += 1;
        }
        is_kept
    }

    pub(crate) fn remove_breakpoint(&mut self, address: u64) {
        if let Some(count) = self.breakpoints.get_mut(&address) {
            *count -= 1;
            if *count == 0 {
                self.breakpoints.remove(&address);
            }
        }
        self.core.remove_breakpoint(address);
    }

    /// As [`Processor::set_gdb_register`], which drops the translations. So the board moves to a new core for
    /// it, and settles again after it.
    pub(crate) fn set_gdb_register(&mut self, number: usize, bytes: &[u8]) -> bool {
        self.leave();
        self.is_settled = false;
        self.core.set_gdb_register(number, bytes)
    }

    pub(crate) fn pass_breakpoint(&mut self, address: u64) {
        self.is_spoilt = true;
        self.core.pass_breakpoint(address);
    }

    pub(crate) fn attach_debugger(&mut self, attached: bool) {
        self.is_spoilt |= attached;
        self.core.attach_debugger(attached);
    }

    pub(crate) fn hold_interrupts(&mut self, held: bool) {
        self.is_spoilt |= held;
        self.core.hold_interrupts(held);
    }
}

impl Drop for BoardCore {
    fn drop(&mut self) {
        self.leave();
    }
}
