//! The serial line: sends readings as they come, receives commands and answers them.

use core::task::Poll;

use embassy_futures::poll_once;
use embassy_futures::select::{Either3, select3};
use embassy_time::with_timeout;
use slitrange_device::protocol::info::Hardware;
use slitrange_device::protocol::input::{Echo, Input};
use slitrange_device::protocol::status::StartCause;
use slitrange_device::session::Event;

use crate::board::{CalibrationFlash, Lost, Receiver, SerialPort, Switch};
use crate::counters::COUNTERS;
use crate::results::{IDLE, RESULTS};
use crate::session::Shell;

/// Bytes taken from the receiver at a time.
const PIECE: usize = 64;

/// Serves the line for ever.
///
/// Results go before bytes. At most 175 results come a second, so bytes get their turn, while bytes could
/// come without an end.
#[embassy_executor::task]
pub async fn serve(
    port: SerialPort,
    hardware: Hardware,
    switch: Switch,
    started_by: StartCause,
    starts_plain: bool,
    flash: CalibrationFlash,
) {
    let (tx, mut rx) = port;
    let mut shell = Shell::new(tx, hardware, switch, started_by, flash);
    shell.start(starts_plain).await;
    let (mut input, mut echo) = (Input::new(), Echo::default());
    let mut bytes = [0; PIECE];
    loop {
        if shell.streams_rows() {
            shell.stream_row().await;
            if let Poll::Ready(count) = poll_once(rx.read(&mut bytes)) {
                let received = received(&mut input, &bytes, count);
                take_bytes(&mut shell, &mut input, &mut echo, received).await;
            }
            continue;
        }
        match select3(RESULTS.frames.receive(), rx.read(&mut bytes), IDLE.wait()).await {
            Either3::First(frame) => shell.take_frame(frame).await,
            Either3::Third(()) => COUNTERS.results.add(),
            Either3::Second(count) => {
                if shell.speaks_modbus() {
                    // A request of which bytes were lost has a wrong checksum.
                    shell.gather(&bytes[..count.unwrap_or(0)]);
                    gather_request(&mut shell, &mut rx, &mut bytes).await;
                    shell.answer_request().await;
                } else {
                    let received = received(&mut input, &bytes, count);
                    take_bytes(&mut shell, &mut input, &mut echo, received).await;
                }
            }
        }
    }
}

/// The bytes that came. If some were lost, their line is not taken.
fn received<'a>(input: &mut Input, bytes: &'a [u8], count: Result<usize, Lost>) -> &'a [u8] {
    match count {
        Ok(count) => &bytes[..count],
        Err(Lost) => {
            input.lose_characters();
            &[]
        }
    }
}

/// Takes the results that wait, or measuring's sign of life while it has no results.
async fn take_results(shell: &mut Shell) {
    while let Ok(frame) = RESULTS.frames.try_receive() {
        shell.take_frame(frame).await;
    }
    COUNTERS.results.add_if(IDLE.try_take().is_some());
}

/// Gathers the rest of a Modbus request, up to the silence that ends it. If the computation of a row keeps
/// this task for longer than that, what comes behind the silence is gathered too: the request is what the
/// bytes end with.
async fn gather_request(shell: &mut Shell, rx: &mut Receiver, bytes: &mut [u8; PIECE]) {
    while let Ok(count) = with_timeout(shell.modbus_silence(), rx.read(bytes)).await {
        shell.gather(&bytes[..count.unwrap_or(0)]);
        // Bytes could come without an end.
        take_results(shell).await;
    }
    // A write drops the results that wait.
    take_results(shell).await;
}

/// Takes what a person or a program sent.
async fn take_bytes(shell: &mut Shell, input: &mut Input, echo: &mut Echo, bytes: &[u8]) {
    for &byte in bytes {
        input.set_address(shell.address());
        input.set_units(shell.units());
        let command = if shell.echoes() {
            let command = input.type_in(byte, echo);
            shell.show_typed(echo.as_str(), input.is_empty()).await;
            command
        } else {
            input.take(byte)
        };
        let Some(command) = command else {
            continue;
        };
        shell.update_session(match input.is_for_all() {
            false => Event::Line(command),
            true => Event::LineForAll(command),
        });
        shell.carry_out().await;
        if shell.speaks_modbus() {
            // What follows is no line.
            return;
        }
        // A line full of commands takes seconds to answer.
        take_results(shell).await;
    }
}
