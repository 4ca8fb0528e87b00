//! A comb of slits: several parallel slits in one mask before the row, each of which images the same spot.
//!
//! The light of all slits adds up on the row. Each slit sees the target by eq. (1) with an optics of its own
//! ([`Optics::behind`]), and has its own diffraction pattern, obliquity, and view of the surface (texture,
//! speckle, lobe).
//!
//! # Height of a slit's image
//!
//! A slit as wide as [`Aperture::Slit`] makes a spot as high as the scene's [`crate::scene::Spot`] says. In
//! the far field a slit twice as wide lets twice the light through, and puts the light on half the width: the
//! irradiance at the geometric centre goes with the square of the width. The simulator takes Fresnel's
//! integral where the scene's pattern is Fresnel's, and lowers the spot by the image of the laser's spot as
//! for two gaussians. The slit's distance from the target does not
//! change the height. From the first slit of the nominal mask to the last one, the square of this distance
//! changes by 0.6 % if the target is at 0.55 m, and by 0.3 % at 1.10 m.
//!
//! # Interference between slits
//!
//! The light of neighbouring slits is coherent and would interfere. The simulator adds intensities and leaves
//! interference out. The cross term of two slits of width a, whose middles are g apart, has only waves of
//! (g - a) / (lambda z) to (g + a) / (lambda z) turns a metre, for any target: Fresnel's kernel gives the
//! light from the places u and u' of the two slits a fringe of (u - u') / (lambda z). For slits of 200 um,
//! 860 um apart, 50 mm before the sensor, these are fringes of 31 to 49 um, or 3.8 to 6.2 pixels of 8 um.
//!
//! `host-tests/tests/comb_light.rs` sums the fields of three such slits, for a laser spot of 1 mm at 0.8 m:
//!
//! | | point | paper | metal |
//! |---|---:|---:|---:|
//! | fringes within two sigma, RMS, over the peak | 0.057 | 0.063 | 0.105 |
//! | a fit of a gaussian of fixed width moves by, at most, in pixels | 6e-11 | 2e-8 | 3e-5 |
//! | the core's centre moves by, median, in pixels | 0.003 | 0.023 | 0.030 |
//! | the core's centre moves by, RMS, in pixels | 0.006 | 0.08 | 0.09 |
//! | speckle moves the fit by, RMS, in pixels | 0 | 1.26 | 2.67 |
//!
//! A gaussian has no waves as short as the fringes, so a fit of equal weights does not see them. The core
//! weights pixels by their noise, and sees a little. At 0.8 m a pixel is 0.39 mm of distance: 30 um RMS on
//! paper for one slit, where speckle makes 490 um. Fringes are far above a row's noise: a check of residuals
//! sees them in a real row, and not in the simulator's.
//!
//! # What else is left out
//!
//! Speckle takes the beam's wavefront at the distance from the foot of the slit, as it does for a scene with
//! an offset: across the nominal mask up to 2.8 mm from the true distance. At the edge of a beam of 1 mm in
//! diameter this is a phase of 0.002 radians.

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};
use slitrange::frame::comb::{MAX_SLITS, NOMINAL_PLACES_UM, SLIT_WIDTH_UM};

use crate::field::fresnel;
use crate::optics::{Aperture, Optics};
use crate::scene::diffraction::Diffraction;
use crate::scene::laser_spot::image_scale;
use crate::scene::{Scene, shape};

/// A mask with slits, in place of the one slit of [`Optics::aperture`]. Each slit is as high as the
/// aperture's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comb {
    /// The slits, 1 to [`MAX_SLITS`].
    pub slits: Vec<Slit>,
}

/// A slit of a mask.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slit {
    /// From the optical axis to the slit's middle, along the row, in metres. Pixels count in the same
    /// direction.
    pub place: f64,
    /// Along the row, in metres.
    pub width: f64,
}

impl Slit {
    /// The optics of this slit alone: [`Optics::behind`] its place, with its width in the aperture.
    pub fn optics(&self, optics: &Optics) -> Optics {
        self.narrow(optics).behind(self.place)
    }

    /// The optics with this slit's width in the aperture.
    pub(crate) fn narrow(&self, optics: &Optics) -> Optics {
        let aperture = match optics.aperture {
            Aperture::Slit { height, .. } => Aperture::Slit {
                width: self.width,
                height,
            },
            lens @ Aperture::Lens { .. } => lens,
        };
        Optics {
            aperture,
            ..*optics
        }
    }
}

impl Comb {
    /// The default mask: [`NOMINAL_PLACES_UM`] and [`SLIT_WIDTH_UM`].
    pub fn nominal() -> Self {
        // Division gives the number that a scene's file reads from its decimals.
        let metres = |um: i32| f64::from(um) / 1e6;
        let slits = NOMINAL_PLACES_UM.map(|place| Slit {
            place: metres(place),
            width: metres(SLIT_WIDTH_UM),
        });
        let slits = slits.to_vec();
        Self { slits }
    }

    /// That the mask can be simulated before these optics.
    ///
    /// # Errors
    /// A lens, no slit or too many, a place or width that means nothing, or slits that overlap, and what to
    /// do about it.
    pub fn check(&self, optics: &Optics) -> Result<()> {
        ensure!(
            matches!(optics.aperture, Aperture::Slit { .. }),
            "[comb] is a mask of slits, and there is a lens: make optics.aperture a slit, or leave [comb] out"
        );
        let count = self.slits.len();
        ensure!(
            (1..=MAX_SLITS).contains(&count),
            "comb.slits has {count} slits: give it 1 to {MAX_SLITS}, or leave [comb] out"
        );
        for &Slit { place, width } in &self.slits {
            ensure!(
                place.is_finite(),
                "comb.slits has a place of {place} m: give it a number"
            );
            ensure!(
                width.is_finite() && width > 0.0,
                "comb.slits has a width of {width} m: it must be above 0"
            );
            let baseline = optics.behind(place).baseline;
            ensure!(
                baseline > 0.0,
                "comb.slits has a place of {place} m, which is {baseline} m from the laser's beam: move the \
                 slit to the side of the beam where optics.baseline is"
            );
        }
        let mut slits = self.slits.clone();
        slits.sort_by(|a, b| a.place.total_cmp(&b.place));
        for (a, b) in slits.iter().zip(&slits[1..]) {
            let (gap, widths) = (b.place - a.place, 0.5 * (a.width + b.width));
            ensure!(
                gap > widths,
                "comb.slits has places {} m and {} m, where slits of {} m and {} m overlap: move them apart, \
                 or make them narrower",
                a.place,
                b.place,
                a.width,
                b.width
            );
        }
        Ok(())
    }
}

impl Scene {
    /// The optics of each slit: of the comb's, or of the one slit or lens.
    pub fn openings(&self) -> Vec<Optics> {
        match &self.comb {
            Some(comb) => {
                let slits = comb.slits.iter();
                slits.map(|it| it.optics(&self.optics)).collect()
            }
            None => vec![self.optics],
        }
    }
}

/// Height of the spot behind the slit of a scene, over that behind a slit `aperture` metres wide at the same
/// place, in the mean over all surfaces.
///
/// This is the ratio of the irradiances at the geometric centre: of a point's pattern, times s / hypot(s, b),
/// where s is the sigma of the gaussian that fits the pattern, and b that of the image of the laser's spot.
/// `scene` has the slit's own optics and the gaussian of its width.
pub(crate) fn relative_height(scene: &Scene, aperture: f64, distance: f64) -> f64 {
    let optics = &scene.optics;
    let Aperture::Slit { width: own, .. } = optics.aperture else {
        return 1.0;
    };
    if own.to_bits() == aperture.to_bits() {
        return 1.0;
    }
    let blur = shape::spot_deviation(scene, distance) * image_scale(optics, distance).abs();
    let by_fresnel = scene.speckle.is_some() || scene.diffraction == Some(Diffraction::Fresnel);
    let height = |width: f64| {
        let gap = shape::gap(scene, width, distance);
        let (point, sigma) = match scene.diffraction {
            _ if by_fresnel => {
                // int exp(i pi u^2 (1/R + 1/z) / lambda) du over half of the slit is F(end) / scale.
                let curvature = 1.0 / gap.to_light + 1.0 / gap.to_sensor;
                let scale = f64::sqrt(2.0 * curvature / gap.wavelength);
                let (c, s) = fresnel(0.5 * width * scale);
                (
                    4.0 * (c * c + s * s) / (scale * scale),
                    shape::SLIT_WIDTH * gap.detail(),
                )
            }
            Some(_) => (width * width, shape::SLIT_WIDTH * gap.detail()),
            None => {
                let sigma = scene.spot.map_or(1.0, |spot| spot.width) * optics.pitch;
                (width * width, sigma * own / width)
            }
        };
        point * sigma / libm::hypot(sigma, blur)
    };
    height(own) / height(aperture)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::least_squares;
    use crate::scene::{LaserSpot, Sensor, Simulation, file};
    use crate::with;

    const DISTANCES: [f64; 6] = [0.55, 0.65, 0.8, 0.9, 1.0, 1.10];

    fn comb(slits: &[(f64, f64)]) -> Comb {
        let slit = |&(place, width)| Slit { place, width };
        let slits = slits.iter().map(slit).collect();
        Comb { slits }
    }

    fn one(place: f64) -> Option<Comb> {
        Some(comb(&[(place, 200e-6)]))
    }

    fn light(scene: &Scene, row: u64, distance: f64) -> Vec<f64> {
        let row = scene.row(row, distance, scene.exposure);
        let light = row[scene.geometry().light].iter();
        light.map(|&x| f64::from(x)).collect()
    }

    /// A scene of a name without noise, behind a comb.
    fn noiseless(name: &str, comb: Option<Comb>) -> Scene {
        let mut scene = match name {
            "white paper" => Scene::white_paper(),
            name => Scene::load(name).expect("a scene"),
        };
        (scene.shot_noise, scene.read_noise, scene.black_level) = (None, None, None);
        Scene { comb, ..scene }
    }

    /// A straight line from a point on the beam through the slit to the sensor's plane, as the casing has it.
    #[test]
    fn a_slit_sees_where_a_straight_ray_falls() {
        let optics = with(Optics::nominal(), |it| it.offset = 0.013);
        let (sin, cos) = optics.angle.sin_cos();
        // The slit on the axis, the axis from there to the beam, and the row, which the axis is square to.
        let slit = [optics.baseline, optics.offset];
        let axis = [-cos, sin];
        let row = [sin, cos];
        let mut worst = 0.0f64;
        for place in NOMINAL_PLACES_UM.map(|um| f64::from(um) / 1e6) {
            for distance in DISTANCES {
                let through = [slit[0] + place * row[0], slit[1] + place * row[1]];
                let way = [through[0], through[1] - distance];
                // As far as the sensor's plane, which is a focal length behind the slits' plane.
                let depth = -(way[0] * axis[0] + way[1] * axis[1]);
                let share = optics.focal_length / depth;
                let hit = [through[0] + share * way[0], through[1] + share * way[1]];
                let foot = [
                    slit[0] - optics.focal_length * axis[0],
                    slit[1] - optics.focal_length * axis[1],
                ];
                let along = (hit[0] - foot[0]) * row[0] + (hit[1] - foot[1]) * row[1];
                let expected = optics.axis + along / optics.pitch;
                let behind = optics.behind(place);
                worst = worst.max((behind.centre(distance) - expected).abs());
                assert!((behind.distance(expected) - distance).abs() < 1e-12);
                assert!((behind.range(distance) - way[0].hypot(way[1])).abs() < 1e-12);
            }
        }
        println!("off by {worst:.1e} pixels at most");
        assert!(worst < 1e-8);
    }

    #[test]
    fn a_comb_of_one_slit_on_the_axis_is_the_scene_bit_for_bit() {
        let mut compared = 0;
        for name in file::names().expect("the folder of scenes") {
            let plain = Scene::load(&name).expect("a scene");
            if plain.comb.is_some() || matches!(plain.optics.aperture, Aperture::Lens { .. }) {
                continue;
            }
            let combed = with(plain.clone(), |it| it.comb = one(0.0));
            combed.check().expect("a scene");
            let middle = plain.sensor.rows() / 2;
            let (plain, combed) = (Simulation::new(plain), Simulation::new(combed));
            let scene = plain.scene();
            for row in [middle, middle + 1, middle + 10 * scene.sensor.rows()] {
                let of = |it: &Simulation| it.row(row, scene.distance, scene.exposure);
                let bits = |row: Vec<f32>| row.into_iter().map(f32::to_bits).collect::<Vec<_>>();
                assert!(bits(of(&plain)) == bits(of(&combed)), "{name}, row {row}");
                assert_eq!(plain.true_centres(row, 0.8), [combed.true_centre(row, 0.8)]);
            }
            compared += 1;
        }
        println!("{compared} scenes");
        assert!(compared >= 15);
    }

    /// A pixel's place is exact for the gaussians of white paper: only rounding to f32 moves a centroid.
    #[test]
    fn images_are_where_the_optics_of_their_slits_say() {
        let scene = noiseless("white paper", Some(Comb::nominal()));
        scene.check().expect("a scene");
        let simulation = Simulation::new(scene.clone());
        let mut worst = 0.0f64;
        for distance in DISTANCES {
            let row = light(&scene, 0, distance);
            let centres = simulation.true_centres(0, distance);
            assert_eq!(centres.len(), 16);
            for centre in centres {
                assert!((60.0..3588.0).contains(&centre), "{distance} m: {centre}");
                // Half of the gap to the nearest neighbour.
                let near = (centre.round() as usize - 56)..=(centre.round() as usize + 56);
                let sum: f64 = near.clone().map(|i| row[i]).sum();
                let moment: f64 = near.map(|i| row[i] * (i as f64 - centre)).sum();
                worst = worst.max((moment / sum).abs());
                let peak = 1750.0 * 8.6 * std::f64::consts::TAU.sqrt();
                assert!((sum / peak - 1.0).abs() < 1e-4);
            }
        }
        println!("off by {worst:.1e} pixels at most");
        assert!(worst < 1e-6);
    }

    /// Light adds up: the comb's row is the sum of the rows of its slits alone.
    #[test]
    fn the_light_of_slits_adds_up() {
        let mut scene = noiseless("brushed-metal", None);
        scene.obliquity = Some(crate::scene::Obliquity {});
        for sensor in [Sensor::Tcd1304dg, Sensor::Camera] {
            scene.sensor = sensor;
            scene.optics = Optics::nominal_on(sensor);
            let row = sensor.rows() / 2;
            let places = [-2060e-6, 100e-6, 1180e-6];
            let mut of = |comb: Option<Comb>| {
                scene.comb = comb;
                scene.check().expect("a scene");
                scene.row(row, 0.8, scene.exposure)
            };
            let all = of(Some(comb(&places.map(|place| (place, 200e-6)))));
            let alone = places.map(|place| of(one(place)));
            let mut worst = 0.0f32;
            for (i, light) in all.iter().enumerate() {
                let sum: f32 = alone.iter().map(|row| row[i]).sum();
                worst = worst.max((light - sum).abs());
            }
            let peak = all.iter().fold(0.0f32, |peak, &x| peak.max(x));
            println!("{sensor:?}: off by {worst:.1e} of {peak} counts");
            assert!(worst < 1e-5 * peak && peak > 100.0);
            // Slits see different speckle.
            assert!(alone[0] != alone[1]);
        }
    }

    #[test]
    fn a_mask_warms_up_as_a_whole() {
        let place = 6800e-6;
        let scene = noiseless("warming-up", one(place));
        let row = 2000;
        let temperature = scene.temperature.expect("listed");
        let time = row as f64 * scene.period();
        let scale = temperature.scale(time);
        let warm = temperature.optics(&scene.optics, time);
        let expected = warm.behind(scale * place).centre(scene.distance);
        let light = light(&scene, row, scene.distance);
        let found = least_squares::fit_near(&light, expected).expect("a spot");
        let moved = expected - scene.openings()[0].centre(scene.distance);
        println!("{} for {expected}, moved by {moved}", found.centre);
        assert!((found.centre - expected).abs() < 1e-4 && moved.abs() > 1e-2);
    }

    /// Heights are those of the integral over the slit for a point (Fresnel), or the square of the width.
    #[test]
    fn a_wider_slit_makes_a_higher_and_narrower_image() {
        let height = |diffraction, laser_spot, width: f64| {
            let scene = Scene {
                diffraction,
                laser_spot,
                ..noiseless("white paper", Some(comb(&[(1180e-6, width)])))
            };
            let centre = scene.openings()[0].centre(0.8);
            let row = light(&scene, 0, 0.8);
            let found = least_squares::fit_near(&row, centre).expect("a spot");
            let peak = row.iter().fold(0.0f64, |peak, &x| peak.max(x));
            (peak, found.width)
        };
        for diffraction in [None, Some(Diffraction::Fraunhofer)] {
            let [(low, wide), (high, narrow)] =
                [200e-6, 300e-6].map(|width| height(diffraction, None, width));
            println!("{diffraction:?}: {:.4}, {:.4}", high / low, wide / narrow);
            assert!((high / low / 2.25 - 1.0).abs() < 5e-3);
            assert!((wide / narrow / 1.5 - 1.0).abs() < 5e-3);
        }
        // |int exp(i pi u^2 / (lambda z')) du|^2, z' = 47.2 mm, by the midpoint rule.
        let optics = Optics::nominal().behind(1180e-6);
        let curvature = 1.0 / optics.range(0.8) + 1.0 / optics.focal_length;
        let irradiance = |width: f64| {
            let step = width / 1e4;
            let phases = (0..10_000).map(|i| {
                let u = (f64::from(i) + 0.5) * step - 0.5 * width;
                (std::f64::consts::PI * u * u * curvature / optics.wavelength).sin_cos()
            });
            let (sin, cos) = phases.fold((0.0, 0.0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
            (sin * step).powi(2) + (cos * step).powi(2)
        };
        let expected = irradiance(300e-6) / irradiance(200e-6);
        let fresnel = Some(Diffraction::Fresnel);
        let found = height(fresnel, None, 300e-6).0 / height(fresnel, None, 200e-6).0;
        println!("Fresnel: {found:.4} for {expected:.4}");
        assert!((found / expected - 1.0).abs() < 2e-3);
        // A laser spot blurs the narrower pattern more. Fraunhofer's light is conserved, so the peak is that
        // of the blurred pattern: compared with sinc^2 and a gaussian, by sums.
        let spot = Some(LaserSpot::new(2e-3, 0.8));
        let fraunhofer = Some(Diffraction::Fraunhofer);
        let found = height(fraunhofer, spot, 300e-6).0 / height(fraunhofer, spot, 200e-6).0;
        let blur = 0.5e-3 * image_scale(&optics, 0.8);
        let blurred = |width: f64| {
            let detail = optics.wavelength * optics.focal_length / width;
            let places = (-500..=500).map(|i| f64::from(i) * 0.01);
            let light = places.map(|t| {
                let u = std::f64::consts::PI * t * blur / detail;
                let sinc = if t == 0.0 { 1.0 } else { u.sin() / u };
                (-0.5 * t * t).exp() * sinc * sinc * width * width
            });
            light.sum::<f64>()
        };
        let expected = blurred(300e-6) / blurred(200e-6);
        println!("blurred: {found:.4} for {expected:.4}");
        assert!((found / expected - 1.0).abs() < 1e-2);
    }

    /// Speckle of all slits, over all distances of the sensor.
    #[test]
    fn the_nominal_comb_can_be_simulated_with_speckle() {
        let scene = Scene::load("comb").expect("a scene");
        assert_eq!(scene.comb, Some(Comb::nominal()));
        let simulation = Simulation::new(noiseless("comb", scene.comb.clone()));
        for distance in [0.55, 0.8, 1.10] {
            scene.check_distance(distance).expect("a distance");
            let row = simulation.row(0, distance, scene.exposure);
            assert!(row.iter().all(|x| x.is_finite()));
        }
    }

    #[test]
    fn meaningless_combs_are_refused() {
        let refused = |comb: Comb, optics: &Optics, words: &str| {
            let scene = Scene {
                comb: Some(comb),
                optics: *optics,
                ..Scene::white_paper()
            };
            let error = format!("{:#}", scene.check().expect_err(words));
            println!("{error}");
            assert!(error.contains(words), "{error:?} lacks {words:?}");
        };
        let optics = Optics::nominal();
        let lens = with(optics, |it| it.aperture = Aperture::PAPER_LENS);
        refused(Comb::nominal(), &lens, "make optics.aperture a slit");
        let none = "comb.slits has 0 slits: give it 1 to 16";
        refused(comb(&[]), &optics, none);
        let many: Vec<_> = (0..17).map(|i| (f64::from(i) * 1e-3, 200e-6)).collect();
        refused(comb(&many), &optics, "comb.slits has 17 slits");
        for place in [f64::NAN, f64::INFINITY] {
            refused(comb(&[(place, 200e-6)]), &optics, "give it a number");
        }
        for width in [f64::NAN, 0.0, -1e-6] {
            refused(comb(&[(0.0, width)]), &optics, "must be above 0");
        }
        refused(comb(&[(-0.4, 1e-4)]), &optics, "from the laser's beam");
        let words =
            "comb.slits has places 0 m and 0.0002 m, where slits of 0.0002 m and 0.0002 m overlap";
        refused(comb(&[(2e-4, 2e-4), (0.0, 2e-4)]), &optics, words);
        let text = Scene::white_paper().to_toml().expect("text");
        let with = |comb: &str| Scene::from_toml(&format!("{text}\n[comb]\n{comb}"));
        let scene = with("slits = [{ place = 1e-3, width = 2e-4 }]").expect("a scene");
        assert_eq!(scene.comb, Some(comb(&[(1e-3, 2e-4)])));
        let tables = "[[comb.slits]]\nplace = 1e-3\nwidth = 2e-4\n";
        assert_eq!(with(tables).expect("a scene"), scene);
        let again = Scene::from_toml(&scene.to_toml().expect("text"));
        assert_eq!(again.expect("a scene"), scene);
        assert!(with("slits = [{ place = 1e-3 }]").is_err());
        assert!(with("slits = []\npitch = 1").is_err());
    }
}
