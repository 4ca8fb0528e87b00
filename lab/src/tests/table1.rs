//! The paper's Table 1, on few positions: what `cargo table1` shows on all of them.

use simulator::field::{Laser, Scattering, SlitAperture, Surface, View, slit_image};
use simulator::scene::Sensor;
use slitrange::centre;
use slitrange::spot;

use crate::paper::apparatus::Aperture;
use crate::paper::experiment::Experiment;
use crate::paper::firmware::{self, Fit, Head};
use crate::paper::materials::MATERIALS;
use crate::paper::methods::Method;
use crate::paper::published::TABLE_1;
use crate::prelude::*;

/// For each material, the slit's mean absolute error is within a factor of 1.5 of the paper's, with either
/// fit. The two fits differ by less than 15 %. Weights of the rows that suit speckle give smaller errors than
/// the paper's plain mean. The firmware's default has smaller errors than a plain gaussian fit of the same
/// rows, on the camera and on the line sensor. The test takes 210 positions, 2 mm apart, about a speckle.
#[test]
#[ignore = "five more materials take 45 s of processor time; .ci/run runs it"]
fn the_slits_errors_are_near_the_papers_and_ours_are_smaller() {
    // The next test takes the first.
    for material in 1..TABLE_1.len() {
        check(material);
    }
}

#[test]
fn the_slits_errors_are_near_the_papers_on_brushed_metal() {
    check(0);
}

fn check(material: usize) {
    let [_, [_, papers_gaussian], [_, papers_fraunhofer]] = TABLE_1[material];
    let experiment = Experiment {
        stride: 80,
        seed: 1,
    };
    let outcome = experiment.run(material, Aperture::Slit, &|| {});
    let outcome = outcome.expect("an outcome");
    let [gaussian, fraunhofer, ours] = [Method::Gaussian, Method::Fraunhofer, Method::Ours]
        .map(|method| outcome.of(method).mae * 1e6);
    let [of_gaussian, of_fraunhofer] = [gaussian / papers_gaussian, fraunhofer / papers_fraunhofer];
    println!(
        "{}: gaussian {gaussian:.0} um ({of_gaussian:.2} of the paper's), Fraunhofer {fraunhofer:.0} um \
         ({of_fraunhofer:.2}), ours {ours:.0} um",
        MATERIALS[material].name,
    );
    let within = 1.0 / 1.5..1.5;
    assert!(within.contains(&of_gaussian) && within.contains(&of_fraunhofer));
    assert!((fraunhofer / gaussian - 1.0).abs() < 0.15);
    assert!(ours < gaussian);
    let comb = Head::Line(Slits::Comb);
    for head in [Head::Camera, Head::Line(Slits::One), comb] {
        let fits = [Fit::Plain, Fit::Firmware(Estimator::default())];
        let judged = firmware::judge(head, &fits, material, 1, 80, &|| {}).expect("curves");
        let [plain, default] = [0, 1].map(|fit| judged[fit].mae * 1e6);
        println!("{head:?}: plain gaussian {plain:.1} um, firmware's default {default:.1} um");
        // 210 positions know the ratio to 0.5 %. Behind a comb all fits but the centroid are alike, to 1 %.
        assert!(default < plain * if head == comb { 1.01 } else { 1.005 });
        assert!(head != comb || default < 0.55 * gaussian);
    }
}

/// For laser spots of 1 and 2 mm, a frame's error with a gaussian is within 15 % of the error with sinc^2.
/// The test takes 120 surfaces at 0.8 m, and every 20th row.
#[test]
fn gaussian_and_fraunhofer_have_equal_errors_for_wide_spots() {
    const COLUMNS: usize = 320;
    let geometry = Sensor::Row(COLUMNS).geometry();
    let pitch = Sensor::Camera.pitch();
    let places = |count: usize, step: f64| {
        let place = |i| (i as f64 - (count as f64 - 1.0) / 2.0) * step;
        (0..count).map(place).collect::<Vec<_>>()
    };
    let (columns, rows) = (places(COLUMNS, pitch), places(26, 20.0 * pitch));
    for diameter in [1e-3, 2e-3] {
        let errors: Vec<[f64; 2]> = (0..120u64)
            .into_par_iter()
            .map(|seed| {
                let laser = Laser::focused(diameter, 0.8);
                let surface =
                    Surface::new(&laser, &Scattering::surface(), seed).expect("a surface");
                let slit = SlitAperture::nominal();
                let image = slit_image(&surface, &View::at(0.8), &slit, &columns, &rows)
                    .expect("the spot is on the surface");
                let mut sums = [0.0; 2];
                let mut used = 0.0;
                for row in 0..rows.len() {
                    let counts = image.row(row).iter().map(|light| 100.0 + 800.0 * light);
                    let counts = quantise(&counts.collect::<Vec<f32>>(), 4095);
                    let row = Row::new(&counts, &[], 4095).expect("12 bits");
                    let centre = |estimator| {
                        let (spot, _) = spot::find(&row).ok()?;
                        centre::centre(estimator, &row, &spot, None, &geometry).ok()
                    };
                    let found = [Estimator::GaussNewton, Estimator::Fraunhofer].map(centre);
                    if let [Some(gaussian), Some(fraunhofer)] = found {
                        used += 1.0;
                        for (sum, found) in sums.iter_mut().zip([gaussian, fraunhofer]) {
                            *sum += found.centre.to_f64() - (COLUMNS as f64 - 1.0) / 2.0;
                        }
                    }
                }
                sums.map(|sum| sum / used)
            })
            .filter(|errors: &[f64; 2]| errors[0].is_finite())
            .collect();
        let rms = |i: usize| statistics::rms(errors.iter().map(|errors| errors[i]));
        let (gaussian, fraunhofer) = (rms(0), rms(1));
        println!(
            "{:.0} mm: gaussian {gaussian:.3} px, Fraunhofer {fraunhofer:.3} px, {} frames",
            diameter * 1e3,
            errors.len()
        );
        assert!(errors.len() >= 110);
        assert!((fraunhofer / gaussian - 1.0).abs() < 0.15);
    }
}
