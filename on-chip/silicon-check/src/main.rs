//! Checks on a NUCLEO-F429ZI what only silicon can show: `cargo silicon-check` flashes and runs it. It needs
//! six jumper wires and no sensor head (docs/silicon-check.md). Its results come in words over the serial
//! port of the ST-LINK, 115200 baud.
//!
//! Board, driver, acquisition, flash and watchdog are the firmware's own files. So the driver that is checked
//! is the driver that is flashed.
#![cfg_attr(target_os = "none", no_std, no_main)]

// The firmware. It has parts that this program does not use.
#[cfg(target_os = "none")]
#[path = "../../../src/acquisition.rs"]
mod acquisition;
#[cfg(target_os = "none")]
#[path = "../../../src/alarm.rs"]
mod alarm;
#[cfg(target_os = "none")]
#[path = "../../../src/board/mod.rs"]
#[allow(dead_code, unused_imports)]
mod board;
#[cfg(target_os = "none")]
#[path = "../../../src/counters.rs"]
#[allow(dead_code)]
mod counters;
#[cfg(target_os = "none")]
#[path = "../../../src/heads/mod.rs"]
#[allow(dead_code, unused_imports)]
mod heads;
#[cfg(target_os = "none")]
#[path = "../../../src/laser_order.rs"]
#[allow(dead_code)]
mod laser_order;
#[cfg(target_os = "none")]
#[path = "../../../src/rows.rs"]
#[allow(dead_code)]
mod rows;
#[cfg(target_os = "none")]
#[path = "../../../src/trigger.rs"]
#[allow(dead_code)]
mod trigger;
#[cfg(target_os = "none")]
#[path = "../../../src/watchdog.rs"]
mod watchdog;

#[cfg(target_os = "none")]
mod estimators;
#[cfg(target_os = "none")]
mod kept;
#[cfg(target_os = "none")]
mod report;
#[cfg(target_os = "none")]
mod wires;

#[cfg(target_os = "none")]
mod pins;

#[cfg(target_os = "none")]
mod checks;

// Only linked: it takes defmt's log to the debug probe.
#[cfg(target_os = "none")]
use defmt_rtt as _;

#[cfg(target_os = "none")]
#[embassy_executor::main]
async fn main(spawner: embassy_executor::Spawner) {
    let board = board::init(heads::MASTER_CLOCK_HZ, heads::SCLK_HZ);
    let sensor = heads::SensorHead::new(board.sensor);

    // As the firmware's start. Spawning fails only if a task is spawned twice.
    let urgent = board::start_urgent_executor();
    urgent.spawn(defmt::unwrap!(acquisition::acquire(sensor)));
    urgent.spawn(defmt::unwrap!(watchdog::watch(
        board.watchdog,
        board.lights
    )));
    // Dropping the output would make the pin an input.
    core::mem::forget(board.switch);
    spawner.spawn(defmt::unwrap!(checks::run(
        board.serial,
        board.flash,
        board.clock,
        board.started_by
    )));
}

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    eprintln!("This runs on a NUCLEO-F429ZI with six jumper wires: `cargo silicon-check`.");
    std::process::ExitCode::FAILURE
}
