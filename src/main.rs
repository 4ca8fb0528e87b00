//! The firmware: laser spots in, distances out of the serial line.
//!
//! Three tasks and the flash, and what passes between them:
//!
//! ```text
//! acquisition --full rows------> measuring --results---> serial line --records--> flash
//!             <--free rows------           <--requests--
//!             <--laser's order--
//! ```
//!
//! Each of these has its file: [`rows`], [`laser_order`], [`results`], [`requests`].
//!
//! A fourth task feeds the watchdog while all others make progress. Acquisition and watchdog run in an
//! interrupt, above the other tasks, so that a row's computation never shifts the sensor's pulses.
#![cfg_attr(target_os = "none", no_std, no_main)]

// A module uses those before it (host-tests/tests/floors.rs). rustfmt sorts each group.
#[cfg(target_os = "none")]
mod alarm;
#[cfg(target_os = "none")]
mod counters;
#[cfg(target_os = "none")]
mod laser_order;
#[cfg(target_os = "none")]
mod results;
#[cfg(target_os = "none")]
mod trigger;

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod heads;
#[cfg(target_os = "none")]
mod rows;
#[cfg(target_os = "none")]
mod watchdog;

#[cfg(target_os = "none")]
mod acquisition;
#[cfg(target_os = "none")]
mod requests;
#[cfg(target_os = "none")]
mod session;

#[cfg(target_os = "none")]
mod measuring;
#[cfg(target_os = "none")]
mod serial_line;

// Only linked: it takes defmt's log to the debug probe.
#[cfg(target_os = "none")]
use defmt_rtt as _;

#[cfg(target_os = "none")]
#[embassy_executor::main]
async fn main(spawner: embassy_executor::Spawner) {
    let board = board::init(heads::MASTER_CLOCK_HZ, heads::SCLK_HZ);
    let sensor = heads::SensorHead::new(board.sensor);
    let hardware = slitrange_device::protocol::info::Hardware {
        board: board::NAME,
        head: heads::NAME,
        row_us: heads::ROW_PERIOD.as_micros() as u32,
        longest_exposure: heads::LONGEST_EXPOSURE,
        clock: board.clock,
        brown_out: board.brown_out,
        last_stop: board.last_stop,
    };

    // Spawning fails only if a task is spawned twice: a programming error, which the first start would show.
    let urgent = board::start_urgent_executor();
    urgent.spawn(defmt::unwrap!(acquisition::acquire(sensor)));
    urgent.spawn(defmt::unwrap!(watchdog::watch(
        board.watchdog,
        board.lights
    )));
    spawner.spawn(defmt::unwrap!(measuring::measure()));
    spawner.spawn(defmt::unwrap!(serial_line::serve(
        board.serial,
        hardware,
        board.switch,
        board.started_by,
        board.starts_plain,
        board.flash
    )));
}

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    eprintln!(
        "This is the firmware, which runs on a NUCLEO-F429ZI: `cargo board` flashes and runs it, \
         `cargo fw` only"
    );
    eprintln!(
        "builds it. Without the hardware, `cargo demo` runs it on an emulated board with a target that moves."
    );
    std::process::ExitCode::FAILURE
}
