//! Hanging the firmware at a function, for tests of the watchdog.
//!
//! The emulated flash is read-only for tests too (rigless's STM32F427 has no model of its array, so
//! `Session::flip_bits` refuses it), and a driver reaches memory but no register. So the core is wrapped: it stops
//! before the function's first instruction and goes on at an instruction `b .`, a jump to itself, that the firmware
//! has anyway (cortex-m-rt's default handlers). That is what a function that never returns looks like: interrupts are
//! still served, and only a reset gets the core out.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use rigless::emulator::{
    BitAlias, CoreBus, CoreSpec, DataModel, Error, Exit, HaltReason, HostCall, Processor, Queued,
};
use rigless::image::Image;
use rigless::soc::{Endian, Width};
use rigless::time::VirtualNanos;

/// The Thumb instruction `b .`.
const JUMP_TO_ITSELF: [u8; 2] = 0xE7FE_u16.to_le_bytes();

/// The core's program counter, as GDB numbers the registers of an ARMv7-M core.
const PROGRAM_COUNTER: usize = 15;

/// Where the firmware shall hang.
#[derive(Debug, Default)]
pub struct Hangs {
    /// The first instructions of the functions.
    pub(crate) at: BTreeSet<u64>,
    /// Where it goes on instead: the address of a `b .`.
    pub(crate) trap: u32,
}

/// The address of a `b .` in `image`.
pub(crate) fn find_trap(image: &Image) -> Option<u32> {
    image.segments().find_map(|(address, bytes)| {
        // Segments begin at whole words and an instruction at a whole halfword.
        let (halfwords, _) = bytes.as_chunks::<2>();
        let index = halfwords
            .iter()
            .position(|&halfword| halfword == JUMP_TO_ITSELF)?;
        u32::try_from(address + 2 * index as u64).ok()
    })
}

/// Has the core that `spec` makes hang where `hangs` says.
pub(crate) fn wrap(spec: &mut CoreSpec, hangs: Arc<Mutex<Hangs>>) {
    let make = Arc::clone(&spec.processor);
    spec.processor = Arc::new(move |endian| {
        let hangs = Arc::clone(&hangs);
        Ok(Box::new(Core {
            inner: make(endian)?,
            hangs,
            armed: BTreeSet::new(),
        }))
    });
}

/// rigless's core, which hangs on demand.
#[derive(Debug)]
struct Core {
    inner: Box<dyn Processor>,
    hangs: Arc<Mutex<Hangs>>,
    /// The addresses that `inner` stops at.
    armed: BTreeSet<u64>,
}

impl Processor for Core {
    fn run(&mut self, budget: u32, bus: &mut dyn CoreBus) -> (Exit, u64) {
        let trap = {
            let hangs = self.hangs.lock().unwrap_or_else(PoisonError::into_inner);
            for &address in hangs.at.difference(&self.armed) {
                self.inner.add_breakpoint(address);
            }
            for &address in self.armed.difference(&hangs.at) {
                self.inner.remove_breakpoint(address);
            }
            if self.armed != hangs.at {
                self.armed.clone_from(&hangs.at);
            }
            hangs.trap
        };
        let (exit, ran) = self.inner.run(budget, bus);
        if exit == Exit::Breakpoint && self.armed.contains(&self.inner.pc()) {
            self.inner
                .set_gdb_register(PROGRAM_COUNTER, &trap.to_le_bytes());
            return (Exit::Returned, ran);
        }
        (exit, ran)
    }

    // From here on everything is the inner core's.

    unsafe fn map(&mut self, start: u64, length: u64, host: *mut u8, writable: bool) {
        // SAFETY: the caller's promise, passed on as it is.
        unsafe { self.inner.map(start, length, host, writable) }
    }

    fn retired(&self) -> u64 {
        self.inner.retired()
    }

    fn ask(&mut self, queued: Queued) {
        self.inner.ask(queued);
    }

    fn maps(&self, start: u64, length: u64) -> bool {
        self.inner.maps(start, length)
    }

    fn page_size(&self) -> u64 {
        self.inner.page_size()
    }

    fn boot(&mut self, table: u64, read: &dyn Fn(u64, Width) -> Option<u64>) {
        self.inner.boot(table, read);
    }

    fn reset(&mut self) {
        self.inner.reset();
    }

    fn take_reset_request(&mut self) -> bool {
        self.inner.take_reset_request()
    }

    fn next_event(&self) -> Option<VirtualNanos> {
        self.inner.next_event()
    }

    fn on_event(&mut self, now: VirtualNanos) {
        self.inner.on_event(now);
    }

    fn waiting(&self) -> bool {
        self.inner.waiting()
    }

    fn pc(&self) -> u64 {
        self.inner.pc()
    }

    fn add_breakpoint(&mut self, address: u64) -> bool {
        self.inner.add_breakpoint(address)
    }

    fn remove_breakpoint(&mut self, address: u64) {
        self.inner.remove_breakpoint(address);
    }

    fn pass_breakpoint(&mut self, address: u64) {
        self.inner.pass_breakpoint(address);
    }

    fn attach_debugger(&mut self, attached: bool) {
        self.inner.attach_debugger(attached);
    }

    fn hold_interrupts(&mut self, held: bool) {
        self.inner.hold_interrupts(held);
    }

    fn gdb_register(&self, number: usize) -> Option<Vec<u8>> {
        self.inner.gdb_register(number)
    }

    fn set_gdb_register(&mut self, number: usize, bytes: &[u8]) -> bool {
        self.inner.set_gdb_register(number, bytes)
    }

    fn debugger_access(
        &mut self,
        write: Option<u64>,
        address: u64,
        width: Width,
        now: VirtualNanos,
    ) -> Option<u64> {
        self.inner.debugger_access(write, address, width, now)
    }

    fn take_debugger_trace(&mut self) -> Vec<u8> {
        self.inner.take_debugger_trace()
    }

    fn target_xml(&self) -> &'static str {
        self.inner.target_xml()
    }

    fn data_model(&self) -> DataModel {
        self.inner.data_model()
    }

    fn byte_order(&self, address: u64) -> Endian {
        self.inner.byte_order(address)
    }

    fn save(&self) -> Vec<u8> {
        self.inner.save()
    }

    fn load(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.inner.load(bytes)
    }

    fn monitor_command(&mut self, command: &str) -> Option<String> {
        self.inner.monitor_command(command)
    }

    fn debugger_halted(&mut self, why: HaltReason) -> bool {
        self.inner.debugger_halted(why)
    }

    fn bit_alias(&self, address: u64, width: Width) -> Option<BitAlias> {
        self.inner.bit_alias(address, width)
    }

    fn own_ranges(&self) -> Vec<Range<u64>> {
        self.inner.own_ranges()
    }

    fn check_reads(&mut self, every: bool) {
        self.inner.check_reads(every);
    }

    fn check_words(&mut self, words: &[u64]) {
        self.inner.check_words(words);
    }

    fn host_call(&self, read: &mut dyn FnMut(u64, Width) -> Option<u64>) -> Option<HostCall> {
        self.inner.host_call(read)
    }

    fn answer_host_call(&mut self, answer: Option<u64>) {
        self.inner.answer_host_call(answer);
    }
}
