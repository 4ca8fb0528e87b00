//! Which serial port a command uses: the one that is named, or the only one where a sensor answers.

use std::fmt::Write as _;

use anyhow::{Error, Result, bail};

use super::line::{Line, LineError};
use super::session::Session;
use crate::pc::Pc;

/// The option `--port` of every command that talks to a sensor.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct PortOption {
    /// The sensor's serial port, such as /dev/ttyACM0 or COM3. Without it, each serial port of this PC is
    /// asked, and the only one where a sensor answers is taken. A pseudo-terminal must be named
    #[arg(long, global = true)]
    pub port: Option<String>,
}

impl PortOption {
    /// Gives the port's name.
    ///
    /// # Errors
    /// No port is named, and a sensor answers at none of the PC's ports, or at several.
    pub fn find(&self, pc: &dyn Pc) -> Result<String> {
        self.port.clone().map_or_else(|| find(pc), Ok)
    }

    /// Opens a session with the sensor at the port.
    ///
    /// # Errors
    /// See [`Self::find`] and [`Session::open`]. If nobody answers, the error names a sensor there that
    /// shares its line.
    pub fn open<'a>(&self, pc: &'a dyn Pc) -> Result<Session<'a>> {
        let port = self.find(pc)?;
        match Session::open(pc, &port) {
            Err(silent @ LineError::Silent { .. }) => {
                let sharing = Line::open(pc, &port)?.find_sharing()?;
                Err(sharing.map_or(silent.into(), Error::msg))
            }
            opened => Ok(opened?),
        }
    }
}

/// Asks each port whether a sensor answers.
fn find(pc: &dyn Pc) -> Result<String> {
    let mut found = Vec::new();
    let mut others = String::new();
    for port in pc.ports() {
        match Line::open(pc, &port).and_then(|mut line| line.find()) {
            Ok(()) => found.push(port),
            // The port's name and what to do are in the error.
            Err(error @ LineError::Port { .. }) => _ = write!(others, "\n{error}"),
            Err(_) => _ = write!(others, "\nno sensor answers at {port}"),
        }
    }
    match found.as_slice() {
        [port] => Ok(port.clone()),
        [] if others.is_empty() => bail!(
            "this PC has no serial port: check that the sensor is plugged in. A pseudo-terminal must be \
             named, with --port"
        ),
        [] => bail!(
            "no sensor is found: check its power and its cable, or name its port with --port{others}"
        ),
        several => bail!(
            "sensors answer at {}: name one of them with --port",
            several.join(" and at ")
        ),
    }
}
