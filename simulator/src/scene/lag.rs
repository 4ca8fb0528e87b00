//! Charge that stays for the next row.

use serde::{Deserialize, Serialize};

/// The shift pulse does not move all charge out of a pixel; the next one finds what stayed (residual charge,
/// image lag).
///
/// Charge leaves a pixel by its own field, which falls with the charge, and by diffusion: dq/dt = -k q^2 -
/// q/T (J. E. Carnes, W. F. Kosonocky and E. G. Ramberg, "Free charge transfer in charge-coupled devices",
/// IEEE Transactions on Electron Devices 19, 1972). After a pulse of some length, of a charge of q there is
/// left
///
/// ```text
/// s q e / (e + s q)
/// ```
///
/// a share s of little charge, and e of much charge, however much that was. M. C. Nelson sees this on a
/// TCD1304: bright and faint light leave similar ghosts (TCD1304-Sensor-Device, GitHub, 2026). About 1000
/// electrons are left after one pulse of 4 V, and after 20 pulses less than the noise of 60. With s = 1 the
/// equation gives 1000 / 20 = 50 after 20 pulses; s itself was not measured.
///
/// A row has its own light, more what stayed of the row before, less what stays for the next one. So a steady
/// target shows nothing of it; a target that moves, or a laser that is off in every second row, does. Only
/// the light of one row before counts, not that of earlier rows. It is computed again for each row, without
/// its noise, with the target where it was then: a row takes up to twice the time. The row before one of a
/// camera is the same row of the frame before. There was a row before row 0 too.
/// [`crate::scene::Exposure::laser_before`] says how long the laser was on in it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lag {
    /// Counts of light that stay at most: 100 for 1000 electrons where 10 make a count.
    pub counts: f64,
    /// Share of faint light that stays.
    pub share: f64,
}

impl Lag {
    /// Counts that stay of a pixel's light.
    pub fn stays(&self, light: f64) -> f64 {
        let faint = self.share * light;
        faint * self.counts / (self.counts + faint)
    }

    /// Adds to a row of light what stayed of the row before, and takes away what stays for the next one. A
    /// pixel holds at most `full_well` counts. Both rows are without noise: the noise is that of the charge
    /// that is read.
    pub fn apply(&self, light: &mut [f32], before: &[f32], full_well: f64) {
        let stays = |light: f32| self.stays(f64::from(light).min(full_well));
        for (light, &before) in light.iter_mut().zip(before) {
            *light = (f64::from(*light) + (stays(before) - stays(*light))) as f32;
        }
    }
}
