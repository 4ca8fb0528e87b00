//! Builds or loads the firmware's ELF file, with the symbols and the log table that the emulator and the log
//! decoder need.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use rigless::image::Image;
use rigless::symbols::Symbols;

use crate::warm_cores::WarmCores;

/// Variables that cargo sets for us, or that hold compiler flags meant for the PC (coverage,
/// `target-cpu=native`, the time of each test). If the nested build inherited them, it would rebuild the
/// firmware, or fail.
const NOT_FOR_THE_CHIP: [&str; 7] = [
    "RUSTFLAGS",
    "CARGO_ENCODED_RUSTFLAGS",
    "CARGO_BUILD_TARGET",
    "RUSTC_BOOTSTRAP",
    "RUSTC_WORKSPACE_WRAPPER",
    "CARGO_MANIFEST_DIR",
    "CARGO_MANIFEST_PATH",
];

/// An ELF file for the board. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Firmware {
    path: PathBuf,
    pub(crate) image: Image,
    pub(crate) symbols: Symbols,
    pub(crate) log_table: Arc<defmt_decoder::Table>,
    /// Cores that have run it, for its next board.
    pub(crate) warm_cores: WarmCores,
}

impl Firmware {
    /// Builds slitrange's firmware as it is flashed (`cargo fw`) and loads it. If nothing changed, this takes
    /// a moment.
    pub fn build() -> Result<Self> {
        Self::build_package("slitrange-firmware")
    }

    /// Builds the program of a package of this workspace, which is named as its package, and loads it.
    ///
    /// # Errors
    /// The build fails (its messages are on stderr or in the error), or the ELF file cannot be loaded.
    pub fn build_package(package: &str) -> Result<Self> {
        Self::build_package_for("thumbv7em-none-eabihf", package)
    }

    /// As [`Firmware::build_package`], for another target whose instructions the board's chip has too.
    pub fn build_package_for(target: &str, package: &str) -> Result<Self> {
        let mut command = cargo();
        command
            .args(["build", "--release", "--target", target])
            .args(["--package", package, "--bin", package])
            .arg("--message-format=json-render-diagnostics");
        // A person sees the build's progress; a test's output stays clean unless the build fails.
        if std::io::stderr().is_terminal() {
            command.stderr(Stdio::inherit());
        }
        let output = command.output().context("cargo did not start")?;
        if !output.status.success() {
            bail!(
                "the chip's program {package} did not build ({}); to see why, run\n\
                 cargo build --release --target {target} \
                 --package {package} --bin {package}\n{}",
                output.status,
                String::from_utf8_lossy(&output.stderr)
            );
        }
        let path = executable(&output.stdout)
            .with_context(|| format!("cargo built {package} and named no executable"))?;
        Self::load(&path)
    }

    /// Loads the ELF file at `path`.
    ///
    /// # Errors
    /// The file cannot be read, is no ELF file, or has no defmt table.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        Self::of_file(path).with_context(|| format!("loading the firmware {}", path.display()))
    }

    fn of_file(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path)?;
        let symbols = Symbols::read(&bytes, rigless::cpu::armv7m::code_address)?;
        let log_table = defmt_decoder::Table::parse(&bytes)?;
        let log_table = log_table.context("it has no defmt table: link it with -Tdefmt.x")?;
        Ok(Self {
            path: path.to_owned(),
            image: Image::new(path, bytes, None)?,
            symbols,
            log_table: Arc::new(log_table),
            warm_cores: WarmCores::default(),
        })
    }

    /// How many cores wait that have run it. Its next board continues in one of them.
    pub fn warm_cores(&self) -> usize {
        self.warm_cores.count()
    }

    /// Where the ELF file is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The ELF file's bytes.
    pub fn bytes(&self) -> &[u8] {
        self.image.bytes()
    }

    /// The address that `symbol` names; a function's is that of its first instruction, without the Thumb bit.
    ///
    /// # Errors
    /// The firmware has no such symbol. Rust mangles names: mark the function with `#[unsafe(no_mangle)]`.
    pub fn address_of(&self, symbol: &str) -> Result<u64> {
        self.symbols
            .get(symbol)
            .with_context(|| format!("looking up {symbol} in {}", self.path.display()))
    }
}

/// A cargo command in this workspace, without the variables for a build on the PC.
pub fn cargo() -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .stdin(Stdio::null());
    for (name, _) in std::env::vars_os() {
        let name_text = name.to_string_lossy();
        if NOT_FOR_THE_CHIP.contains(&name_text.as_ref()) || name_text.starts_with("CARGO_PKG_") {
            command.env_remove(&name);
        }
    }
    command
}

/// The executable that cargo's JSON messages name.
pub fn executable(messages: &[u8]) -> Option<PathBuf> {
    serde_json::Deserializer::from_slice(messages)
        .into_iter::<serde_json::Value>()
        .map_while(Result::ok)
        .filter_map(|message| Some(PathBuf::from(message.get("executable")?.as_str()?)))
        .last()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_executable_is_found_among_cargos_messages() {
        let end = r#"{"reason":"build-finished","success":true}"#;
        let messages = r#"{"reason":"compiler-artifact","target":{"name":"libm"},"executable":null}
{"reason":"compiler-artifact","target":{"name":"slitrange"},"executable":"/t/release/slitrange"}
"#;
        let path = Some(PathBuf::from("/t/release/slitrange"));
        assert_eq!(executable((messages.to_owned() + end).as_bytes()), path);
        assert_eq!(executable(end.as_bytes()), None);
    }

    #[test]
    fn a_file_that_is_no_firmware_is_refused_with_its_name() {
        let error =
            Firmware::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml")).unwrap_err();
        assert!(format!("{error:#}").contains("Cargo.toml"), "{error:#}");
    }
}
