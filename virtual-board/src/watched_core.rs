//! Wraps rigless's core to add four things: it can hang or panic at a function ([`crate::hang`]), write to
//! the core's own registers as a debug probe does, record which instructions a function executes
//! ([`crate::trace`]), and erase and program flash ([`crate::flash`]).

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use rigless::emulator::{
    Access, AccessKind, BitAlias, Checked, CoreBus, CoreSpec, DataModel, Error, Exit, HaltReason,
    HostCall, InterruptLine, Processor, Queued,
};
use rigless::soc::{Endian, Width};
use rigless::time::VirtualNanos;

use crate::base::{Nanos, lock};
use crate::flash::{self, SharedFlash};
use crate::forward::forward;
use crate::hang::{Detour, Detours};
use crate::trace::{Recorder, Traces};
use crate::warm_cores::{BoardCore, WarmCores};

/// The core's registers, as GDB numbers those of ARMv7-M.
const STACK_POINTER: usize = 13;
const LINK_REGISTER: usize = 14;
const PROGRAM_COUNTER: usize = 15;

/// The control register of the clocks, and its bit for a ready external clock (RM0090 section 6.3.1).
const RCC_CR: u64 = 0x4002_3800;
const HSERDY: u64 = 1 << 17;

#[derive(Clone, Debug, Default)]
pub(crate) struct Watched {
    pub(crate) detours: Arc<Mutex<Detours>>,
    /// What a debug probe writes next: an address, a word and the time.
    pub(crate) probe_writes: Arc<Mutex<Vec<(u64, u32, Nanos)>>>,
    /// The address that a debug probe is to read, and the value that it has read.
    pub(crate) probe_read: Arc<Mutex<(Option<u64>, Option<u64>)>>,
    pub(crate) traces: Arc<Mutex<Traces>>,
    /// The contents of the four sectors, which are not in its memory map.
    pub(crate) flash: SharedFlash,
    /// Where the firmware continues as soon as it does not sleep.
    pub(crate) jump: Arc<Mutex<Option<Detour>>>,
    /// Whether there is no external clock. rigless's gets ready at any frequency.
    pub(crate) has_no_clock: Arc<AtomicBool>,
    pub(crate) warm_cores: WarmCores,
}

/// Wraps the core that `spec` makes. `watched` controls the wrapped core.
pub(crate) fn wrap(spec: &mut CoreSpec, watched: Watched) {
    let make = Arc::clone(&spec.processor);
    spec.processor = Arc::new(move |endian| {
        Ok(Box::new(Core {
            inner: BoardCore::new(Arc::clone(&make), endian, watched.warm_cores.clone())?,
            watched: watched.clone(),
            detours: Detours::new(),
            traced: BTreeSet::new(),
            recorder: Recorder::default(),
        }))
    });
}

#[derive(Debug)]
struct Core {
    inner: BoardCore,
    watched: Watched,
    /// The addresses at which `inner` stops, and where it continues.
    detours: Detours,
    traced: BTreeSet<u64>,
    recorder: Recorder,
}

impl Core {
    /// Sets the breakpoints of `inner` to `wanted`, and removes all others of `armed`.
    fn arm(inner: &mut BoardCore, armed: &mut BTreeSet<u64>, wanted: &BTreeSet<u64>) {
        if armed == wanted {
            return;
        }
        for &address in wanted.difference(armed) {
            inner.add_breakpoint(address);
        }
        for &address in armed.difference(wanted) {
            inner.remove_breakpoint(address);
        }
        armed.clone_from(wanted);
    }

    fn serve_the_probe(&mut self) {
        let inner = &mut self.inner;
        for (address, word, now) in lock(&self.watched.probe_writes).drain(..) {
            inner.debugger_access(Some(word.into()), address, Width::W32, VirtualNanos(now));
        }
        let mut read = lock(&self.watched.probe_read);
        if let Some(address) = read.0.take() {
            read.1 = inner.debugger_access(None, address, Width::W32, VirtualNanos(0));
        }
    }

    fn arm_detours(&mut self) {
        let wanted = lock(&self.watched.detours);
        if self.detours == *wanted {
            return;
        }
        let addresses = |detours: &Detours| detours.keys().copied().collect();
        let mut armed = addresses(&self.detours);
        Self::arm(&mut self.inner, &mut armed, &addresses(&wanted));
        self.detours.clone_from(&wanted);
    }

    fn take(&mut self, detour: Detour) {
        let mut set = |register, value: u32| {
            self.inner.set_gdb_register(register, &value.to_le_bytes());
        };
        if let Some(stack) = detour.stack {
            set(STACK_POINTER, stack);
        }
        set(PROGRAM_COUNTER, detour.to);
    }

    fn register(&self, number: usize) -> u32 {
        let register = self.inner.gdb_register(number).unwrap_or_default();
        <[u8; 4]>::try_from(register).map_or(0, u32::from_le_bytes)
    }

    /// What the link register holds: the return address of the function that the core has just called.
    fn return_address(&self) -> u64 {
        u64::from(self.register(LINK_REGISTER) & !1)
    }

    fn step(&mut self, bus: &mut BusWithFlash<'_>) -> (Exit, u64) {
        let from = self.inner.pc();
        if self.traced.contains(&from) {
            self.recorder.enter(from, self.return_address());
            self.inner.pass_breakpoint(from);
        }
        bus.steps = true;
        let (exit, ran) = self.inner.run(1, bus);
        bus.steps = false;
        if ran > 0 {
            let done = (self.recorder).step(from, self.inner.pc(), self.return_address());
            lock(&self.watched.traces).calls.extend(done);
        }
        (exit, ran)
    }

    /// Runs as `inner` does, but one instruction at a time during a traced call.
    fn run_traced(&mut self, budget: u32, bus: &mut BusWithFlash<'_>) -> (Exit, u64) {
        let mut total = 0;
        while total < u64::from(budget) {
            let arrived = self.traced.contains(&self.inner.pc());
            let (exit, ran) = if arrived || self.recorder.is_recording() {
                self.step(bus)
            } else {
                // Below `budget`, which is 32 bits.
                self.inner.run((u64::from(budget) - total) as u32, bus)
            };
            total += ran;
            let goes_on = match exit {
                Exit::Budget => ran > 0,
                Exit::Breakpoint => self.traced.contains(&self.inner.pc()),
                _ => false,
            };
            if !goes_on {
                return (exit, total);
            }
        }
        (Exit::Budget, total)
    }
}

/// The core's bus, with flash that can be erased and programmed.
struct BusWithFlash<'a> {
    inner: &'a mut dyn CoreBus,
    flash: SharedFlash,
    has_no_clock: bool,
    steps: bool,
}

impl CoreBus for BusWithFlash<'_> {
    fn access(&mut self, access: Access, from_code: bool) -> Option<u64> {
        if SharedFlash::holds(access.address) {
            return Some(self.flash.access(&access));
        }
        let (address, now) = (access.address, access.virtual_time.0);
        let is_flash_status = address == flash::STATUS && access.kind == AccessKind::Read;
        let mut value = self.inner.access(access, from_code)?;
        if is_flash_status {
            value |= self.flash.busy_bits(now);
        }
        Some(match self.has_no_clock && address == RCC_CR {
            true => value & !HSERDY,
            false => value,
        })
    }

    /// How many instructions the core may run after an access, before it returns.
    fn carry_on(&mut self, instructions: u64, event: Option<VirtualNanos>) -> Option<u32> {
        if self.steps {
            return None;
        }
        self.inner.carry_on(instructions, event)
    }

    forward! { inner:
        fn time(&self, instructions: u64) -> VirtualNanos;
    }

    forward! { inner:
        fn queued(&mut self) -> Vec<Queued>;
        fn acknowledge(&mut self, line: InterruptLine, instructions: u64) -> Option<u64>;
        fn read_checked(&mut self, access: Access, report: bool) -> Option<Checked>;
        fn write_checked(&mut self, access: Access) -> Option<bool>;
        fn stops_before(&mut self, access: &Access) -> bool;
        fn send_trace(&mut self, bytes: &[u8]);
    }
}

impl Processor for Core {
    fn run(&mut self, budget: u32, bus: &mut dyn CoreBus) -> (Exit, u64) {
        let bus = &mut BusWithFlash {
            inner: bus,
            flash: self.watched.flash.clone(),
            has_no_clock: self.watched.has_no_clock.load(Ordering::Relaxed),
            steps: false,
        };
        self.inner.settle();
        self.serve_the_probe();
        self.arm_detours();
        if !self.inner.waiting() {
            let jump = lock(&self.watched.jump).take();
            jump.into_iter().for_each(|jump| self.take(jump));
        }
        Self::arm(
            &mut self.inner,
            &mut self.traced,
            &lock(&self.watched.traces).functions,
        );
        let (exit, ran) = match self.traced.is_empty() {
            true => self.inner.run(budget, bus),
            false => self.run_traced(budget, bus),
        };
        if exit == Exit::Breakpoint
            && let Some(&detour) = self.detours.get(&self.inner.pc())
        {
            self.take(detour);
            return (Exit::Returned, ran);
        }
        (exit, ran)
    }

    /// Maps all memory except the four sectors, whose contents are in [`SharedFlash`].
    unsafe fn map(&mut self, start: u64, length: u64, host: *mut u8, writable: bool) {
        let end = start + length;
        let hole = [flash::BASE, flash::BASE + flash::BYTES as u64];
        let [hole_start, hole_end] = hole.map(|address| address.clamp(start, end));
        for (from, to) in [(start, hole_start), (hole_end, end)] {
            if from < to {
                let host = host.wrapping_add((from - start) as usize);
                // SAFETY: a part of what the caller promises, in whole pages: the hole begins and ends at
                // multiples of 16 KB.
                unsafe { self.inner.map(from, to - from, host, writable) }
            }
        }
    }

    forward! { inner:
        fn retired(&self) -> u64;
        fn maps(&self, start: u64, length: u64) -> bool;
        fn page_size(&self) -> u64;
        fn next_event(&self) -> Option<VirtualNanos>;
        fn waiting(&self) -> bool;
        fn pc(&self) -> u64;
        fn gdb_register(&self, number: usize) -> Option<Vec<u8>>;
        fn target_xml(&self) -> &'static str;
        fn data_model(&self) -> DataModel;
        fn byte_order(&self, address: u64) -> Endian;
        fn save(&self) -> Vec<u8>;
        fn bit_alias(&self, address: u64, width: Width) -> Option<BitAlias>;
        fn own_ranges(&self) -> Vec<Range<u64>>;
        fn host_call(&self, read: &mut dyn FnMut(u64, Width) -> Option<u64>) -> Option<HostCall>;
    }

    forward! { inner:
        fn ask(&mut self, queued: Queued);
        fn boot(&mut self, table: u64, read: &dyn Fn(u64, Width) -> Option<u64>);
        fn reset(&mut self);
        fn take_reset_request(&mut self) -> bool;
        fn on_event(&mut self, now: VirtualNanos);
        fn add_breakpoint(&mut self, address: u64) -> bool;
        fn remove_breakpoint(&mut self, address: u64);
        fn pass_breakpoint(&mut self, address: u64);
        fn attach_debugger(&mut self, attached: bool);
        fn hold_interrupts(&mut self, held: bool);
        fn set_gdb_register(&mut self, number: usize, bytes: &[u8]) -> bool;
        fn debugger_access(&mut self, write: Option<u64>, at: u64, width: Width, now: VirtualNanos) -> Option<u64>;
        fn take_debugger_trace(&mut self) -> Vec<u8>;
        fn load(&mut self, bytes: &[u8]) -> Result<(), Error>;
        fn monitor_command(&mut self, command: &str) -> Option<String>;
        fn debugger_halted(&mut self, why: HaltReason) -> bool;
        fn check_reads(&mut self, every: bool);
        fn check_words(&mut self, words: &[u64]);
        fn answer_host_call(&mut self, answer: Option<u64>);
    }
}
