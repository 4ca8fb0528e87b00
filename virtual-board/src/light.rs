//! The light on the sensor head: the rows of a scene at the firmware's exposures.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};

use simulator::distorted_optics::DistortedOptics;
use simulator::scene::{Scene, Simulation};

use crate::base::{Nanos, lock};
use crate::sensor_head::{Exposure, LightSource};

/// The target. Every clone can move it, and can tell where it was.
#[derive(Clone, Debug)]
pub struct Target(Arc<Mutex<Place>>);

#[derive(Debug)]
struct Place {
    /// In metres. If the scene moves the target, the distance at the first row after `move_to`.
    distance: f64,
    /// The number of its surface ([`Simulation::set_surface`]).
    surface: u64,
    /// Seconds of the scene that pass before the next row.
    waits: f64,
    /// The first row after `move_to`; `None` until there is one.
    put: Option<u64>,
    seen: VecDeque<Seen>,
    is_covered: bool,
}

#[derive(Clone, Copy, Debug)]
struct Seen {
    end: Nanos,
    /// The distance at its middle, in metres.
    distance: f64,
    /// The factor of [`simulator::scene::Reflectivity`].
    reflectivity: f64,
}

/// The number of exposures in `seen`: those of four of the longest frames.
const REMEMBERED: usize = 256;

impl Target {
    /// A target at a distance in metres.
    pub fn at(distance: f64) -> Self {
        Self(Arc::new(Mutex::new(Place {
            distance,
            surface: 0,
            waits: 0.0,
            put: None,
            seen: VecDeque::new(),
            is_covered: false,
        })))
    }

    fn place(&self) -> MutexGuard<'_, Place> {
        lock(&self.0)
    }

    /// Moves the target to a distance in metres. If the scene moves the target, the motion starts again from
    /// there.
    pub fn move_to(&self, distance: f64) {
        let mut place = self.place();
        place.distance = distance;
        place.put = None;
    }

    /// Covers the sensor ([`Scene::covered`]), or takes the cover away.
    pub fn cover(&self, is_covered: bool) {
        self.place().is_covered = is_covered;
    }

    /// Shows another surface: another place on the target, or another target of the same material.
    pub fn show_surface(&self, number: u64) {
        self.place().surface = number;
    }

    /// Lets time pass in the scene, of which the board sees nothing: for what is slow, as a sensor that warms
    /// up.
    pub fn let_time_pass(&self, seconds: f64) {
        self.place().waits += seconds;
    }

    /// The mean distance in metres over `exposures` exposures, of which `last` is the last one. `None` if one
    /// of them is not among the last 256.
    pub fn mean_distance(&self, last: &Exposure, exposures: usize) -> Option<f64> {
        let seen = self.seen(last, exposures)?;
        let sum: f64 = seen.iter().map(|it| it.distance).sum();
        Some(sum / exposures as f64)
    }

    /// Whether all of `exposures` exposures, of which `last` is the last one, saw the same reflectivity.
    /// `None` if one of them is not among the last 256.
    pub fn stayed_as_bright(&self, last: &Exposure, exposures: usize) -> Option<bool> {
        let seen = self.seen(last, exposures)?;
        let now = seen.last()?.reflectivity;
        Some(seen.iter().all(|it| it.reflectivity == now))
    }

    fn seen(&self, last: &Exposure, exposures: usize) -> Option<Vec<Seen>> {
        let place = self.place();
        let until = (place.seen.iter()).position(|it| it.end == last.end)?;
        let from = (until + 1).checked_sub(exposures)?;
        Some(place.seen.range(from..=until).copied().collect())
    }

    /// Records an exposure. Gives the distance that the simulation's motion must start from so that this row
    /// sees the target in the right place.
    fn expose(&self, exposure: &Exposure, row: u64, simulation: &Simulation) -> f64 {
        let mut place = self.place();
        let distance = place.distance;
        let gone = simulation.true_distance(*place.put.get_or_insert(row), distance) - distance;
        let truth = simulation.true_distance(row, distance - gone);
        if place.seen.len() == REMEMBERED {
            place.seen.pop_front();
        }
        place.seen.push_back(Seen {
            end: exposure.end,
            distance: truth,
            reflectivity: simulation.reflectivity(row),
        });
        distance - gone
    }
}

/// The rows of a scene. If the caller moves the target, it stands still during an exposure, at its place at
/// the end. If the scene moves the target ([`simulator::scene::Motion`]), it moves from row to row and during
/// exposures.
pub fn of_scene(scene: Scene, target: Target) -> LightSource {
    seen(scene, target, |distance| distance)
}

/// The rows of a scene with the geometry `optics` instead of the scene's own. Only for scenes in which the
/// distance moves the spot and changes nothing else, and which do not move the target.
pub fn of_scene_through(optics: DistortedOptics, scene: Scene, target: Target) -> LightSource {
    let own = scene.optics;
    seen(scene, target, move |distance| {
        own.distance(optics.centre(distance))
    })
}

/// The rows of a scene that shows a target at the distance d as if it were at `seen_at(d)`.
fn seen(
    scene: Scene,
    target: Target,
    seen_at: impl Fn(f64) -> f64 + Send + 'static,
) -> LightSource {
    let mut simulation = Simulation::new(scene);
    let (mut row, mut surface) = (0, 0);
    let mut laser_before = 0.0;
    Box::new(move |exposure: &Exposure| {
        row += 1;
        let (shown, waits, is_covered) = {
            let mut place = target.place();
            let waits = std::mem::take(&mut place.waits);
            (place.surface, waits, place.is_covered)
        };
        row += (waits / simulation.scene().period()) as u64;
        if surface != shown {
            surface = shown;
            simulation.set_surface(surface);
        }
        let distance = target.expose(exposure, row, &simulation);
        let laser = exposure.laser as f64 * 1e-9;
        let times = simulator::scene::Exposure {
            row: exposure.duration() as f64 * 1e-9,
            laser,
            laser_before: std::mem::replace(&mut laser_before, laser),
        };
        if is_covered {
            return simulation.scene().covered().row(row, distance, times);
        }
        simulation.row(row, seen_at(distance), times)
    })
}

/// The outputs of the sensor that see light.
pub const LIGHT: std::ops::Range<usize> = 32..3680;

#[cfg(test)]
mod tests {
    use super::*;
    use simulator::least_squares;
    use simulator::optics::Optics;
    use simulator::scene::{FixedPattern, Motion, Sensor};
    use simulator::with;

    fn exposure(row: Nanos) -> Exposure {
        let (start, end) = (row * 5_700_000, (row + 1) * 5_700_000);
        let laser = end - start;
        Exposure { start, end, laser }
    }

    fn centre_near(outputs: &[f32], near: f64) -> f64 {
        let counts: Vec<f64> = outputs[LIGHT].iter().map(|&count| count.into()).collect();
        let spot = least_squares::fit_near(&counts, near);
        spot.expect("a spot").centre
    }

    /// The scene's own geometry puts the spot some pixels away.
    #[test]
    fn the_other_geometry_decides_where_the_spot_is() {
        let optics = DistortedOptics {
            optics: with(Optics::nominal(), |it| it.offset = 0.003),
            third: 2.0,
            fifth: 0.2,
        };
        let scene = with(Scene::white_paper(), |it| {
            (it.shot_noise, it.read_noise) = (None, None)
        });
        let own = scene.optics;
        let target = Target::at(0.6);
        let mut light = of_scene_through(optics, scene, target.clone());
        for (row, distance) in (0..).zip([0.6, 0.75, 1.0]) {
            target.move_to(distance);
            let expected = optics.centre(distance);
            let found = centre_near(&light(&exposure(row)), expected);
            println!("{found} {expected}");
            assert!((found - expected).abs() < 1e-4);
            assert!((found - own.centre(distance)).abs() > 2.0);
        }
    }

    /// Another surface has other speckle, so the spot is elsewhere. The sensor's pixels stay as they are.
    #[test]
    fn another_surface_moves_the_spot_and_leaves_the_sensor() {
        let scene = Scene {
            shot_noise: None,
            read_noise: None,
            fixed_pattern: Some(FixedPattern { counts: 5.0 }),
            ..Scene::load("brushed-metal").expect("a scene")
        };
        let expected = scene.optics.centre(scene.distance);
        let target = Target::at(scene.distance);
        let mut light = of_scene(scene, target.clone());
        let [own, other, own_again] = [0, 1, 0].map(|surface| {
            target.show_surface(surface);
            light(&exposure(0))
        });
        assert_eq!(own, own_again);
        let [here, there] = [&own, &other].map(|outputs| centre_near(outputs, expected));
        println!("{here} {there}");
        assert!((here - there).abs() > 0.1);
        // Far from the spot there is only the sensor.
        let far = LIGHT.start..LIGHT.start + 500;
        assert_eq!(own[far.clone()], other[far]);
    }

    /// 0.1 m/s at 175.4 rows a second: n rows after the target was put somewhere it is n / 1754 m farther
    /// away. Of 20 rows, the last four are 17.5 rows after the first on average.
    #[test]
    fn a_frame_sees_the_target_where_it_was_on_average() {
        let dark = Scene::dark(Sensor::Tcd1304dg);
        let scene = with(dark, |it| it.motion = Some(Motion { speed: 0.1 }));
        let target = Target::at(0.7);
        let mut light = of_scene(scene, target.clone());
        for row in 1..=20 {
            light(&exposure(row));
        }
        let mean = |last, rows| target.mean_distance(&exposure(last), rows);
        let after = |rows: f64| 0.7 + rows / 1754.0;
        println!("{:?}", mean(20, 4));
        assert!((mean(20, 4).expect("four rows") - after(17.5)).abs() < 1e-12);
        assert_eq!(mean(20, 21), None);
        assert_eq!(mean(21, 1), None);
        // Back at 0.7 m, the motion starts again.
        target.move_to(0.7);
        for row in 21..=23 {
            light(&exposure(row));
        }
        assert!((mean(23, 3).expect("three rows") - after(1.0)).abs() < 1e-12);
    }

    /// A cover leaves the black level of 300 counts. Pixels differ by 2 % of 2000 counts and by 5 counts, so
    /// their mean is off by less than a count.
    #[test]
    fn a_cover_keeps_the_light_from_the_sensor() {
        let target = Target::at(0.8);
        let mut light = of_scene(Scene::load("even-light").expect("a scene"), target.clone());
        for (is_covered, counts) in [(false, 2300.7), (true, 300.0), (false, 2300.7)] {
            target.cover(is_covered);
            let row = light(&exposure(0));
            let mean = statistics::mean(row[LIGHT].iter().map(|&it| f64::from(it)));
            println!("covered {is_covered}: {mean:.1} counts");
            assert!((mean - counts).abs() < 3.0);
        }
    }
}
