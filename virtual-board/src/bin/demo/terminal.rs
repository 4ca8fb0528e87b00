//! The board's serial line as a pseudo-terminal, with a target on a stage, and flash that survives a power
//! cycle.

use std::time::Duration;

use anyhow::{Context as _, Result};
use simulator::distorted_optics::DistortedOptics;
use simulator::scene::Scene;
use virtual_board::board::Conditions;
use virtual_board::light::{Target, of_scene, of_scene_through};
use virtual_board::pty::PseudoTerminal;
use virtual_board::stage::Stage;
use virtual_board::{Exposure, Firmware, LightSource, VirtualBoard};

use crate::command_line::Options;
use crate::flash_file::FlashFile;
use crate::moving_target::{self, FARTHEST, NEAREST};

/// The largest departure of an unknown geometry from eq. (1), in metres.
const DEPARTURE: f64 = 300e-6;

/// The longest wait for the banner and for an answer.
const PATIENCE: Duration = Duration::from_secs(2);

pub fn serve(firmware: &Firmware, options: &Options) -> Result<()> {
    let (scene, distance) = moving_target::scene(options)?;
    let target = Target::at(distance);
    let mut stage = (options.stage.as_ref()).map(|file| Stage::new(file, target.clone()));
    let mut flash_file = (options.flash.as_ref()).map(FlashFile::open).transpose()?;
    let mut conditions = Conditions::default();
    if let Some(file) = &flash_file {
        conditions.flash = file.flash.clone();
    }
    let comb = (scene.comb.is_some()).then(|| moving_target::slits_command(&scene));
    let light = light(options, scene, target)?;
    let mut board = VirtualBoard::power_on_under(firmware, light, conditions)?;
    if let Some(command) = comb {
        let banner = board.run_until_line(|line| line.starts_with("slitrange "), PATIENCE);
        banner.context("the firmware did not start")?;
        board.tell(&command, PATIENCE)?;
    }
    let mut terminal = PseudoTerminal::open()?;
    println!("serial line: {}", terminal.path.display());
    let mut kept = Ok(());
    terminal.serve(&mut board, |_| {
        if let Some(stage) = &mut stage {
            stage.look();
        }
        if let Some(file) = &mut flash_file {
            kept = file.keep();
        }
        kept.is_ok()
    })?;
    kept
}

/// The light on the sensor: from a target that stays where it is put, or from one that moves to and fro.
fn light(options: &Options, scene: Scene, target: Target) -> Result<LightSource> {
    let mut light = match options.unknown_geometry {
        Some(seed) => {
            let optics = DistortedOptics::unknown(seed, DEPARTURE)?;
            of_scene_through(optics, scene, target.clone())
        }
        None => of_scene(scene, target.clone()),
    };
    if options.distance.is_some() || options.scene.is_some() || options.stage.is_some() {
        return Ok(light);
    }
    // To the far end and back in 20 s of virtual time.
    Ok(Box::new(move |exposure: &Exposure| {
        let turns = exposure.end as f64 * 1e-9 / 20.0;
        let there = 1.0 - (2.0 * turns.fract() - 1.0).abs();
        target.move_to(NEAREST + there * (FARTHEST - NEAREST));
        light(exposure)
    }))
}
