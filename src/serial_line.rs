//! The serial line: sends readings as they come, receives commands and answers them.

use core::task::Poll;

use embassy_futures::poll_once;
use embassy_futures::select::{Either, select};
use embassy_stm32::usart::BufferedUart;
use embedded_io_async::Read as _;
use slitrange::protocol::info::Hardware;
use slitrange::protocol::input::{Echo, Input};
use slitrange::protocol::status::StartCause;
use slitrange::session::Event;

use super::flash::CalibrationFlash;
use super::session::Shell;
use super::shared::RESULTS;
use super::transmitter::Transmitter;

/// Bytes taken from the receiver at a time.
const PIECE: usize = 64;

/// Serves the line for ever.
///
/// Results go before bytes. At most 175 results come a second, so bytes get their turn, while bytes could
/// come without an end.
#[embassy_executor::task]
pub async fn serve(
    uart: BufferedUart<'static>,
    hardware: Hardware,
    started_by: StartCause,
    flash: CalibrationFlash,
) {
    let (tx, mut rx) = uart.split();
    let mut shell = Shell::new(Transmitter::new(tx), hardware, started_by, flash);
    shell.start().await;
    let (mut input, mut echo) = (Input::new(), Echo::default());
    let mut bytes = [0; PIECE];
    loop {
        if shell.streams_rows() {
            shell.stream_row().await;
            if let Poll::Ready(received) = poll_once(rx.read(&mut bytes)) {
                take_bytes(
                    &mut shell,
                    &mut input,
                    &mut echo,
                    &bytes[..received.unwrap_or(0)],
                )
                .await;
            }
            continue;
        }
        match select(RESULTS.receive(), rx.read(&mut bytes)).await {
            Either::First(frame) => shell.take_frame(frame).await,
            Either::Second(received) => {
                // This driver never returns an error: it drops them, and `board` counts them.
                let received = received.unwrap_or(0);
                take_bytes(&mut shell, &mut input, &mut echo, &bytes[..received]).await;
            }
        }
    }
}

/// Takes what a person or a program sent.
async fn take_bytes(shell: &mut Shell, input: &mut Input, echo: &mut Echo, bytes: &[u8]) {
    for &byte in bytes {
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
        shell.take(Event::Line(command)).await;
        // A line full of commands takes seconds to answer: results have their turn in between.
        while let Ok(frame) = RESULTS.try_receive() {
            shell.take_frame(frame).await;
        }
    }
}
