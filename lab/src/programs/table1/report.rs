//! What the experiment found, as text.

use crate::paper::apparatus::{self, Aperture, LASER, POSITIONS, TAN_ANGLE, WANDER};
use crate::paper::camera::{FULL_SCALE, PEAK};
use crate::paper::errors::Judged;
use crate::paper::experiment::{Experiment, Outcome};
use crate::paper::lens_effects::{DISTORTION, Flare};
use crate::paper::materials::MATERIALS;
use crate::paper::methods::{Method, OURS};
use crate::paper::published::TABLE_1;

pub struct Report {
    /// Of every material through every aperture.
    pub outcomes: Vec<Outcome>,
    pub experiment: Experiment,
}

const MICROMETRES: f64 = 1e6;

impl Report {
    pub fn outcome(&self, material: usize, aperture: Aperture) -> &Outcome {
        let is_it = |it: &&Outcome| it.material == material && it.aperture == aperture;
        self.outcomes
            .iter()
            .find(is_it)
            .expect("every material is run")
    }

    pub fn judged(&self, material: usize, method: Method) -> &Judged {
        self.outcome(material, method.aperture()).of(method)
    }

    pub fn markdown(&self) -> String {
        let Experiment { stride, seed } = self.experiment;
        let extent = match stride {
            1 => format!("all {POSITIONS} positions, seed {seed}"),
            _ => format!("every {stride}th of {POSITIONS} positions, seed {seed}"),
        };
        let mut text = format!(
            "Errors in um, simulated on a PC, with the paper's in brackets; {extent}.\n\n\
             | Material | Lens MAX | MAE | Slit, gaussian MAX | MAE | Slit, Fraunhofer MAX | MAE | Slit, \
             ours (PC only) MAX | MAE |\n\
             |:--|--:|--:|--:|--:|--:|--:|--:|--:|\n"
        );
        for (i, (material, paper)) in MATERIALS.iter().zip(&TABLE_1).enumerate() {
            text += &format!("| {} |", material.name);
            for (place, method) in Method::ALL.into_iter().enumerate() {
                let judged = self.judged(i, method);
                let [max, mae] = paper.get(place).map_or_else(Default::default, |figures| {
                    figures.map(|um| format!(" ({um:.0})"))
                });
                text += &format!(
                    " {:.0}{max} | {:.0}{mae} |",
                    judged.max * MICROMETRES,
                    judged.mae * MICROMETRES
                );
            }
            text += "\n";
        }
        let gains = || {
            (0..MATERIALS.len()).map(|material| {
                let [ours, papers] = [Method::Ours, Method::Gaussian]
                    .map(|method| self.judged(material, method).mae);
                100.0 * (1.0 - ours / papers)
            })
        };
        text += &format!(
            "\nOurs is `{OURS}`. Its MAE is {:.0} to {:.0} % below that of the paper's gaussian. This gain \
             is known to 3 %, because the travel covers only about 100 independent speckles.\n\n\
             The paper does not give the following values. We chose them, the same for the lens and the \
             slit. *Paths*: the mean extra path of light within the material. *Glossy lobe*: its brightness \
             over that of the matt surface. *Texture*: the standard deviation of the reflectance over its \
             mean, and the length over which the reflectance varies.\n\n",
            gains().fold(f64::INFINITY, f64::min),
            gains().fold(f64::NEG_INFINITY, f64::max),
        );
        text + &chosen()
    }
}

fn chosen() -> String {
    let Flare { ghost, veil } = Flare::CHOSEN;
    let lens = apparatus::lens();
    let mut list = format!(
        "- laser: linewidth {:.1} nm, waist {:.2} mm at {:.2} m, {:.1} mrad to the table\n\
         - axis of the camera: tan u = {TAN_ANGLE}, with u the angle between the axis and the \
         baseline, as in eq. (1)\n\
         - lens: in focus at {:.2} m, distortion {:+.1} % and coma of {:.2} waves at the edge of the \
         field\n\
         - lens flare: a ghost of {:.1} % of the light, {:.2} mm in radius, at -{:.1} times the \
         spot's place; a veil of {:.1} %, {:.1} mm wide\n\
         - exposure: mean peak {PEAK:.0} of {FULL_SCALE} counts\n",
        LASER.linewidth * 1e9,
        LASER.waist_diameter * 1e3,
        LASER.waist_distance,
        WANDER * 1e3,
        lens.focus_distance,
        100.0 * DISTORTION.share,
        lens.coma,
        100.0 * ghost.share,
        ghost.radius * 1e3,
        ghost.magnification,
        100.0 * veil.share,
        veil.width * 1e3,
    );
    for material in MATERIALS.iter() {
        list += &format!("- {}\n", material.description());
    }
    list
}
