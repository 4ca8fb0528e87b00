//! The core: its cycle counter, by which the sensor's pulses are timed, and two safeguards.

use cortex_m::peripheral::{DWT, SCB};

/// Core and TIM1 run at 168 MHz.
pub const CORE_HZ: u32 = 168_000_000;

/// The core's cycle counter. It wraps every 25 s; differences of shorter times are right.
pub fn cycles() -> u32 {
    DWT::cycle_count()
}

/// Waits until `cycles` after `start`; both less than 12 s from now.
pub fn wait_until(start: u32, cycles: u32) {
    while (self::cycles().wrapping_sub(start).wrapping_sub(cycles) as i32) < 0 {}
}

/// Whole core cycles in a time, rounded up.
pub const fn cycles_in_ns(ns: u32) -> u32 {
    (ns as u64 * CORE_HZ as u64).div_ceil(1_000_000_000) as u32
}

/// Resets the chip: it starts as after power-on.
pub fn reset() -> ! {
    SCB::sys_reset()
}

unsafe extern "C" {
    /// The end of the statics. The stack grows down towards it.
    static __sheap: u8;
}

/// Bytes of the guard between stack and statics: more than most functions take at a time.
const STACK_GUARD: usize = 4096;

/// Starts the cycle counter, and sets up the safeguards.
pub fn set_up() {
    // SAFETY: called once, before anything else could use these registers.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();

    // Erratum 838869 of the core, in all revisions of the chip: a store that is buffered may let an interrupt
    // come twice (errata sheet ES0206, section 2.1.3). DISDEFWBUF switches the buffer off.
    const DISDEFWBUF: u32 = 1 << 1;
    // SAFETY: the bit changes the order in which stores reach memory, and no program depends on that order.
    unsafe { core.ICB.actlr.modify(|actlr| actlr | DISDEFWBUF) };

    // An access to the guard is a fault, after which the watchdog starts the board again. Region 0, no
    // access, no code; elsewhere the memory is as without a guard (ARMv7-M manual, section B3.5).
    let guard = (&raw const __sheap).addr().next_multiple_of(STACK_GUARD) as u32;
    const VALID_REGION_0: u32 = 1 << 4;
    const NO_CODE: u32 = 1 << 28;
    const SIZE: u32 = (STACK_GUARD.ilog2() - 1) << 1;
    const ENABLE: u32 = 1;
    const ELSEWHERE_AS_BEFORE: u32 = 1 << 2;
    // SAFETY: nothing but a stack that is too deep uses the memory of the guard.
    unsafe {
        core.MPU.rbar.write(guard | VALID_REGION_0);
        core.MPU.rasr.write(NO_CODE | SIZE | ENABLE);
        core.MPU.ctrl.write(ELSEWHERE_AS_BEFORE | ENABLE);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}
