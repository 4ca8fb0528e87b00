//! scipy's `curve_fit` and its L-BFGS-B, the method of the paper, through a script in a virtual environment
//! of its own.

use std::collections::HashMap;
use std::fs;
use std::process::{Command, Output};

use serde::Deserialize;

use super::rows::Window;
use crate::prelude::*;

const SCRIPT: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/src/programs/cost/peers/scipy_fits.py"
);
const REQUIREMENTS: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/src/programs/cost/peers/requirements.txt"
);
/// Beside cargo's own files, which are not in the repository either.
const DIRECTORY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../target/peers");

#[derive(Debug, Deserialize)]
pub struct Fits {
    /// The centres on the windows, in pixels, `None` where there was none.
    pub centres: Vec<Option<f64>>,
    /// Median time of a fit in nanoseconds.
    pub ns_per_row: f64,
}

pub struct Environment {
    python: PathBuf,
}

impl Environment {
    /// The virtual environment; it is made where there is none with the pinned versions yet, which takes a
    /// minute and the network. An error says why scipy cannot be had.
    pub fn make() -> anyhow::Result<Self> {
        if let Some(existing) = Self::existing() {
            return Ok(existing);
        }
        let directory = Path::new(DIRECTORY).join("venv");
        output(
            Command::new("python3")
                .args(["-m", "venv", "--clear"])
                .arg(&directory),
        )
        .context("python3 with its module venv")?;
        let python = python(&directory);
        output(
            Command::new(&python)
                .args(["-m", "pip", "install", "--quiet", "--retries", "1"])
                .args(["--disable-pip-version-check", "--requirement", REQUIREMENTS]),
        )
        .context("scipy from the package index")?;
        // Written last: an environment that was interrupted is made anew.
        fs::copy(REQUIREMENTS, directory.join("requirements.txt"))?;
        Ok(Self { python })
    }

    /// The virtual environment of an earlier run, where there is one with the pinned versions.
    pub fn existing() -> Option<Self> {
        let directory = Path::new(DIRECTORY).join("venv");
        let installed = fs::read(directory.join("requirements.txt")).ok()?;
        let wanted = fs::read(REQUIREMENTS).ok()?;
        let python = python(&directory);
        (installed == wanted && python.exists()).then_some(Self { python })
    }

    /// Runs the fits of these names on the windows, one after the other on one core.
    pub fn fit<'a>(
        &self,
        windows: &[Window],
        names: &[&'a str],
    ) -> anyhow::Result<Vec<(&'a str, Fits)>> {
        let pixels: Vec<&[u16]> = windows.iter().map(|it| &it.pixels[..]).collect();
        let starts: Vec<[f64; 4]> = windows.iter().map(|it| it.start.to_array()).collect();
        let given = serde_json::json!({"pixels": pixels, "starts": starts});
        // Two processes may run at a time.
        let file = Path::new(DIRECTORY).join(format!("windows-{}.json", std::process::id()));
        fs::write(&file, serde_json::to_vec(&given)?)?;
        let output = output(
            Command::new(&self.python)
                .arg(SCRIPT)
                .arg(&file)
                .args(names)
                .env("OPENBLAS_NUM_THREADS", "1"),
        )?;
        fs::remove_file(&file)?;
        let mut fits: HashMap<String, Fits> = serde_json::from_slice(&output.stdout)?;
        names
            .iter()
            .map(|&name| {
                let fits = fits.remove(name);
                let fits = fits.with_context(|| format!("{SCRIPT} gave no {name}"))?;
                let (found, rows) = (fits.centres.len(), windows.len());
                ensure!(
                    found == rows,
                    "{SCRIPT} gave {found} centres for {rows} rows"
                );
                Ok((name, fits))
            })
            .collect()
    }
}

fn python(directory: &Path) -> PathBuf {
    directory.join(if cfg!(windows) {
        "Scripts/python.exe"
    } else {
        "bin/python"
    })
}

/// Runs to the end; an error has the last line that the program complained with.
fn output(command: &mut Command) -> anyhow::Result<Output> {
    let output = command
        .output()
        .with_context(|| format!("{} does not start", command.get_program().display()))?;
    if !output.status.success() {
        let complaint = String::from_utf8_lossy(&output.stderr);
        let last = complaint.trim().lines().last().unwrap_or("no message");
        bail!("{}: {last}", output.status);
    }
    Ok(output)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::programs::cost::peers::gaussian::examples;
    use crate::programs::cost::peers::{SCIPY_PEERS, levenberg_marquardt, rows};

    /// All fits minimise the same sum of squares. L-BFGS-B stops if the gradient of the sum is below 1e-5.
    /// The curvature along the centre is about sqrt(pi/2) (A = 1, 10.5 pixels a sigma), so the centre is
    /// exact to 1e-4 px.
    #[test]
    fn agrees_with_levenberg_marquardt() {
        let Some(environment) = Environment::existing() else {
            println!(
                "SKIPPED: no virtual environment at {DIRECTORY}; `cargo cost --peers` makes it"
            );
            return;
        };
        let windows = examples::noisy(20);
        let fits = environment.fit(&windows, &SCIPY_PEERS).expect("fits");
        for (name, fits) in fits {
            for (window, centre) in windows.iter().zip(fits.centres) {
                let other = levenberg_marquardt::fit(&window.pixels.map(f64::from), window.start);
                let off = centre.expect("a fit") - other.expect("a fit").centre;
                assert!(off.abs() < 0.05 * rows::bound(), "{name}: {off} px off");
            }
        }
    }
}
