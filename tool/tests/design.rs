//! The closed forms of `slitrange design` against the simulation, the core and the pages.

use clap::Parser as _;
use simulator::bound;
use simulator::optics::{Aperture, Optics};
use simulator::scene::{Diffraction, LaserSpot, Sensor as Kind};
use slitrange::base::drawing::{DRAWING, T};
use slitrange_tool::Command;
use slitrange_tool::design::errors::At;
use slitrange_tool::design::geometry::Geometry;
use slitrange_tool::design::{DesignOptions, Surface};

use crate::command::*;

fn options(arguments: &str) -> DesignOptions {
    let words = arguments.split_whitespace();
    let words = ["slitrange", "design"].into_iter().chain(words);
    match Command::try_parse_from(words).expect("options") {
        Command::Design(options) => options,
        _ => panic!("another command"),
    }
}

fn printed(arguments: &str) -> String {
    let words = ["design"].into_iter().chain(arguments.split_whitespace());
    let words: Vec<&str> = words.collect();
    done(slitrange(&RealPc::default(), &words, ""))
}

fn part(at: &At, name: &str) -> f64 {
    let part = at.parts.iter().find(|part| part.0 == name);
    part.expect("a part").1
}

/// The same geometry in the simulation, in metres.
fn optics(options: &DesignOptions) -> Optics {
    let geometry = options.design().expect("a design").geometry;
    Optics {
        offset: 1e-3 * geometry.offset,
        baseline: 1e-3 * geometry.baseline,
        focal_length: 1e-3 * geometry.focal,
        angle: geometry.angle,
        pitch: 1e-3 * geometry.pitch,
        axis: geometry.axis,
        wavelength: 1e-9 * options.wavelength,
        aperture: Aperture::Slit {
            width: 1e-6 * options.slit,
            height: 3e-3,
        },
    }
}

#[test]
fn distances_are_those_of_the_simulation_and_of_the_core() {
    let options = options("--baseline 120 --near 150 --far 400 --slit-to-sensor 30");
    let geometry = options.design().expect("a design").geometry;
    let optics = optics(&options);
    let (d, k, pole) = geometry.eq1();
    for distance in [150.0, 222.2, 400.0] {
        let centre = geometry.centre(distance);
        assert!((centre - optics.centre(1e-3 * distance)).abs() < 1e-9);
        assert!((geometry.distance(centre) - distance).abs() < 1e-9);
        assert!((d + k / (centre - pole) - distance).abs() < 1e-9);
        let slope = 1e3 * optics.metres_per_pixel(centre);
        assert!((geometry.mm_a_pixel(distance) / slope - 1.0).abs() < 1e-5);
    }
    // Both ends are equally far from the middle of the row.
    let middle = 0.5 * (geometry.centre(150.0) + geometry.centre(400.0));
    assert!((middle - geometry.axis).abs() < 1e-9);

    // The nominal curve, which the firmware has before a calibration.
    let nominal = Geometry {
        offset: 0.0,
        baseline: 1e-3 * f64::from(DRAWING.baseline_um),
        focal: 1e-3 * f64::from(DRAWING.pitch_um * DRAWING.focal_px),
        angle: T.atan(),
        pitch: 1e-3 * f64::from(DRAWING.pitch_um),
        pixels: 3648,
        axis: f64::from(DRAWING.axis_px),
    };
    let curve = slitrange::distance::eq1::NOMINAL.expect("a curve");
    let centre = slitrange::base::units::Pixels::from_int(1770);
    let (distance, _) = curve.distance_at(centre).expect("in range");
    let found = nominal.distance(1770.0);
    let core = 1e-3 * f64::from(distance.to_bits()) / 256.0;
    println!("nominal: {found} mm, core: {core} mm");
    assert!((found - core).abs() < 1e-4);
}

/// The simulation's bound knows the rounding of the converter, which is a part of its own here.
#[test]
fn the_noise_is_the_bound() {
    for (height, electrons, noise) in [(2000.0, 10.0, 4.0), (500.0, 5.0, 2.0), (3500.0, 20.0, 20.0)]
    {
        for slit in [100.0, 200.0, 300.0] {
            let options = DesignOptions {
                height,
                electrons,
                noise,
                slit,
                ..options("")
            };
            let at = options.design().expect("a design").at(800.0);
            let bound = bound::Spot {
                width: at.width,
                amplitude: height,
                noise,
                electrons_per_count: Some(electrons),
            }
            .bound();
            let rounding = part(&at, "quantisation") * f64::from(options.rows).sqrt();
            let found = at.noise_of_a_row.hypot(rounding) / at.um_a_pixel;
            println!(
                "{height} {electrons} {noise} {slit}: {:.4} of the bound",
                found / bound
            );
            assert!((found / bound - 1.0).abs() < 0.01);
        }
    }
}

#[test]
fn the_width_is_that_of_the_simulated_spot() {
    for (slit, spot, distance, focal) in [
        (100.0, 1.0, 800.0, 50.0),
        (150.0, 0.3, 600.0, 50.0),
        (200.0, 0.5, 800.0, 50.0),
        (200.0, 2.0, 1000.0, 50.0),
        (250.0, 1.0, 700.0, 50.0),
        (200.0, 1.0, 800.0, 30.0),
        (300.0, 1.0, 800.0, 80.0),
    ] {
        let options = DesignOptions {
            slit,
            spot,
            slit_to_sensor: focal,
            ..options("")
        };
        let at = options.design().expect("a design").at(distance);
        let simulation = Simulation::new(Scene {
            optics: optics(&options),
            spot: Some(Spot::new(8.6, 350_000.0)),
            diffraction: Some(Diffraction::Fresnel),
            laser_spot: Some(LaserSpot::new(1e-3 * spot, 1e-3 * distance)),
            ..Scene::dark(Kind::Tcd1304dg)
        });
        let simulated = simulation.spot_width(1e-3 * distance);
        println!(
            "slit {slit} um, spot {spot} mm, {distance} mm, f {focal} mm: {:.3} px, simulated {simulated:.3}",
            at.width
        );
        assert!((at.width / simulated - 1.0).abs() < 0.02);
    }
}

/// Against the figures of the pages, which the simulation of the field gave, at 0.8 m behind the nominal
/// slit: docs/physics.md (combs) and the comparison of one slit with several. The worst is a metal's single
/// slit, whose mean square has no bound in theory.
#[test]
fn speckle_is_that_of_the_simulated_field_to_a_quarter() {
    for (surface, comb, spot, simulated) in [
        (Surface::Paper, false, 1.0, 467.0),
        (Surface::Paper, false, 0.5, 260.0),
        (Surface::DiodeOnPaper, false, 1.0, 257.0),
        (Surface::DiodeOnPaper, false, 0.5, 152.0),
        (Surface::Metal, false, 1.0, 838.0),
        (Surface::Metal, false, 0.5, 499.0),
        (Surface::Paper, true, 1.0, 97.0),
        (Surface::Paper, true, 0.5, 50.0),
        (Surface::Metal, true, 1.0, 148.0),
        (Surface::Metal, true, 0.5, 73.0),
    ] {
        let options = DesignOptions {
            surface,
            comb,
            spot,
            ..options("")
        };
        let um = part(&options.design().expect("a design").at(800.0), "speckle");
        println!("{surface:?}, comb {comb}, {spot} mm: {um:.0} um, simulated {simulated} um");
        assert!((um / simulated).ln().abs() < 1.25f64.ln());
    }
}

/// The firmware takes 16 um at 0.8 m for the same 2.8 % (docs/uncertainty.md, docs/exposure.md). Its
/// estimator weighs pixels a little better than the least-squares fit of the closed form.
#[test]
fn pixels_that_differ_move_the_distance_as_the_firmware_says() {
    let options = options("--angle 68.9624");
    let um = part(&options.design().expect("a design").at(800.0), "pixels");
    println!("{um:.1} um");
    assert!((um / 16.0).ln().abs() < 1.25f64.ln());
}

/// The pixel on which light from a target falls: slit + t (slit - target) = middle + x row.
fn by_ray(geometry: &Geometry, [target, slit, middle, row]: [(f64, f64); 4]) -> f64 {
    let ray = (slit.0 - target.0, slit.1 - target.1);
    let gap = (middle.0 - slit.0, middle.1 - slit.1);
    let x = (ray.0 * gap.1 - ray.1 * gap.0) / (ray.1 * row.0 - ray.0 * row.1);
    geometry.axis + x / geometry.pitch
}

/// A straight beam, a point for a slit and a straight row make a curve of three parameters, whatever their
/// places and angles are. So a calibration, which fits the three, takes every error of the assembly away.
#[test]
fn a_calibration_takes_the_tolerances_away() {
    let geometry = options("").design().expect("a design").geometry;
    let (sin, cos) = geometry.angle.sin_cos();
    // Where light from a target falls on a row with its middle moved by `along` and turned by `turn`.
    let centre = |distance: f64, beam: f64, (moved, turn, deeper): (f64, f64, f64)| {
        let target = (distance * f64::sin(beam), distance * f64::cos(beam));
        let (slit, depth) = (geometry.baseline, geometry.focal + deeper);
        let middle = (slit + depth * cos + moved * sin, moved * cos - depth * sin);
        let row = f64::sin_cos(geometry.angle + turn);
        by_ray(&geometry, [target, (slit, 0.0), middle, row])
    };
    for distance in [600.0, 800.0, 1020.0] {
        assert!((centre(distance, 0.0, (0.0, 0.0, 0.0)) - geometry.centre(distance)).abs() < 1e-6);
    }
    for (beam, built) in [
        (0.01, (0.0, 0.0, 0.0)),
        (0.0, (0.5, 0.0, 0.0)),
        (0.0, (0.0, 0.05, 0.0)),
        (-0.02, (-0.3, 0.03, 1.5)),
    ] {
        // D, K and xp through three points: d (x - xp) = D (x - xp) + K, so d x = D x + xp d + c.
        let points = [600.0, 780.0, 1020.0].map(|d| (centre(d, beam, built), d));
        let rows = points.map(|(x, d)| nalgebra::RowVector3::new(x, d, 1.0));
        let right = nalgebra::Vector3::from(points.map(|(x, d)| x * d));
        let decomposed = nalgebra::Matrix3::from_rows(&rows).lu();
        let found = decomposed.solve(&right).expect("three points");
        let (d, pole) = (found[0], found[1]);
        let k = found[2] + d * pole;
        let worst = (0..=42)
            .map(|i| 600.0 + 10.0 * f64::from(i))
            .map(|distance| (d + k / (centre(distance, beam, built) - pole) - distance).abs())
            .fold(0.0, f64::max);
        println!("beam {beam}, sensor {built:?}: {worst:.1e} mm");
        assert!(worst < 1e-6);
    }
}

/// Rays from a target through a displaced slit to a displaced row.
#[test]
fn a_wrong_dimension_moves_the_distance_as_rays_say() {
    let geometry = options("").design().expect("a design").geometry;
    let turn = 0.1f64.to_radians();
    // The slit's place along the row, the row's depth, a wider baseline, the angles of block and beam.
    let built = [
        (0.1, 0.0, 0.0, 0.0, 0.0),
        (0.0, 0.1, 0.0, 0.0, 0.0),
        (0.0, 0.0, 0.1, 0.0, 0.0),
        (0.0, 0.0, 0.0, -turn, 0.0),
        (0.0, 0.0, 0.0, 0.0, turn),
    ];
    for distance in [600.0, 800.0, 1020.0] {
        for (&(place, deeper, wider, block, beam), (name, mm)) in
            built.iter().zip(geometry.tolerances(distance))
        {
            let (sin, cos) = (geometry.angle + block).sin_cos();
            let (hole, focal) = (geometry.baseline + wider, geometry.focal + deeper);
            let slit = (hole + place * sin, place * cos);
            let target = (distance * beam.sin(), distance * beam.cos());
            let middle = (hole + focal * cos, -focal * sin);
            let centre = by_ray(&geometry, [target, slit, middle, (sin, cos)]);
            let by_rays = (geometry.distance(centre) - distance).abs();
            println!("{name}: {mm:.3} mm, by rays {by_rays:.3} mm");
            assert!((by_rays - mm).abs() < 1e-6);
        }
    }
}

/// By the 3 x 3 matrix the mean of the leverage over the points is 3/n, whatever the weights are.
#[test]
fn the_calibration_is_worse_at_the_ends_of_the_range() {
    let design = options("--angle 68.9624").design().expect("a design");
    let [first, last] = [1020.0, 600.0].map(|distance| design.geometry.centre(distance));
    let mut leverage = 0.0;
    for i in 0..30 {
        let centre = first + (last - first) * f64::from(i) / 29.0;
        let at = design.at(design.geometry.distance(centre));
        let point = part(&at, "speckle").hypot(10.0).hypot(part(&at, "noise"));
        leverage += (part(&at, "calibration") / point).powi(2);
    }
    println!("leverage {leverage}");
    assert!((leverage - 3.0).abs() < 1e-3);
    // A separate weighted fit of D, K and xp gave these.
    for (distance, due) in [
        (600.0, 172.0),
        (705.0, 101.0),
        (810.0, 129.0),
        (915.0, 146.0),
        (1020.0, 328.0),
    ] {
        let um = part(&design.at(distance), "calibration");
        println!("{distance} mm: {um:.1} um");
        assert!((um - due).abs() < 1.0);
    }
}

/// Holds that a design is printed in short lines, and that each of its numbers is one.
fn assert_clean(arguments: &str) {
    let is_clean = |line: &str| line.len() <= 110 && !line.contains("NaN") && !line.contains("inf");
    let text = printed(arguments);
    assert!(text.lines().all(is_clean), "{arguments}: {text}");
}

#[test]
fn numbers_at_the_edges_are_taken_and_those_beyond_are_refused() {
    for (name, least, most) in [
        ("--baseline", 1.0, 1e5),
        ("--near", 1.0, 1019.0 / 1.001),
        ("--far", 600.6, 1e5),
        ("--spot", 0.01, 100.0),
        ("--wavelength", 200.0, 2000.0),
        ("--height", 1.0, 4096.0),
        ("--electrons", 0.1, 1e4),
        ("--noise", 0.01, 1000.0),
        ("--rows", 1.0, 65535.0),
        ("--pixels", 0.0, 100.0),
        ("--points", 3.0, 10000.0),
        ("--stage", 0.0, 1e4),
        ("--warmer", 0.0, 100.0),
        ("--expansion", 0.0, 1000.0),
    ] {
        for taken in [least, most] {
            assert_clean(&format!("{name}={taken}"));
        }
    }
    let refusals = "--rows 4294967295; --points 2000000000; --spot 1e9; --wavelength 1e-9; \
                    --slit-to-sensor 1e9; --slit 5000 --wavelength 201; --far 1e300; --baseline 1e300; \
                    --height 1e300; --baseline 0; --far 900 --near 900; --far NaN; --spot NaN; --spot inf; \
                    --slit 1; --slit 9000; --angle 90; --angle NaN; --points 2; --rows 0; --stage=-1";
    for refused in refusals.split("; ") {
        let error = options(refused).design().expect_err(refused).to_string();
        begins(&error, refused.split([' ', '=']).next().expect("a name"));
    }
    assert!(Command::try_parse_from("slitrange design --comb --slit 100".split(' ')).is_err());
}

/// What the slit may be depends on its distance to the sensor, on the wavelength and on the target.
#[test]
fn slit_and_slit_to_sensor_are_taken_at_the_edges_of_their_ranges() {
    let ends = "--slit-to-sensor must be between 1 and 1000";
    let slit = "--slit must be between four wavelengths and a tenth of --slit-to-sensor";
    let fresnel =
        "--slit squared, over wavelength and --slit-to-sensor, must be between 0.01 and 16";
    let near = options("").baseline.hypot(options("").near);
    // The slit in micrometres at which Fresnel's number is this, with 650 nm, 50 mm behind the slit.
    let with_fresnel = |number: f64| 1e3 * (number * 650e-6 / (1.0 / 50.0 + 1.0 / near)).sqrt();
    let (least, most) = (with_fresnel(0.01), with_fresnel(16.0));
    println!("{least:.2} to {most:.1} um");
    let to_sensor = "--slit-to-sensor";
    let narrow = "--wavelength 2000 --slit 80";
    let [at_3, at_1] = [3, 1].map(|mm| format!("--wavelength 2000 {to_sensor} {mm}"));
    for (others, name, edge, beyond, error) in [
        (narrow, to_sensor, 1.0, 0.999, ends),
        ("", to_sensor, 1000.0, 1000.1, ends),
        (&at_3, "--slit", 8.0, 7.99, slit),
        (&at_1, "--slit", 100.0, 100.1, slit),
        ("", "--slit", 1.0001 * least, 0.9999 * least, fresnel),
        ("", "--slit", 0.9999 * most, 1.0001 * most, fresnel),
    ] {
        assert_clean(&format!("{others} {name}={edge}"));
        for wrong in [beyond, -edge, f64::NAN, f64::INFINITY] {
            let options = options(&format!("{others} {name}={wrong}"));
            let refused = options.design().expect_err("a wrong number").to_string();
            println!("{others} {name} {wrong}");
            begins(&refused, if wrong == beyond { error } else { name });
        }
    }
}

#[test]
fn a_range_that_does_not_fit_is_said() {
    assert!(!printed("").contains("does not fit on"));
    assert!(!printed("").contains("any distance"));
    assert!(printed("--near 420 --far 2600").contains("speckle is the largest part; does not fit"));
    assert!(printed("--angle 20").contains("take --angle 68.5"));
    assert!(printed("--near 100 --far 2000 --slit-to-sensor 100").contains("does not fit"));
    // A sensor near the slit sees to any distance, and only then does the text say so.
    assert!(printed("--slit-to-sensor 10 --near 200 --far 2000").contains("any distance"));
}

/// docs/physics.md has these distances for the default comb, from the simulation's images.
#[test]
fn a_comb_sees_the_range_that_the_simulation_says() {
    let text = printed("--comb --angle 68.9624");
    says(&text, ["the whole sensor sees 541 mm to 1198 mm"]);
}

#[test]
fn the_page_shows_what_the_command_prints() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/hardware/optics.md");
    let text = std::fs::read_to_string(page).expect("docs/hardware/optics.md");
    let mut commands = 0;
    for rest in text.split("    $ slitrange design").skip(1) {
        let (command, rest) = rest.split_once('\n').expect("a line");
        let is_shown = |line: &&str| line.is_empty() || line.starts_with("    ");
        let shown: Vec<&str> = rest.lines().take_while(is_shown).collect();
        let due = printed(command).replace('\n', "\n    ");
        let due = due.replace("    \n", "\n");
        let (shown, due) = (shown.join("\n"), format!("    {}", due.trim_end()));
        assert_eq!(shown.trim_end(), due, "slitrange design{command}");
        commands += 1;
    }
    assert!(commands > 0, "docs/hardware/optics.md shows no output");
}

#[test]
fn the_drawing_of_the_page_is_the_one_that_the_command_writes() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("design.svg");
    printed(&format!("--angle 68.9624 --drawing {}", file.display()));
    let due = std::fs::read_to_string(file).expect("a drawing");
    let is = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/hardware/dimensions.svg");
    assert!(
        std::fs::read_to_string(is).expect("docs/hardware/dimensions.svg") == due,
        "write it again: slitrange design --angle 68.9624 --drawing docs/hardware/dimensions.svg"
    );
}
