//! Each effect of a scene's light, compared with a closed form or with a different computation.

use crate::support::*;
use simulator::field::{self, Laser, LensAperture, Scattering, SlitAperture, View};
use simulator::scene::diffraction::Gap;
use simulator::scene::lens::{Across, Pupil};
use simulator::scene::pattern::Pattern;
use simulator::scene::{Coma, Defocus, Diffraction, LaserSpot, Motion, Speckle, SpecularLobe};
use std::f64::consts::{PI, SQRT_2, TAU};

/// A spot of a width in pixels, 1000 counts high after a second, on 3648 pixels of 8 um, without noise.
fn gaussian(width: f64) -> Scene {
    let spot = format!("spot = {{ width = {width}, counts_per_second = 1000.0 }}");
    listing(Scene::dark(Sensor::Row(3648)), &spot)
}

fn plain_with(effects: &str) -> Scene {
    listing(gaussian(8.6), effects)
}

/// A spot of 2 pixels behind the paper's lens, and effects.
fn lens_with(effects: &str) -> Scene {
    let lens = with(gaussian(2.0), |it| {
        it.optics.aperture = Aperture::PAPER_LENS
    });
    listing(lens, effects)
}

/// Sum, centre of mass and variance of a row, in counts, pixels and square pixels.
fn moments(row: &[f32]) -> (f64, f64, f64) {
    let places = || row.iter().map(|&light| f64::from(light)).zip(0..);
    let sum: f64 = places().map(|(light, _)| light).sum();
    let mean = |value: &dyn Fn(f64) -> f64| {
        let products = places().map(|(light, i)| light * value(f64::from(i)));
        products.sum::<f64>() / sum
    };
    let centre = mean(&|x| x);
    (sum, centre, mean(&|x| (x - centre).powi(2)))
}

fn difference(more: &[f32], less: &[f32]) -> Vec<f32> {
    more.iter().zip(less).map(|(a, b)| a - b).collect()
}

/// How far the light of so many pixels from `first` on is off at most from what a pixel at a place expects.
fn worst(row: &[f32], first: usize, pixels: usize, expected: impl Fn(f64) -> f64) -> f64 {
    let near = row.iter().enumerate().skip(first).take(pixels);
    near.map(|(pixel, &light)| (f64::from(light) - expected(pixel as f64)).abs())
        .fold(0.0, f64::max)
}

const FRESNEL: &str = "diffraction = 'fresnel'";

/// Fresnel's pattern of a laser spot with a 1/e^2 diameter in metres at 0.8 m.
fn fresnel(waist: f64) -> String {
    format!("{FRESNEL}\n{}", laser_spot(waist, 0.8))
}

fn laser_spot(waist: f64, distance: f64) -> String {
    format!("laser_spot = {{ waist = {waist}, waist_distance = {distance}, wander = 0.0 }}")
}

fn sinc_squared(x: f64) -> f64 {
    let u = PI * x.abs().max(1e-9);
    (u.sin() / u).powi(2)
}

/// Compares the light of each pixel with sinc^2 averaged over the pixel by quadrature, for spots at any place
/// between pixels. Its first zero is at lambda z / a = 162.5 um.
#[test]
fn pixels_gather_the_pattern_over_their_width() {
    let (scene, first_zero) = (plain_with("diffraction = 'fraunhofer'"), 162.5 / 8.0);
    let of_phase = [0.0, 0.13, 0.5, 0.77].map(|phase| {
        let centre = 1800.0 + phase;
        worst(&scene.row_with_centre(0, centre, 1.0), 1500, 600, |pixel| {
            let x = pixel - centre;
            1000.0 * integral(x - 0.5, x + 0.5, 8, |x| sinc_squared(x / first_zero))
        })
    });
    let worst = of_phase.into_iter().fold(0.0, f64::max);
    println!("off by {worst:.4} of 1000 counts at most");
    assert!(worst < 0.01);
}

/// |int exp(i pi (u^2 (1/R + 1/z) - 2 u x/z) / lambda) du|^2 over the slit, by quadrature, divided by its
/// value at x = 0.
fn fresnel_by_quadrature(gap: &Gap, x: f64) -> f64 {
    let curvature = 1.0 / gap.to_light + 1.0 / gap.to_sensor;
    let light = |x: f64| {
        let way = |u: f64| u * u * curvature - 2.0 * u * x / gap.to_sensor;
        let phase = |u: f64| PI / gap.wavelength * way(u);
        let half = 0.5 * gap.width;
        let part = |wave: fn(f64) -> f64| integral(-half, half, 3000, |u| wave(phase(u)));
        part(f64::cos).powi(2) + part(f64::sin).powi(2)
    };
    light(x) / light(0.0)
}

#[test]
fn fresnels_slit_is_its_integral() {
    for (width, reach) in [
        (200e-6, 5e-3),
        (100e-6, 5e-3),
        (600e-6, 2e-3),
        (3e-3, 2.2e-3),
    ] {
        let gap = Gap {
            width,
            to_light: 0.854,
            to_sensor: 0.05,
            wavelength: 650e-9,
        };
        let pattern = gap.pattern(Diffraction::Fresnel, 1.2 * reach);
        let places = (-50..=50).map(|i| f64::from(i) / 50.0 * reach);
        let off = places.map(|x| (pattern.at(x) - fresnel_by_quadrature(&gap, x)).abs());
        let (worst, um) = (off.fold(0.0, f64::max), width * 1e6);
        println!("slit of {um:.0} um: off by {worst:.1e} of the middle");
        assert!(worst < 3e-5, "{worst}");
    }
}

/// Compares Fresnel's pattern of a laser spot in a row with `profiles::Slit`, which sums over points and
/// integrates by Simpson's rule.
#[test]
fn a_row_through_a_slit_agrees_with_the_profile() {
    for diameter in [0.5e-3, 1e-3, 3e-3] {
        let scene = plain_with(&fresnel(diameter));
        let optics = &scene.optics;
        let centre = optics.centre(0.8);
        let range = optics.range(0.8);
        // As the sensor sees it.
        let slit = with(Slit::nominal(diameter * 0.8 / range), |it| {
            it.to_spot = range
        });
        let row = scene.row(0, 0.8, 1.0);
        let worst = worst(&row, centre as usize - 60, 120, |pixel| {
            let x = pixel - centre;
            let expected = |x: f64| 1000.0 * slit.light(x * optics.pitch) / slit.light(0.0);
            integral(x - 0.5, x + 0.5, 2, expected)
        });
        println!("{:.1} mm: off by {worst:.4} of 1000 counts", diameter * 1e3);
        assert!(worst < 0.02);
    }
}

#[test]
fn a_laser_spot_widens_a_gaussian_in_quadrature() {
    let waist = 0.5e-3;
    let spot = LaserSpot::new(waist, 0.75);
    // A Rayleigh length from the waist, 0.302 m, a beam is sqrt 2 as wide.
    let rayleigh = PI * waist * waist / (4.0 * 650e-9);
    let diameter = spot.diameter(0.75 + rayleigh, 650e-9);
    println!("{diameter} for {}", SQRT_2 * waist);
    assert!((diameter / (SQRT_2 * waist) - 1.0).abs() < 1e-12);

    for distance in [0.65, 0.75, 0.75 + rayleigh] {
        let scene = plain_with(&laser_spot(waist, 0.75));
        // z/R as large, seen under the angle whose cosine is d/R, at 8 um a pixel.
        let range = 0.3f64.hypot(distance);
        let image = spot.diameter(distance, 650e-9) / 4.0 * (distance / range) * (0.05 / range);
        let expected = 8.6 * 8.6 + (image / 8e-6).powi(2) + 1.0 / 12.0;
        let row = scene.row(0, distance, 1.0);
        let (_, centre, variance) = moments(&row);
        println!("{distance:.3} m: variance {variance:.4} for {expected:.4}");
        assert!((variance / expected - 1.0).abs() < 1e-5);
        assert!((centre - scene.optics.centre(distance)).abs() < 1e-4);
        // The height stays, but for the mean over a pixel: 1 / (24 sigma^2) less.
        let peak = row.iter().fold(0.0f32, |peak, &light| peak.max(light));
        assert!((990.0..1000.0).contains(&peak), "{peak}");
        // The other way, as a sum of patterns of points: a texture of no contrast.
        let summed = listing(scene, "texture = { contrast = 0.0, length = 1.0 }");
        let apart = difference(&summed.row(0, distance, 1.0), &row);
        let worst = apart.iter().fold(0.0f32, |worst, off| worst.max(off.abs()));
        println!("summed: off by {worst} of 1000 counts");
        assert!(worst < 0.02);
    }
}

#[test]
fn off_the_axis_a_gaussian_leans_outwards() {
    let oblique = plain_with("obliquity = {}");
    let optics = &oblique.optics;
    for centre in [300.0, 1000.0, 1823.5, 3000.0, 3400.0] {
        let row = oblique.row_with_centre(0, centre, 1.0);
        let x = (centre - optics.axis) * optics.pitch;
        let (sin, cos) = (x / optics.focal_length).atan().sin_cos();
        // As the documentation derives it, in pixels.
        let expected = 8.6 * 8.6 * optics.pitch * sin / (2.0 * optics.focal_length * cos.powi(5));
        let (sum, mean, _) = moments(&row);
        let (off, cos_4) = (mean - centre, cos.powi(4));
        println!("centre {centre}: off by {off:.6} for {expected:.6} pixels; cos^4 {cos_4:.4}");
        assert!((off - expected).abs() < 0.01 * expected.abs() + 2e-6);
        // cos^4, over a width of 1/cos^3.
        let plain_sum = 1000.0 * 8.6 * TAU.sqrt();
        assert!((sum / plain_sum / cos - 1.0).abs() < 1e-4);
    }
}

#[test]
fn the_zeros_of_an_oblique_pattern_are_even_in_the_sine() {
    let mut scene = plain_with("diffraction = 'fraunhofer'\nobliquity = {}");
    // 2 um, so that 3648 pixels are 7.3 mm, beginning 8 mm from the axis.
    scene.optics.pitch = 2e-6;
    scene.optics.axis = -4000.0;
    let centre = 1800.0;
    let row = scene.row_with_centre(0, centre, 1.0);
    let x = (centre - scene.optics.axis) * 2e-6;
    let sine = x / x.hypot(0.05);
    for order in [-3.0, -2.0, -1.0, 1.0, 2.0, 3.0f64] {
        // sin(a) = sin(a0) + n lambda / slit width.
        let zero = (sine + order * 650e-9 / 200e-6).asin().tan() * 0.05;
        let expected = zero / 2e-6 + scene.optics.axis;
        let near = (expected.round() as usize - 20)..(expected.round() as usize + 20);
        let darkest = near.min_by(|&a, &b| row[a].total_cmp(&row[b]));
        let darkest = darkest.expect("40 pixels");
        let even = centre + order * 162.5 / 2.0;
        println!("order {order}: pixel {darkest} for {expected:.2}; {even:.2} if it were even");
        assert!((darkest as f64 - expected).abs() <= 1.0);
    }
}

#[test]
fn texture_shifts_the_centre_at_random_and_stays() {
    const SEEDS: u64 = 1500;
    for length in [0.1e-3, 0.4e-3, 2e-3f64] {
        let contrast = 0.1f64;
        let texture = format!("texture = {{ contrast = {contrast}, length = {length} }}");
        let plain = plain_with(&laser_spot(1e-3, 0.8));
        let textured = listing(plain.clone(), &texture);
        let truth = plain.optics.centre(0.8);
        let (mut squares, mut brightness) = (0.0, 0.0);
        for seed in 0..SEEDS {
            let scene = with(textured.clone(), |it| it.seed = seed);
            let (sum, centre, _) = moments(&scene.row(0, 0.8, 1.0));
            squares += (centre - truth).powi(2) / SEEDS as f64;
            brightness += sum / SEEDS as f64;
        }
        // For a gaussian window of sigma s on a field of correlation exp(-(x/l)^2), to first order in the
        // contrast c: var = c^2 int int x x' g(x) g(x') exp(-(x - x')^2 / l^2) = 2 c^2 s^4 / (l^2 (1 + 4
        // s^2/l^2)^(3/2)).
        let s = 1e-3 / 4.0f64;
        let on_target = 2.0 * contrast.powi(2) * s.powi(4)
            / (length.powi(2) * (1.0 + 4.0 * (s / length).powi(2)).powf(1.5));
        let range = 0.3f64.hypot(0.8);
        let expected = on_target.sqrt() * 0.8 / range * 0.05 / range / 8e-6;
        let shift = squares.sqrt();
        println!("{length} m: shift {shift:.5} for {expected:.5} px; brightness {brightness:.1}");
        // 1500 surfaces: 1.8 % of a standard deviation, almost surely 6 %; the second order is 1 %.
        assert!((shift / expected - 1.0).abs() < 0.07);
        // The mean reflectance is 1: a tenth over sqrt(1500).
        assert!((brightness / moments(&plain.row(0, 0.8, 1.0)).0 - 1.0).abs() < 0.01);
    }
    // The surface is the same wherever it stands, and another when it slides.
    let at = |wander: f64, distance: f64| {
        let scene = plain_with(&format!(
            "texture = {{ contrast = 0.3, length = 0.2e-3 }}
            laser_spot = {{ waist = 1e-3, waist_distance = {distance}, wander = {wander} }}"
        ));
        let range = scene.optics.range(distance);
        let (_, centre, _) = moments(&scene.row(0, distance, 1.0));
        // On the target, in micrometres.
        (centre - scene.optics.centre(distance)) * 8.0 * range / 0.05 * range / distance
    };
    let (near, far, slid) = (at(0.0, 0.7), at(0.0, 0.9), at(0.005, 0.9));
    println!("{near:.2} um at 0.7 m, {far:.2} um at 0.9 m, {slid:.2} um when it slides");
    assert!((near / far - 1.0).abs() < 0.01 && (slid / far - 1.0).abs() > 0.1);
}

#[test]
fn a_lobe_brightens_what_is_seen_near_the_mirror_direction() {
    let lobe = SpecularLobe {
        strength: 3.0,
        width: 0.15,
        tilt: 0.05,
    };
    let scene = with(plain_with(""), |it| it.specular_lobe = Some(lobe));
    for distance in [0.6, 0.8, 1.0] {
        let [with, without] =
            [&scene, &plain_with("")].map(|it| moments(&it.row(0, distance, 1.0)).0);
        let ratio = with / without;
        let off = (0.3f64 / distance).atan() - 2.0 * 0.05;
        let expected = 1.0 + 3.0 * (-0.5 * (off / 0.15).powi(2)).exp();
        println!("{distance} m: {ratio:.5} for {expected:.5}");
        assert!((ratio / expected - 1.0).abs() < 1e-6);
    }
    assert_eq!(lobe.factor(0.1), 4.0, "seen in the mirror direction");
}

#[test]
fn distortion_grows_with_the_cube() {
    let scene = lens_with("distortion = { share = 0.002, field = 5.6e-3 }");
    for x in [-5.6e-3, -2.8e-3, 1e-3, 5.6e-3] {
        let centre = scene.optics.axis + x / 8e-6;
        let (_, mean, _) = moments(&scene.row_with_centre(0, centre, 1.0));
        let expected = 0.002 * x.powi(3) / 5.6e-3f64.powi(2) / 8e-6;
        let off = mean - centre;
        println!("{x} m: off by {off:.5} for {expected:.5} pixels");
        assert!((off - expected).abs() < 1e-5);
    }
}

fn pupil(defocus: f64, coma: f64) -> Pupil {
    Pupil {
        radius: 25e-3 / 12.0,
        to_sensor: 0.05,
        wavelength: 650e-9,
        defocus,
        coma,
    }
}

const fn point(place: f64) -> Across {
    Across::Pixel {
        place,
        height: 0.0,
        blur: 0.0,
    }
}

#[test]
fn a_round_pupil_makes_airys_pattern() {
    let ideal = pupil(0.0, 0.0);
    let detail = 650e-9 * 0.05 / (50e-3 / 12.0);
    assert!((ideal.detail() / detail - 1.0).abs() < 1e-12);
    let step = detail / 16.0;
    let chords = ideal.chords(step, 10.0 * detail, 10.0 * detail);
    let across = |y: f64| Pattern::from_knots(step, chords.row(point(y)));
    let row = across(0.0);
    let middle = row.at(0.0);
    // The zero of J1 at 3.8317 = 1.2197 pi.
    let zero = row.at(1.219_67 * detail) / middle;
    println!("at 1.22 lambda z / D: {zero:.1e}");
    assert!(zero.abs() < 1e-5);
    let airy = |r: f64| {
        let v = (PI * r / detail).max(1e-9);
        (2.0 * libm::j1(v) / v).powi(2)
    };
    let mut worst = 0.0f64;
    for y in [0.0, 0.7, 3.1, 6.0] {
        let row = across(y * detail);
        for i in -128..=128 {
            let x = f64::from(i) / 16.0;
            let light = row.at(x * detail) / middle;
            worst = worst.max((light - airy(x.hypot(y) * detail)).abs());
        }
    }
    println!("off by {worst:.1e} of the middle");
    assert!(worst < 1e-8);
    // All of y: the integral of Airy's pattern, which falls with y^-3, in metres.
    let all = Pattern::from_knots(step, chords.row(Across::All));
    let height = all.at(0.0) / middle / detail;
    let line = |x: f64| integral(-300.0, 300.0, 12_000, |y| airy(x.hypot(y) * detail));
    println!("as high as {height:.6} for {:.6} details", line(0.0));
    assert!((height / line(0.0) - 1.0).abs() < 1e-5);
    for x in [0.0, 0.5, 1.0, 2.2, 5.0] {
        let (light, expected) = (all.at(x * detail) / all.at(0.0), line(x) / line(0.0));
        println!("line at {x}: {light:.6} for {expected:.6}");
        assert!((light - expected).abs() < 1e-5);
    }
}

/// Compares the rows of a scene with the same closed form. The pupil is so small that the pattern is wide.
#[test]
fn a_small_pupil_on_a_camera_shows_rings() {
    let scene = camera(Aperture::Lens { diameter: 0.3e-3 }).without(Effect::LaserSpot);
    let simulation = Simulation::new(scene.clone());
    let detail = 650e-9 * 0.05 / 0.3e-3;
    let centre = 960.0;
    let distance = scene.optics.distance(centre);
    let of_row = [300, 310, 322, 340, 277].map(|row| {
        let y = (row as f64 - 299.5) * 5.86e-6;
        worst(&simulation.row(row, distance, 1.0), 900, 120, |pixel| {
            let v = PI * ((pixel - centre) * 5.86e-6).hypot(y) / detail;
            1000.0 * (2.0 * libm::j1(v) / v).powi(2)
        })
    });
    let worst = of_row.into_iter().fold(0.0, f64::max);
    // A pixel of 0.054 details gathers less at the top: (pi^2 / 4) 0.054^2 / 12 in each direction.
    println!("off by {worst:.2} of 1000 counts");
    assert!(worst < 1.5);
}

#[test]
fn defocus_makes_a_disc() {
    // On the axis |int exp(i k W t) dt|^2 over 0 < t = rho^2 < 1: sinc^2(W / lambda).
    for waves in [0.25, 0.5, 0.8, 1.3] {
        let (sharp, blurred) = (pupil(0.0, 0.0), pupil(waves * 650e-9, 0.0));
        let light = |pupil: Pupil| {
            Pattern::from_knots(1e-6, pupil.chords(1e-6, 2e-6, 0.0).row(point(0.0))).at(0.0)
        };
        let (ratio, expected) = (light(blurred) / light(sharp), sinc_squared(waves));
        println!("{waves} waves: {ratio:.9} for {expected:.9}");
        assert!((ratio - expected).abs() < 1e-6);
    }
    // Focused at 0.9 m, a point at 0.6 m makes a disc of D z |1/d - 1/f| = 116 um.
    let scene = lens_with("defocus.focus_distance = 0.9");
    let distance = 0.6f64;
    let range = 0.3f64.hypot(distance);
    let x = (scene.optics.centre(distance) - scene.optics.axis) * 8e-6;
    let depth = range * 0.05 / x.hypot(0.05);
    let disc = 50e-3 / 12.0 * 0.05 * (1.0 / depth - 1.0 / 0.9f64).abs() / 8e-6;
    let [sharp, rays] = [&lens_with(""), &scene].map(|it| moments(&it.row(0, distance, 1.0)));
    // A disc's variance along a row is that of its chords: diameter^2 / 16.
    let (more, expected) = (rays.2 - sharp.2, disc * disc / 16.0);
    println!("disc of {disc:.2} pixels: variance {more:.3} for {expected:.3}");
    assert!((more / expected - 1.0).abs() < 1e-3);
    assert!((rays.0 / sharp.0 - 1.0).abs() < 1e-5, "light is conserved");
    // Six waves out of focus, with a laser spot, waves make the disc that rays make, with softer edges.
    let spread = |diffraction, width| {
        let spot = laser_spot(1e-3, distance);
        let far = format!("defocus.focus_distance = 0.3\n{spot}");
        let scene = with(listing(scene.clone(), &far), |it| {
            (it.spot, it.diffraction) = (gaussian(width).spot, diffraction);
        });
        let row = scene.row(0, distance, 1.0);
        let sum = moments(&row).0;
        let shares = row.iter().map(|&light| f64::from(light) / sum);
        shares.collect::<Vec<f64>>()
    };
    let half_width = |row: &[f64]| {
        let half = 0.5 * row.iter().fold(0.0f64, |peak, &light| peak.max(light));
        let above: Vec<usize> = (0..row.len()).filter(|&i| row[i] > half).collect();
        let edge = |inner: usize, outer: usize| (row[inner] - half) / (row[inner] - row[outer]);
        let (first, last) = (above[0], above[above.len() - 1]);
        (last - first) as f64 + edge(first, first - 1) + edge(last, last + 1)
    };
    let waves = half_width(&spread(Some(Diffraction::Fresnel), 1e-9));
    let rays = half_width(&spread(None, 0.4));
    println!("half as bright over {waves:.2} pixels by waves and {rays:.2} by rays");
    assert!((waves / rays - 1.0).abs() < 0.05);
}

#[test]
fn coma_moves_the_centre_of_mass() {
    let comatic = lens_with("coma = { waves = 1.5, field = 5.6e-3 }");
    let at = |diffraction: &str, x: f64| {
        let scene = listing(comatic.clone(), diffraction);
        let centre = scene.optics.axis + x / 8e-6;
        let (sum, mean, _) = moments(&scene.row_with_centre(0, centre, 1.0));
        (sum, mean - centre)
    };
    for x in [-5.6e-3, 2.8e-3, 5.6e-3] {
        // z <dW/du> = z W131 / a, W131 = 1.5 waves times x / 5.6 mm.
        let expected = 0.05 * 1.5 * 650e-9 * (x / 5.6e-3) / (25e-3 / 12.0) / 8e-6;
        let (rays, waves) = (at("", x).1, at(FRESNEL, x).1);
        println!("{x} m: rays {rays:.4}, waves {waves:.4} for {expected:.4} pixels");
        assert!((rays / expected - 1.0).abs() < 1e-3);
        // Where the table of the waves ends there is a little light yet.
        assert!((waves / expected - 1.0).abs() < 0.03);
    }
    let (comatic, plain) = (at("", 5.6e-3).0, at("", 0.0).0);
    assert!((comatic / plain - 1.0).abs() < 1e-5, "light is conserved");
}

#[test]
fn a_ghost_moves_against_the_spot() {
    let flare = |veil: f64| {
        let glass = "magnification = 0.6, width = 30.0, strength = 0.02";
        lens_with(&format!("flare = {{ {glass}, veil = {veil} }}"))
    };
    let scene = flare(0.0);
    for centre in [1200.0, 1823.5, 2600.0] {
        let [with, without] = [&scene, &lens_with("")].map(|it| it.row_with_centre(0, centre, 1.0));
        let (sum, mean, variance) = moments(&difference(&with, &without));
        let expected = 1823.5 - 0.6 * (centre - 1823.5);
        println!("spot at {centre}: ghost at {mean:.3} for {expected}, variance {variance:.1}");
        assert!((mean - expected).abs() < 0.01 && (variance - 900.0).abs() < 2.0);
        assert!((sum / (20.0 * 30.0 * TAU.sqrt()) - 1.0).abs() < 1e-3);
    }
    let [veiled, clear] = [flare(0.004), scene].map(|it| it.row_with_centre(0, 1200.0, 1.0));
    let mut veil = difference(&veiled, &clear).into_iter();
    assert!(veil.all(|veil| (veil - 4.0).abs() < 1e-3));
}

#[test]
fn a_second_reflection_is_a_second_gaussian() {
    let scene = plain_with("second_reflection = { offset = 60.0, width = 12.0, strength = 0.1 }");
    let [with, without] = [scene, plain_with("")].map(|it| it.row_with_centre(0, 1500.25, 1.0));
    let (sum, mean, variance) = moments(&difference(&with, &without));
    println!("{sum:.1} counts at {mean:.4}, variance {variance:.3}");
    assert!((mean - 1560.25).abs() < 1e-3 && (variance - 144.0 - 1.0 / 12.0).abs() < 0.05);
    assert!((sum / (100.0 * 12.0 * TAU.sqrt()) - 1.0).abs() < 1e-4);
}

#[test]
fn motion_smears_the_spot_and_moves_it_from_row_to_row() {
    let exposure = 0.005;
    // 0.1 to 20 pixels during an exposure at 178 um a pixel of 8 um near 0.6 m.
    for (speed, diffraction) in [(0.01, ""), (0.5, ""), (-0.9, ""), (0.5, FRESNEL)] {
        let still = plain_with(diffraction).with_height(1000.0 / exposure);
        let scene = with(still.clone(), |it| it.motion = Some(Motion { speed }));
        let simulation = Simulation::new(scene.clone());
        for row in [0, 7] {
            // A row every 1/175.4 s.
            let distance = 0.6 + speed * row as f64 / 175.4;
            assert!((simulation.true_distance(row, 0.6) - distance).abs() < 1e-12);
            let centre = simulation.true_centre(row, 0.6);
            // During the exposure, from -1/2 to 1/2.
            let place = |way: f64| scene.optics.centre(distance + way * speed * exposure);
            assert!((centre - place(0.0)).abs() < 1e-9);
            let moved = place(-0.5) - place(0.5);
            let light = simulation.row(row, 0.6, exposure);
            let (sum, mean, variance) = moments(&light);
            let at_rest = moments(&still.row(row, distance, exposure));
            let (more, expected) = (variance - at_rest.2, moved * moved / 12.0);
            let at = mean - centre;
            println!("{speed} m/s, row {row}: {moved:.3} px, {at:.5}, {more:.4} for {expected:.4}");
            assert!((sum / at_rest.0 - 1.0).abs() < 1e-5, "light is conserved");
            assert!((at_rest.1 - centre).abs() < 2e-3);
            // Eq. (1) is bent: its second derivative times way^2 / 24.
            let bent = place(-0.5) + place(0.5) - 2.0 * place(0.0);
            assert!((mean - at_rest.1 - bent / 6.0).abs() < 1e-3);
            // Short exposures n leave out 1/n^2 of the variance.
            assert!((more - expected).abs() < 0.01 + 0.005 * expected);
            // Against the gaussian's integral over pixels and exposure: 1e-4 of the peak, and f32's rounding.
            if diffraction.is_empty() {
                let phi = |x: f64| libm::erf(x / (8.6 * SQRT_2));
                let worst = worst(&light, centre as usize - 80, 160, |pixel| {
                    integral(-0.5, 0.5, 100, |way| {
                        let x = pixel - place(way);
                        1000.0 * 8.6 * (PI / 2.0).sqrt() * (phi(x + 0.5) - phi(x - 0.5))
                    })
                });
                println!("off by {worst:.4} of 1000 counts");
                assert!(worst < 0.1 + 1e-3);
            }
        }
    }
}

/// The width that a scene states is that of the reference fit to the same slit's profile in `profiles`.
#[test]
fn the_expected_width_is_that_of_the_best_gaussian() {
    for seen in [0.1e-3, 1e-3, 3e-3] {
        let range = 0.3f64.hypot(0.8);
        let width = Simulation::new(plain_with(&fresnel(seen * range / 0.8))).spot_width(0.8);
        let slit = with(Slit::nominal(seen), |it| it.to_spot = range);
        let light = (-150..=150).map(|i| slit.light(f64::from(i) * 8e-6));
        let fit = least_squares::fit_near(&light.collect::<Vec<_>>(), 150.0);
        let expected = fit.expect("a peak").width;
        println!("{:.1} mm: {width:.3} for {expected:.3} pixels", seen * 1e3);
        // Pixels of a width of 1 add 1/12 to the variance: 0.006 pixels.
        assert!((width - expected).abs() < 0.02);
    }
    let gaussian = Simulation::new(plain_with("")).spot_width(0.8);
    println!("gaussian of 8.6: {gaussian:.4}");
    // A pixel adds 1/12 to the variance.
    assert!((gaussian - (8.6f64 * 8.6 + 1.0 / 12.0).sqrt()).abs() < 1e-3);
}

#[test]
fn a_warmer_sensor_moves_the_centre_as_eq_1_says() {
    let warming = "temperature = { kelvin_per_second = 0.1, expansion = 23e-6 }";
    let simulation = Simulation::new(plain_with(warming));
    // After 100 s it is 10 kelvin warmer.
    let row = 17_540;
    for distance in [0.62, 0.8, 1.0f64] {
        let (_, mean, _) = moments(&simulation.row(row, distance, 1.0));
        let off = mean - simulation.true_centre(row, distance);
        let e = 23e-6 * 10.0;
        let a = 2.6f64.atan() - (distance / 0.3).atan();
        // f tan(a) grows with f; a grows with b by d / (b^2 + d^2).
        let grown = 0.3 * distance / (0.3f64.powi(2) + distance.powi(2)) / a.cos().powi(2);
        let expected = e * 0.05 * (a.tan() + grown) / 8e-6;
        println!("{distance} m: off by {off:.5} for {expected:.5} pixels");
        assert!((off / expected - 1.0).abs() < 2e-3);
    }
}

/// Speckle of a surface that keeps no polarisation, in light of one wavelength.
const PAPER: Speckle = Speckle::of_one_wavelength(2);

fn camera(aperture: Aperture) -> Scene {
    let camera = with(Scene::dark(Sensor::Camera), |it| {
        (it.spot, it.optics.aperture) = (plain_with("").spot, aperture);
    });
    listing(camera, &fresnel(1e-3))
}

/// The largest difference of a camera's light, in thousands of counts, from the field's at these pixels.
fn worst_on_camera(
    (simulation, centre): (&Simulation, f64),
    (pixels, rows): (&[usize], &[u64]),
    mean: impl FnOnce(&[f64], &[f64]) -> (field::Image, f64),
) -> f64 {
    let metres = |pixels: f64| pixels * 5.86e-6;
    let columns: Vec<f64> = (pixels.iter().map(|&it| metres(it as f64 - centre))).collect();
    let places: Vec<f64> = (rows.iter().map(|&row| metres(row as f64 - 299.5))).collect();
    let (mean, unit) = mean(&columns, &places);
    let mut worst = 0.0f64;
    for (i, &row) in rows.iter().enumerate() {
        let light = simulation.row(row, 0.8, 1.0);
        let brightest = light.iter().fold(0.0f32, |a, &b| a.max(b));
        println!("row {row}: {brightest:.1} counts at most");
        for (&pixel, &mean) in pixels.iter().zip(mean.row(i)) {
            worst = worst.max((f64::from(light[pixel]) / 1000.0 - f64::from(mean) * unit).abs());
        }
    }
    worst
}

/// Light that adds without interference, computed twice: from the patterns of a scene, and from the mean of
/// the field, point by point. The two computations share no formula.
#[test]
fn rows_of_a_camera_agree_with_the_mean_of_the_field() {
    let laser = Laser::focused(1e-3, 0.8);
    let view = View::at(0.8);
    let scattering = Scattering::surface();

    let slit = camera(Aperture::PAPER_SLIT);
    let centre = slit.optics.centre(0.8);
    let simulation = Simulation::new(slit);
    let pixels: Vec<usize> = (0..12).map(|i| centre as usize - 40 + 7 * i).collect();
    // The middle, the shadow's end with its fringes, and beyond.
    let rows = [299u64, 200, 90, 60, 45, 38, 32, 29, 20, 560, 575];
    let (at, of) = ((&simulation, centre), (&pixels[..], &rows[..]));
    let worst = worst_on_camera(at, of, |columns, places| {
        let aperture = SlitAperture::nominal();
        let mean = field::slit_mean(&laser, &scattering, &view, &aperture, columns, places);
        (mean, 1.0)
    });
    // The field's scatterers reach to 2.25 radii of the beam, and it is sampled at the pixels' middles.
    println!("slit: off by {worst:.5} of the middle");
    assert!(worst < 4e-3);

    for (waves, focus) in [(0.0, None), (1.0, None), (0.7, Some(0.7))] {
        let range = view.range();
        let mut scene = camera(Aperture::PAPER_LENS);
        let centre = scene.optics.centre(0.8);
        let x = (centre - scene.optics.axis) * 5.86e-6;
        // From the lens to the target along the axis.
        let depth = range * 0.05 / x.hypot(0.05);
        scene.defocus = focus.map(|focus_distance| Defocus { focus_distance });
        let field = 5.6e-3;
        scene.coma = Some(Coma { waves, field });
        // What is in focus, for the field: the range with the same defocus.
        let at_depth = |focus: f64| 1.0 / (1.0 / range - 1.0 / depth + 1.0 / focus);
        let sharp = focus.map_or(range, at_depth);
        let lens = LensAperture {
            diameter: 50e-3 / 12.0,
            focal_length: 1.0 / (1.0 / 0.05 + 1.0 / sharp),
            focus_distance: sharp,
            coma: waves,
            full_field: 5.6e-3,
            pixel: 5.86e-6,
            samples: 1,
        };
        let focused = |distance: f64| 1.0 / (1.0 / 0.05 + 1.0 / distance);
        let ideal = with(lens, |it| {
            (it.focal_length, it.focus_distance, it.coma) = (focused(range), range, 0.0);
        });
        let simulation = Simulation::new(scene);
        let pixels: Vec<usize> = (0..9).map(|i| centre as usize - 12 + 3 * i).collect();
        let mut middle = 0.0;
        let rows = [300u64, 303, 294, 310];
        let (at, of) = ((&simulation, centre), (&pixels[..], &rows[..]));
        let worst = worst_on_camera(at, of, |columns, places| {
            let mean = |lens, columns: &[f64], places: &[f64]| {
                field::lens_mean(&laser, &scattering, &view, lens, x, columns, places)
            };
            let light = mean(&lens, columns, places);
            middle = light.density / mean(&ideal, &[0.0], &[0.0]).density;
            (light, middle)
        });
        println!("lens, coma {waves}, focus {focus:?}: {middle:.3}, off by {worst:.5}");
        // Pixels of 5.86 um gather 0.6 % less at the top of a spot with a sigma of 15 um than there is:
        // pitch^2 / 24 sigma^2.
        assert!(worst < 1.2e-2);
    }
}

/// The mean over surfaces is the scene without speckle, with any aperture and sensor.
#[test]
fn speckle_keeps_the_mean() {
    const SEEDS: u64 = 40;
    let line = |aperture| {
        with(plain_with(&fresnel(1e-3)), |it| {
            it.optics.aperture = aperture
        })
    };
    let blurred = listing(line(Aperture::PAPER_LENS), "defocus.focus_distance = 0.6");
    for (name, scene, row) in [
        ("slit on a line", line(Aperture::PAPER_SLIT), 0),
        ("lens on a line", line(Aperture::PAPER_LENS), 0),
        ("blurred lens on a line", blurred, 0),
        ("slit on a camera", camera(Aperture::PAPER_SLIT), 250),
        ("lens on a camera", camera(Aperture::PAPER_LENS), 303),
    ] {
        let sum = |seed, speckle| {
            let scene = with(scene.clone(), |it| (it.seed, it.speckle) = (seed, speckle));
            moments(&scene.row(row, 0.8, 1.0)).0
        };
        let plain = sum(1, None);
        let speckle = Some(PAPER);
        let sums: Vec<f64> = (0..SEEDS).map(|seed| sum(seed, speckle) / plain).collect();
        let n = SEEDS as f64;
        let mean = statistics::mean(&sums);
        let deviation = rms(sums.iter().map(|sum| sum - mean));
        println!("{name}: {mean:.3} of the light, {deviation:.3} from surface to surface");
        assert!((mean - 1.0).abs() < 4.0 * deviation / n.sqrt() + 0.01);
        assert!(deviation > 0.02);
    }
}

/// Dorsch, Haeusler, Herrmann, Appl. Opt. 33, 1306 (1994), for a gaussian spot and a round pupil: the centre
/// of mass of the image scatters by lambda z / (2 pi a) / sqrt 2 (its derivation: `field::tests`).
#[test]
fn speckle_scatters_a_lens_as_dorsch_haeusler_and_herrmann_say() {
    const SEEDS: u64 = 120;
    let lens = lens_with(&fresnel(1e-3));
    let speckle = Some(with(PAPER, |it| it.polarisations = 1));
    let scene = |seed| with(lens.clone(), |it| (it.seed, it.speckle) = (seed, speckle));
    let truth = scene(0).optics.centre(0.8);
    let off = |seed| moments(&scene(seed).row(0, 0.8, 1.0)).1 - truth;
    let scatter = rms((0..SEEDS).map(off));
    // The spot is seen under an angle: an ellipse.
    let cosine = 0.8 / 0.3f64.hypot(0.8);
    let expected = 650e-9 * 0.05 / (TAU * 25e-3 / 12.0) * (0.5 * cosine).sqrt() / 8e-6;
    println!("{scatter:.4} for {expected:.4} pixels");
    // 120 surfaces: 6.5 %; a spot of finite size has less, 0.92 of it by 400 surfaces.
    assert!((scatter / expected - 1.0).abs() < 0.2);
}

#[test]
fn speckle_changes_only_with_the_surface() {
    let scene = |seed, wander| {
        let light = format!(
            "laser_spot = {{ waist = 1e-3, waist_distance = 0.8, wander = {wander} }}
            speckle = {{ polarisations = 2, linewidth = 1e-9, path_spread = 100e-6 }}"
        );
        let camera = with(camera(Aperture::PAPER_SLIT), |it| it.seed = seed);
        listing(camera, &light)
    };
    let simulation = Simulation::new(scene(5, 0.0));
    let row = |row, distance| simulation.row(row, distance, 1.0);
    let of = |scene: Scene| scene.row(300, 0.8, 1.0);
    let here = row(300, 0.8);
    let again = simulation.clone().row(300, 0.8, 1.0);
    assert_eq!(here, row(300 + 7 * 600, 0.8), "every frame at rest");
    assert_eq!(here, again, "every simulation");
    assert_eq!(here, of(scene(5, 0.0)), "and without one");
    assert_ne!(here, of(scene(6, 0.0)), "but not every surface");
    // A surface by its number is that of the seed as much further on.
    let mut replaced = simulation.clone();
    replaced.set_surface(2);
    let other = of(scene(7, 0.0));
    assert_eq!(replaced.row(300, 0.8, 1.0), other);
    let numbered = Simulation::on_surface(scene(5, 0.0), 2);
    assert_eq!(numbered.row(300, 0.8, 1.0), other);
    let from_truth = |row: &[f32], distance: f64| {
        let centre = simulation.scene().optics.centre(distance);
        moments(row).1 - centre
    };
    // 25 um further on it is nearly the same, 20 mm further on another.
    let offs = [0.8, 0.800_025, 0.82].map(|distance| from_truth(&row(300, distance), distance));
    println!("centres of mass off by {offs:.3?} pixels");
    assert!((offs[0] - offs[1]).abs() < 0.1 * (offs[0] - offs[2]).abs());
    // The same way with a beam that slides over the surface by 1.2 mm: another.
    let slid = from_truth(&of(scene(5, 1.5e-3)), 0.8);
    println!("slid by 1.2 mm: {slid:.3}");
    assert!((slid - offs[0]).abs() > 0.2);
    // Without a laser spot, light of a point: no speckle.
    let point = scene(5, 0.0).without(Effect::LaserSpot);
    assert_eq!(of(point.clone()), of(point.without(Effect::Speckle)));
}

/// From the darkest to the brightest in equal steps of the logarithm, and back. Lamps do not change.
#[test]
fn targets_of_different_reflectivity_follow_one_another() {
    let effects = "spot = { width = 8.0, counts_per_second = 1e6 }
        ambient = { counts_per_second = 2e4, slope = 0.0 }
        reflectivity = { darkest = 1e-4, steps = 2, seconds = 0.5 }";
    let scene = listing(Scene::dark(Sensor::Tcd1304dg), effects);
    let exposure = 0.005;
    let rows_a_second = 1.0 / scene.period();
    let centre = scene.optics.centre(scene.distance).round() as usize;
    let lamps = 2e4 * exposure;
    let brightest = scene.clone().without(Effect::Reflectivity);
    let brightest = brightest.row(0, scene.distance, exposure);
    let brightest = f64::from(brightest[scene.geometry().light.start + centre]) - lamps;
    let times = [0.0, 0.49, 0.51, 1.25, 1.75, 2.25, 2.75, 3.25];
    let factors = [1e-4, 1e-4, 1e-2, 1.0, 1e-2, 1e-4, 1e-2, 1.0];
    for (time, factor) in times.into_iter().zip(factors) {
        let row = (time * rows_a_second).round() as u64;
        let counts = scene.row(row, scene.distance, exposure);
        let light = &counts[scene.geometry().light.clone()];
        let expected = factor * brightest + lamps;
        let (found, dark) = (f64::from(light[centre]), f64::from(light[100]));
        println!("{time} s: {found:.3} counts, expected {expected:.3}; beside the spot {dark:.3}");
        assert!((found / expected - 1.0).abs() < 1e-4);
        assert!((dark / lamps - 1.0).abs() < 1e-4);
    }
}
