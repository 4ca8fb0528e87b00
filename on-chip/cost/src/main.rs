//! Counts what each method takes on the chip, by the core's cycle counter. On the emulated board a cycle is
//! an instruction; on a NUCLEO-F429ZI it is what it is.
//!
//! Each result is a line of the log, in words and numbers that a person and `cargo cost` read alike; the last
//! is `end`.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod chip;

#[cfg(target_os = "none")]
#[cortex_m_rt::entry]
fn main() -> ! {
    chip::board::init();
    chip::counter::check();
    chip::methods::measure();
    chip::steps::measure();
    chip::whole_rows::measure();
    chip::distances::measure();
    chip::float_functions::measure();
    chip::peers::measure();
    chip::kernels::compare();
    defmt::println!("end");
    chip::board::end_the_log();
    // From now on the program measures the rows that it is given.
    chip::whole_rows::serve()
}

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    eprintln!(
        "This counts cycles on a NUCLEO-F429ZI: `cargo cost --board` flashes and runs it.\n\
         `cargo cost` runs it on an emulated board, without the hardware."
    );
    std::process::ExitCode::FAILURE
}
