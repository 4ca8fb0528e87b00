//! Weights for speckle ([`phase_tables::SPECKLE`]): what they cost where there is noise alone.

use host_tests::accuracy::{Cell, centre_of};
use host_tests::core_tables;
use host_tests::scene::quantise;
use phase_tables::{SPECKLE, gaussian, set};
use slitrange::estimator::phase_table;
use slitrange::estimator::tables::{GAUSSIAN, Sampling, TableSet};
use slitrange::row::Row;
use slitrange::spot;

/// A gaussian's derivative s widths wide, x exp(-x^2 / 2 s^2), finds the centre with ((1 + s^2) / 2 s)^(3/2) of the bound in white noise: 1.746
/// for s = 0.4. It looks at the spot's top only, so the default weights tell it where that is.
#[test]
fn in_white_noise_they_cost_what_the_closed_form_says() {
    let s: f64 = 0.4;
    let expected = ((1.0 + s * s) / (2.0 * s)).powf(1.5);
    let designed = set(&gaussian, SPECKLE);
    let borrowed = core_tables::borrow(&designed);
    let tables = TableSet::new(&borrowed).expect("proven");
    // On widths of the set.
    for step in [16, 28, 31] {
        let width = SPECKLE.widths.narrowest * SPECKLE.widths.ratio.powi(step);
        let cell = Cell {
            width,
            amplitude: 1000.0,
            read_noise: 5.0,
            electrons_per_count: None,
            rows: 20_000,
            seed: 9,
        };
        let (scene, geometry) = (cell.scene(), cell.scene().geometry());
        let (mut squares, mut pulls, mut sum) = (0.0, 0.0, 0.0);
        for row in 0..cell.rows {
            let truth = cell.true_centre(row);
            let light = quantise(&scene.row_with_centre(row, truth, 1.0), 4095);
            let first = centre_of(&geometry, &light, &GAUSSIAN).expect("a centre");
            let row = Row::new(&light, &[], 4095).expect("12 bits");
            let spot = spot::find(&row).expect("a spot");
            let sampling = Sampling::Fine;
            let centre =
                phase_table::centre(&row, &spot, Some(&first), &geometry, &tables, sampling)
                    .expect("a centre");
            let error = centre.centre.to_f64() - truth;
            sum += error;
            squares += error * error;
            pulls += (error / centre.uncertainty.to_f64()).powi(2);
        }
        let rows = cell.rows as f64;
        let bound = host_tests::bound::Spot {
            width,
            amplitude: cell.amplitude,
            noise: cell.read_noise,
            electrons_per_count: None,
        }
        .bound();
        let (ratio, pull) = ((squares / rows).sqrt() / bound, (pulls / rows).sqrt());
        println!(
            "sigma {width:.2}: {ratio:.3} of the bound, {expected:.3} expected; pull {pull:.3}; bias {:.5} px",
            sum / rows
        );
        // 20,000 rows: 0.5 %.
        assert!((ratio / expected - 1.0).abs() < 0.015);
        assert!((pull - 1.0).abs() < 0.05);
        assert!((sum / rows).abs() < 4.0 * bound * expected / rows.sqrt());
    }
}
