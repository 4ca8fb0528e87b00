//! Each part of u alone: where it is large, the errors are as large as it says.

use host_tests::accuracy::answers;
use simulator::scene::{
    BlackLevel, FixedPattern, ReadNoise, Response, Scene, Sensor, Spot, quantise,
};
use slitrange::centre::Estimator;

const SENSORS: u64 = 4000;

fn scene(width: f64, height: f64) -> Scene {
    Scene {
        spot: Some(Spot {
            width,
            counts_per_second: height,
        }),
        black_level: Some(BlackLevel::steady(300.0)),
        read_noise: Some(ReadNoise { counts: 4.0 }),
        shot_noise: Some(simulator::scene::ShotNoise {
            electrons_per_count: 10.0,
        }),
        ..Scene::dark(Sensor::Row(2048))
    }
}

/// RMS error in pixels over sensors whose pixels differ, by estimator.
fn errors(scene: &Scene) -> [(f64, usize); 5] {
    let geometry = scene.geometry();
    Estimator::ALL.map(|estimator| {
        let squares: Vec<f64> = (0..SENSORS)
            .filter_map(|seed| {
                let centre = 1023.5 + (seed as f64 * 0.618_034).fract();
                let scene = Scene {
                    seed,
                    ..scene.clone()
                };
                let counts = quantise(&scene.row_with_centre(0, centre, 1.0), 4095);
                let found = answers(&geometry, &counts, estimator)[1].ok()?;
                Some((found.centre.to_f64() - centre).powi(2) - found.uncertainty.to_f64().powi(2))
            })
            .collect();
        (
            (squares.iter().sum::<f64>() / squares.len() as f64).sqrt(),
            squares.len(),
        )
    })
}

#[test]
fn pixels_print() {
    for (width, height) in [2.0, 4.0, 9.0, 20.0, 60.0]
        .into_iter()
        .flat_map(|w| [(w, 300.0), (w, 2000.0)])
    {
        let response = Scene {
            response: Some(Response { deviation: 0.05 }),
            ..scene(width, height)
        };
        let offset = Scene {
            fixed_pattern: Some(FixedPattern { counts: 10.0 }),
            ..scene(width, height)
        };
        let r = errors(&response).map(|(e, n)| format!("{:.3} ({n})", e / 0.05 / width.sqrt()));
        let o =
            errors(&offset).map(|(e, n)| format!("{:.3} ({n})", e * height / 10.0 / width.sqrt()));
        println!("{width} {height} response {r:?}\n    offset {o:?}");
    }
}
