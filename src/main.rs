//! The firmware: laser spots in, distances out of the serial line. See the library for how.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod firmware;

#[cfg(target_os = "none")]
#[embassy_executor::main]
async fn main(spawner: embassy_executor::Spawner) {
    use firmware::{acquisition, board, measuring, serial_line, watchdog};

    let board = board::init();

    // Spawning fails only if a task is spawned twice: a programming error, which the first start would show.
    let urgent = board::start_urgent_executor();
    urgent.spawn(defmt::unwrap!(acquisition::acquire(board.sensor)));
    urgent.spawn(defmt::unwrap!(watchdog::watch(board.watchdog)));
    spawner.spawn(defmt::unwrap!(measuring::measure()));
    spawner.spawn(defmt::unwrap!(serial_line::serve(
        board.serial,
        board.started_by,
        board.flash
    )));
}

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    eprintln!(
        "This is the firmware, which runs on a NUCLEO-F429ZI: `cargo board` flashes and runs it, `cargo fw` only"
    );
    eprintln!(
        "builds it. Without the hardware, `cargo demo` runs it on an emulated board with a target that moves."
    );
    std::process::ExitCode::FAILURE
}
