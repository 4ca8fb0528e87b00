//! A pixel holds so much and no more.

use serde::{Deserialize, Serialize};

/// Full well, and what becomes of the charge beyond it (blooming: J. R. Janesick, "Scientific Charge-Coupled
/// Devices", SPIE 2001).
///
/// A drain beside the pixels takes the charge that a full one cannot hold. Where the drain takes only a part,
/// or there is none, the rest flows over into the neighbours, half to each side; a neighbour takes what it
/// has room for, and what is left flows on in the same direction. Charge is kept, but for what leaves over
/// the row's ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Saturation {
    /// Counts of light that fill a pixel.
    pub full_well: f64,
    /// Share of the charge beyond it that flows over: 0 for a drain that takes all, 1 for none.
    #[serde(default)]
    pub blooming: f64,
}

impl Saturation {
    /// Limits a row of light. Takes a time that is proportional to its length, however much flows over.
    pub fn apply(&self, light: &mut [f32]) {
        let full = self.full_well as f32;
        if self.blooming == 0.0 {
            light.iter_mut().for_each(|light| *light = light.min(full));
            return;
        }
        if light.iter().all(|&light| light <= full) {
            return;
        }
        let to_a_side = 0.5 * self.blooming as f32;
        let mut overflow = vec![0.0; light.len()];
        for (light, overflow) in light.iter_mut().zip(&mut overflow) {
            *overflow = to_a_side * (*light - full).max(0.0);
            *light = light.min(full);
        }
        // Of two streams that meet, the first takes the room. The mean of both orders favours no side.
        let mut left_first = light.to_vec();
        flow(left_first.iter_mut().zip(&overflow).rev(), full);
        flow(left_first.iter_mut().zip(&overflow), full);
        flow(light.iter_mut().zip(&overflow), full);
        flow(light.iter_mut().zip(&overflow).rev(), full);
        for (light, other) in light.iter_mut().zip(&left_first) {
            *light = 0.5 * (*light + other);
        }
    }
}

/// Lets the overflow of full pixels run along the row, in the pixels' order, into those with room.
fn flow<'a>(pixels: impl Iterator<Item = (&'a mut f32, &'a f32)>, full: f32) {
    // Twice the precision of a pixel: many pixels' overflow comes together here.
    let mut flowing = 0.0f64;
    for (light, overflow) in pixels {
        let room = f64::from(full - *light);
        let stays = flowing.min(room);
        *light = (f64::from(*light) + stays) as f32;
        flowing += f64::from(*overflow) - stays;
    }
}
