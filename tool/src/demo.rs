//! `demo`: the virtual board as a sensor to talk to, without hardware.
//!
//! The virtual board is a program of its own, `demo`. This module starts it, and ends it.

use std::env;
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};

use crate::pc::Pc;
use crate::sensor::port::PortOption;
use crate::sensor::{MonitorOptions, monitor};

/// The line with which the virtual board names its port.
const PORT: &str = "serial line: ";
/// How long to wait for a line before Ctrl-C is looked for.
const TICK: Duration = Duration::from_millis(50);

/// Start the virtual board: a sensor to talk to, without hardware
///
/// The virtual board runs the firmware on an emulated board with a simulated sensor and target. Its serial
/// line is a pseudo-terminal, whose name is printed: give it to the other commands with --port. Ctrl-C ends
/// the board. The first start compiles the firmware, which takes minutes.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = include_str!("demo.help.txt").trim_ascii_end())]
pub struct DemoOptions {
    /// What the sensor sees: a name that `cargo scene` lists, or the path of a .toml file. Without it, white
    /// paper that moves from 600 to 1020 mm and back
    pub scene: Option<String>,
    /// Open the live view of `monitor` here. Its end is the end of the board
    #[arg(long)]
    pub monitor: bool,
    /// Further options of the virtual board, as `cargo demo --help` lists them
    #[arg(last = true, value_name = "OPTIONS")]
    pub board: Vec<String>,
}

/// `demo`.
pub fn demo(options: &DemoOptions, pc: &dyn Pc, output: &mut dyn Write) -> Result<()> {
    serve(&virtual_board()?, options, pc, output)
}

/// The virtual board's program, which is built beside this one.
fn virtual_board() -> Result<PathBuf> {
    let own = env::current_exe().context("this program's own path is unknown")?;
    let program = own.with_file_name(format!("demo{}", env::consts::EXE_SUFFIX));
    ensure!(
        program.is_file(),
        "the virtual board, {}, is not there: build it with `cargo build --bin demo`",
        program.display()
    );
    Ok(program)
}

/// Starts a virtual board, and stays until somebody presses Ctrl-C, or until the live view ends.
pub fn serve(
    program: &Path,
    options: &DemoOptions,
    pc: &dyn Pc,
    output: &mut dyn Write,
) -> Result<()> {
    // From now on, Ctrl-C ends the loops below, and the board with them.
    pc.interrupted();
    let mut board = Board::start(program, options)?;
    let Some(port) = board.port(pc, output)? else {
        return Ok(());
    };
    if options.monitor {
        // Its messages would spoil the live view.
        board.is_quiet.store(true, Ordering::Relaxed);
        let options = MonitorOptions {
            port: PortOption { port: Some(port) },
            ..MonitorOptions::default()
        };
        return monitor(&options, pc, output);
    }
    let own = own_name();
    writeln!(
        output,
        "The virtual board runs. Ctrl-C ends it. Its serial line is {port}. In another terminal, type:\n\
         \n    {own} monitor --port {port}\
         \n    {own} scope --port {port}\
         \n    {own} settings --port {port}\n"
    )?;
    output.flush()?;
    while let Some(line) = board.next_line(pc)? {
        writeln!(output, "{line}")?;
    }
    Ok(())
}

/// How this program was started, as a person types it.
fn own_name() -> String {
    // `cargo run` sets this variable for the program that it runs.
    match (env::var_os("CARGO"), env::args().next()) {
        (Some(_), _) | (_, None) => "cargo slitrange".to_owned(),
        (None, Some(name)) => name,
    }
}

/// A virtual board that runs until this is dropped.
struct Board {
    child: Child,
    lines: Receiver<String>,
    /// Its messages are no longer shown.
    is_quiet: Arc<AtomicBool>,
}

impl Board {
    fn start(program: &Path, options: &DemoOptions) -> Result<Self> {
        let mut command = Command::new(program);
        command.arg("--pty");
        if let Some(scene) = &options.scene {
            command.args(["--scene", scene]);
        }
        let mut child = command
            .args(&options.board)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            // A terminal shows how far the compiler is. But nothing may write into the live view.
            .stderr(match options.monitor {
                true => Stdio::piped(),
                false => Stdio::inherit(),
            })
            .spawn()
            .with_context(|| format!("{} cannot be started", program.display()))?;
        let is_quiet = Arc::new(AtomicBool::new(false));
        if let Some(messages) = child.stderr.take() {
            let is_quiet = Arc::clone(&is_quiet);
            std::thread::spawn(move || {
                for line in BufReader::new(messages).lines().map_while(Result::ok) {
                    if !is_quiet.load(Ordering::Relaxed) {
                        // Whoever does not read the messages does not need them.
                        let _ = writeln!(io::stderr(), "{line}");
                    }
                }
            });
        }
        let (sender, lines) = channel();
        if let Some(printed) = child.stdout.take() {
            std::thread::spawn(move || {
                let mut printed = BufReader::new(printed).lines().map_while(Result::ok);
                printed.try_for_each(|line| sender.send(line))
            });
        }
        Ok(Self {
            child,
            lines,
            is_quiet,
        })
    }

    /// Waits for the name of its port. `None` after Ctrl-C.
    fn port(&mut self, pc: &dyn Pc, output: &mut dyn Write) -> Result<Option<String>> {
        while let Some(line) = self.next_line(pc)? {
            match line.strip_prefix(PORT) {
                Some(port) => return Ok(Some(port.to_owned())),
                None => writeln!(output, "{line}")?,
            }
        }
        Ok(None)
    }

    /// The next line that it prints. `None` after Ctrl-C.
    fn next_line(&mut self, pc: &dyn Pc) -> Result<Option<String>> {
        loop {
            match self.lines.recv_timeout(TICK) {
                Ok(line) => return Ok(Some(line)),
                Err(_) if pc.interrupted() => return Ok(None),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    let status = self.child.wait().context("waiting for the virtual board")?;
                    // Ctrl-C reaches it, too, and perhaps a moment before this program.
                    std::thread::sleep(TICK);
                    if pc.interrupted() {
                        return Ok(None);
                    }
                    bail!("the virtual board ended ({status})");
                }
            }
        }
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        // It may have ended already. It has nothing to put in order: its flash file is whole at any moment.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
