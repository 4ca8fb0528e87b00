//! How far flaws are hidden: the shift that an estimator takes for the spot's, over what the spot's shape
//! says of it. From the flaws' own formulas, without rows and without noise.

use crate::support::*;

/// Distance between two samples in widths, and how far the check looks.
const PITCH: f64 = 1.0 / 6.4;
const REACH: f64 = 6.0;

fn gaussian(u: f64) -> f64 {
    (-0.5 * u * u).exp()
}

/// The shift that hides in a flaw's light, and the uncertainty by its shape. The noise's variance is `white`
/// plus the spot's light.
fn hidden(flaw: impl Fn(f64) -> f64, white: f64) -> (f64, f64) {
    let places = (0..).map(|i| (f64::from(i) + 0.5) * PITCH);
    let places: Vec<f64> = places.take_while(|u| *u < REACH).collect();
    let product = |f: &[f64], g: &[f64]| -> f64 {
        let terms = places.iter().zip(f).zip(g);
        let terms = terms.map(|((u, f), g)| f * g / (white + gaussian(*u)));
        terms.sum()
    };
    let functions: [fn(f64) -> f64; COMPONENTS] = [
        |u| u * gaussian(u),
        |u| u,
        |u| u.powi(3) * gaussian(u),
        |u| u.powi(5) * gaussian(u),
        |u| u.powi(7) * gaussian(u),
    ];
    let mut basis: Vec<Vec<f64>> = vec![];
    for function in functions {
        let mut values: Vec<f64> = places.iter().map(|u| function(*u)).collect();
        for before in &basis {
            let part = product(&values, before);
            let pairs = values.iter_mut().zip(before);
            pairs.for_each(|(value, before)| *value -= part * before);
        }
        let norm = product(&values, &values).sqrt();
        values.iter_mut().for_each(|value| *value /= norm);
        basis.push(values);
    }
    let odd: Vec<f64> = places.iter().map(|u| flaw(*u) - flaw(-u)).collect();
    let parts: Vec<f64> = basis.iter().map(|it| product(&odd, it)).collect();
    // The largest part as 100 pixels, so that rounding does not matter. The estimator hides the first.
    let scale = 100.0 / judges::accuracy::largest(&parts);
    let mut components = [Pixels::default(); COMPONENTS];
    for (component, part) in components.iter_mut().zip(&parts).skip(1) {
        *component = Pixels::from_f32((part * scale) as f32);
    }
    let shape = with(SpotShape::default(), |it| it.components = components);
    ((parts[0] * scale).abs(), shape.uncertainty(None).to_f64())
}

type Draw = fn(&mut ChaCha8Rng) -> Box<dyn Fn(f64) -> f64>;

const KINDS: [(&str, Draw); 5] = [
    ("shadow", |random| {
        let (width, place) = (random.random_range(0.2..1.5), random.random_range(0.3..2.2));
        Box::new(move |u| -gaussian(u) * gaussian((u - place) / width))
    }),
    ("second reflection", |random| {
        let (place, width) = (random.random_range(1.0..5.0), random.random_range(0.8..2.0));
        Box::new(move |u| gaussian((u - place) / width))
    }),
    ("fringes", |random| {
        let (period, phase) = (random.random_range(0.5..5.0), TAU * random.random::<f64>());
        Box::new(move |u| gaussian(u) * (TAU * u / period + phase).sin())
    }),
    ("tail", |random| {
        // The light that reaches u from all places before it.
        let length = random.random_range(0.3..4.0);
        Box::new(move |u| {
            let steps = (0..600).map(|step| 0.02 * f64::from(step));
            let terms = steps.map(|back| gaussian(u - back) * (-back / length).exp());
            terms.sum()
        })
    }),
    ("grain", |random| {
        let length = random.random_range(0.1..0.5);
        let mut wave = || {
            let normal: f64 = StandardNormal.sample(random);
            (normal / length, TAU * random.random::<f64>())
        };
        let waves: Vec<(f64, f64)> = (0..24).map(|_| wave()).collect();
        Box::new(move |u| {
            let field: f64 = waves.iter().map(|(k, phase)| (k * u + phase).cos()).sum();
            gaussian(u) * field
        })
    }),
];

/// Errors are as large as the standard uncertainty on average, and seldom five times as large.
#[test]
fn the_uncertainty_by_the_shape_covers_what_flaws_hide() {
    const FLAWS: usize = 600;
    let mut random = random(16);
    println!("hidden shift over its uncertainty: median, 90 %, 99 %, root mean square");
    for (name, draw) in KINDS {
        let ratios = (0..FLAWS).map(|number| {
            let flaw = draw(&mut random);
            // White noise, a mix, and shot noise.
            let (shift, uncertainty) = hidden(flaw, [100.0, 0.1, 0.01][number % 3]);
            shift / uncertainty
        });
        let mut ratios: Vec<f64> = ratios.collect();
        ratios.sort_by(f64::total_cmp);
        let quantile = |share: f64| ratios[(share * FLAWS as f64) as usize];
        let rms = statistics::rms(&ratios);
        let quantiles = [0.5, 0.9, 0.99].map(quantile);
        println!("{name:>18}: {quantiles:.2?} {rms:.2}");
        assert!(quantile(0.99) <= 5.0, "{name}");
        assert!((0.1..=1.5).contains(&rms), "{name}: {rms}");
    }
}
