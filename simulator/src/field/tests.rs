//! Against theory.

use std::f64::consts::PI;

use statistics::{mean, rms};

use super::source::{Lit, RowSums};
use super::*;
use crate::profiles::Slit;
use crate::with;

const PIXEL: f64 = 5.86e-6;

impl View {
    /// The same with another place of the surface under the beam.
    fn of_place(self, lateral: [f64; 2]) -> Self {
        Self { lateral, ..self }
    }
}

/// Places of `count` pixels about the geometric centre, every `step`-th.
fn pixels(count: usize, step: usize) -> Vec<f64> {
    let place = |i| ((i * step) as f64 - 0.5 * count as f64) * PIXEL;
    (0..count / step).map(place).collect()
}

/// A surface just large enough for a beam of a 1/e^2 diameter, at the table's middle.
fn small_surface(laser: &Laser, scattering: &Scattering, seed: u64) -> Surface {
    let size = 2.4 * laser.waist_diameter + 0.2e-3;
    let scattering = with(*scattering, |it| it.size = [size, size]);
    Surface::new(laser, &scattering, seed).unwrap()
}

/// What the nominal slit lets through.
fn through_slit(surface: &Surface, view: &View, columns: &[f64], rows: &[f64]) -> Image {
    slit_image(surface, view, &SlitAperture::nominal(), columns, rows).unwrap()
}

/// The nominal lens, in focus on the target of `View::at(0.8)`, with one sample a pixel.
fn sharp_lens() -> LensAperture {
    with(LensAperture::nominal(View::at(0.8).range()), |it| {
        it.samples = 1
    })
}

/// The largest difference from the slit's incoherent pattern, whose middle has the light `unit` in the image.
fn largest_off(columns: &[f64], image: &Image, exact: &Slit, unit: f64) -> f64 {
    let off = |(&x, &light): (&f64, &f32)| {
        (f64::from(light) / unit - exact.light(x) / exact.light(0.0)).abs()
    };
    let pixels = columns.iter().zip(&image.light);
    pixels.map(off).fold(0.0, f64::max)
}

/// Root mean square of the difference of two images.
fn difference(a: &Image, b: &Image) -> f64 {
    rms((a.light.iter().zip(&b.light)).map(|(a, b)| f64::from(a - b)))
}

/// Standard deviation over mean.
fn contrast(values: &[f64]) -> f64 {
    ((rms(values) / mean(values)).powi(2) - 1.0).sqrt()
}

/// A beam so small that it hits a single scatterer, and right on that.
fn point() -> (Laser, View, Surface) {
    let laser = Laser::focused(1e-6, 0.8);
    let view = View::at(0.8).of_place([1.8e-6, 45e-6]);
    let surface = Surface::new(&laser, &Scattering::surface(), 1).unwrap();
    (laser, view, surface)
}

/// The centre of mass of an image's light along its rows.
fn centroid(image: &Image, places: &[f64]) -> f64 {
    let (mut sum, mut moment) = (0.0, 0.0);
    for row in 0..image.rows() {
        for (x, &light) in places.iter().zip(image.row(row)) {
            sum += f64::from(light);
            moment += f64::from(light) * x;
        }
    }
    moment / sum
}

/// A point of light makes the pattern of `profiles::Slit` along the row.
#[test]
fn a_tiny_spot_makes_the_pattern_of_a_point() {
    let (_, view, surface) = point();
    let columns = pixels(160, 1);
    let image = through_slit(&surface, &view, &columns, &[0.0]);
    let unit = f64::from(image.light[80]);
    let worst = largest_off(&columns, &image, &Slit::nominal(0.0), unit);
    println!("one scatterer against a point: within {worst:.1e} of the peak");
    assert!(worst < 1e-4);
}

/// Across the rows a point's pattern is Fresnel's integral over the slit's height, by Simpson's rule.
#[test]
fn along_the_slit_the_pattern_of_a_point_is_that_of_quadrature() {
    let laser = Laser::focused(0.2e-3, 0.8);
    let rows = pixels(640, 8);
    let slit = SlitAperture::nominal();
    let view = View::at(0.8).of_place([0.0, 0.2e-3]);
    let lit = Lit::new(&laser, &Scattering::surface(), &view);
    // The beam's axis is between two rows of scatterers; the one at +25 um.
    let column = lit.y.iter().position(|y| (y - 25e-6).abs() < 1e-9).unwrap();
    let along = slit.along(&lit, &laser, &rows);
    let (range, z, y) = (lit.range, slit.to_sensor, lit.y[column]);
    let amplitude = f64::from(lit.of_row(y, 0.0).0);
    let exact = |place: f64| {
        const STEPS: i32 = 4000;
        let (mut re, mut im) = (0.0, 0.0);
        for i in 0..=STEPS {
            let v = slit.height * (f64::from(i) / f64::from(STEPS) - 0.5);
            let weight = match i {
                0 | STEPS => 1.0,
                _ if i % 2 == 1 => 4.0,
                _ => 2.0,
            };
            let path = 0.5 * ((v - y).powi(2) / range + (place - v).powi(2) / z);
            let (sin, cos) = (2.0 * PI * path / laser.wavelength).sin_cos();
            re += weight * cos;
            im += weight * sin;
        }
        (re * re + im * im) * (slit.height / f64::from(3 * STEPS)).powi(2)
    };
    let peak = exact(0.0);
    let mut worst = 0.0f64;
    for (row, &place) in rows.iter().enumerate() {
        let (re, im) = along.row(row);
        let light = f64::from(re[column] * re[column] + im[column] * im[column]);
        worst = worst.max((light / amplitude.powi(2) - exact(place)).abs() / peak);
    }
    println!("along the slit against quadrature: within {worst:.1e} of the middle");
    assert!(amplitude > 0.5 && worst < 1e-5);
}

/// The mean along the row is `profiles`' exact pattern, blurred by the spot foreshortened by cos(theta).
#[test]
fn the_mean_through_a_slit_is_the_incoherent_pattern() {
    let view = View::at(0.8);
    for diameter in [0.5e-3, 1e-3, 2e-3] {
        let laser = Laser::focused(diameter, 0.8);
        let columns = pixels(160, 1);
        let (scattering, slit) = (Scattering::surface(), SlitAperture::nominal());
        let image = slit_mean(&laser, &scattering, &view, &slit, &columns, &[0.0]);
        let exact = Slit::nominal(diameter * view.cos_angle());
        let worst = largest_off(&columns, &image, &exact, 1.0);
        println!("spot of {diameter} m: mean within {worst:.1e} of the incoherent pattern");
        // The beam is cut at 2.25 radii.
        assert!(worst < 2e-4);
    }
}

/// The mean over 500 surfaces lies about the incoherent mean as the speckle's contrast of 1 says: deviations
/// over mean / sqrt(500) have a mean square of 1, and none is larger than 4.5, at pixels some speckles apart.
#[test]
fn the_mean_over_surfaces_is_the_incoherent_one() {
    const SURFACES: u32 = 500;
    let laser = Laser::focused(1e-3, 0.8);
    let view = View::at(0.8);
    let scattering = Scattering::surface();
    let check = |name: &str, images: &mut dyn Iterator<Item = Image>, mean: &Image| {
        let mut sums = vec![0.0; mean.light.len()];
        for image in images {
            for (sum, light) in sums.iter_mut().zip(&image.light) {
                *sum += f64::from(*light);
            }
        }
        let n = f64::from(SURFACES);
        let deviations = sums.iter().zip(&mean.light);
        let deviation = |(sum, &mean): (&f64, &f32)| (sum / n / f64::from(mean) - 1.0) * n.sqrt();
        let deviations: Vec<f64> = deviations.map(deviation).collect();
        let sizes = deviations.iter().map(|deviation| deviation.abs());
        let worst = sizes.fold(0.0, f64::max);
        let (pixels, scatter) = (deviations.len(), rms(&deviations));
        println!(
            "{name}: {pixels} pixels, deviations {scatter:.2} standard errors, at most {worst:.1}"
        );
        assert!((0.7..1.3).contains(&scatter) && worst < 4.5);
    };
    let slit = SlitAperture::nominal();
    let (columns, rows) = (pixels(160, 20), pixels(640, 64));
    let images = |seed| {
        let surface = small_surface(&laser, &scattering, seed);
        through_slit(&surface, &view, &columns, &rows)
    };
    let exact = slit_mean(&laser, &scattering, &view, &slit, &columns, &rows);
    let seeds = 0..u64::from(SURFACES);
    check("slit", &mut seeds.clone().map(images), &exact);
    let lens = with(sharp_lens(), |it| (it.coma, it.focus_distance) = (1.5, 0.8));
    let places = pixels(24, 3);
    let images = |seed| {
        let surface = small_surface(&laser, &scattering, seed);
        lens_image(&surface, &view, &lens, 4e-3, &places, &places).unwrap()
    };
    let exact = lens_mean(&laser, &scattering, &view, &lens, 4e-3, &places, &places);
    check("lens", &mut seeds.map(images), &exact);
}

/// Light at three distant places behind the slit, in units of its mean, for many surfaces.
fn speckle(laser: &Laser, scattering: &Scattering, surfaces: u64) -> Vec<f64> {
    let view = View::at(0.8);
    let (slit, rows) = (SlitAperture::nominal(), [-1e-3, 0.0, 1e-3]);
    let exact = slit_mean(laser, scattering, &view, &slit, &[0.0], &rows);
    let light = |seed| {
        let surface = small_surface(laser, scattering, 1000 + seed);
        let image = through_slit(&surface, &view, &[0.0], &rows);
        let pairs = image.light.into_iter().zip(exact.light.clone());
        pairs.map(|(light, mean)| f64::from(light / mean))
    };
    (0..surfaces).flat_map(light).collect()
}

/// Fully developed speckle: light is distributed exponentially, so that its contrast is 1 and a share 1/e
/// lies above the mean; two polarisations add up to a contrast of 1/sqrt 2.
#[test]
fn speckle_is_fully_developed() {
    let laser = Laser::focused(1e-3, 0.8);
    for (polarisations, expected, above) in [
        (1, 1.0, (-1.0f64).exp()),
        // A gamma distribution of order two: (1 + 2) exp(-2).
        (2, 0.5f64.sqrt(), 3.0 * (-2.0f64).exp()),
    ] {
        let scattering = with(Scattering::surface(), |it| it.polarisations = polarisations);
        let light = speckle(&laser, &scattering, 1000);
        let found = contrast(&light);
        let mean = mean(&light);
        let share = light.iter().filter(|&&light| light > 1.0).count() as f64 / light.len() as f64;
        println!(
            "{polarisations} polarisations: mean {mean:.3}, contrast {found:.3} for {expected:.3}, \
             above mean {share:.3} for {above:.3}"
        );
        // Standard errors over 3000 samples: mean 0.018, contrast 0.026, share 0.009.
        assert!((mean - 1.0).abs() < 0.06);
        assert!((found / expected - 1.0).abs() < 0.08);
        assert!((share - above).abs() < 0.03);
    }
}

/// Light of a broad line from paths of different lengths: C^2 = mean over pairs of paths of |coherence|^2 =
/// exp(-(s path difference)^2) with s the wavenumber's deviation. Paths differ by the depth of the material
/// (exponential, mean l: the difference is Laplacian) and, as the surface is seen from the side, by the place
/// in the spot (gaussian with w/2 sin(theta)). The mean over both is
///
/// ```text
/// C^2 = sqrt(pi) / 2 l s exp(q^2) erfc(q),  q = sqrt(1 + 4 s^2 g^2) / 2 l s,  g = w/2 sin(theta)
/// ```
///
/// and (1 + 4 s^2 g^2)^(-1/2) without depth.
#[test]
fn contrast_falls_with_linewidth_and_path_spread() {
    for (linewidth, path_spread, wavelengths) in [
        (1e-9, 0.0, 5),
        (0.2e-9, 0.5e-3, 5),
        (0.5e-9, 0.5e-3, 5),
        (1e-9, 0.5e-3, 9),
    ] {
        let laser = Laser {
            linewidth,
            wavelengths,
            ..Laser::focused(0.5e-3, 0.8)
        };
        let scattering = with(Scattering::surface(), |it| it.path_spread = path_spread);
        let found = contrast(&speckle(&laser, &scattering, 1500));
        let s = laser.wavenumber_deviation();
        let g = 0.5 * 0.25e-3 * View::at(0.8).sin_angle();
        let broadened = (1.0 + 4.0 * (s * g).powi(2)).sqrt();
        let expected = if path_spread == 0.0 {
            broadened.recip().sqrt()
        } else {
            let q = broadened / (2.0 * path_spread * s);
            let scaled = (q * q).exp() * libm::erfc(q);
            (PI.sqrt() / (2.0 * path_spread * s) * scaled).sqrt()
        };
        println!(
            "linewidth {linewidth:.1e} m, path {path_spread:.1e} m, {wavelengths} wavelengths: \
             contrast {found:.3} for {expected:.3}"
        );
        // The standard error over 4500 samples is 1.5 %, that of the few wavelengths 1.3 %.
        assert!((found / expected - 1.0).abs() < 0.06);
    }
}

/// The field in the middle of the aperture's width at places v, of the only polarisation and wavelength.
fn field_at(surface: &Surface, view: &View, v: &[f64]) -> Vec<(f64, f64)> {
    let lit = Lit::new(&surface.laser, &surface.scattering, view);
    let mut sums = RowSums::new(&lit, surface, &[0.0]);
    let mut fields = sums.fields();
    sums.set_fields(&surface.terms[0], &mut fields);
    let field = |&v: &f64| {
        let (mut re, mut im) = (0.0, 0.0);
        for (row, &y) in lit.y.iter().enumerate() {
            let (field_re, field_im) = fields.row(row);
            let (amplitude, turns) = lit.of_row(y, v);
            let (sin, cos) = (2.0 * PI * turns).sin_cos();
            let (x, y) = (f64::from(field_re[0]), f64::from(field_im[0]));
            re += f64::from(amplitude) * (x * cos - y * sin);
            im += f64::from(amplitude) * (x * sin + y * cos);
        }
        (re, im)
    };
    v.iter().map(field).collect()
}

/// |<a conj b>|^2 / <|a|^2> <|b|^2> over pairs of fields.
fn correlation(pairs: &[[(f64, f64); 2]]) -> f64 {
    let (mut re, mut im, mut first, mut second) = (0.0, 0.0, 0.0, 0.0);
    for [a, b] in pairs {
        re += a.0 * b.0 + a.1 * b.1;
        im += a.1 * b.0 - a.0 * b.1;
        first += a.0 * a.0 + a.1 * a.1;
        second += b.0 * b.0 + b.1 * b.1;
    }
    (re * re + im * im) / (first * second)
}

/// Van Cittert and Zernike: the correlation of the light at two directions is the squared Fourier transform
/// of the spot, for a gaussian one exp(-(pi D / 2 lambda * difference of the direction's sine)^2): along the
/// slit dv / R, with the table's travel that of sin(theta).
///
/// As the beam wanders by s over the surface, exp(-(s / w)^2 (1 + (k w^2 c / 2 R)^2)): its amplitudes overlap
/// less, and the speckle moves along with the surface, with c = cos^2(theta) in x and 1 in y.
#[test]
fn correlation_is_that_of_van_cittert_and_zernike() {
    const SURFACES: u64 = 800;
    let diameter = 1e-3;
    let laser = Laser::focused(diameter, 0.8);
    let view = View::at(0.8);
    let half_power = 2.0f64.ln().sqrt() * 2.0 * laser.wavelength / (PI * diameter);
    let along = half_power * view.range();
    // d sin(theta) / dd = -b d / R^3.
    let travel = half_power * view.range().powi(3) / (view.baseline * view.distance);
    let wander = |c: f64| {
        let w = 0.5 * diameter;
        let moves = PI * w * w * c / (laser.wavelength * view.range());
        w * (2.0f64.ln() / (1.0 + moves * moves)).sqrt()
    };
    let wander = [wander(view.cos_angle().powi(2)), wander(1.0)];
    let moved = [
        View::at(0.8 + travel),
        view.of_place([wander[0], 0.0]),
        view.of_place([0.0, wander[1]]),
    ];
    let mut pairs: [Vec<_>; 4] = Default::default();
    for seed in 0..SURFACES {
        let surface = small_surface(&laser, &Scattering::surface(), 5000 + seed);
        let fields = field_at(&surface, &view, &[0.0, along]);
        pairs[0].push([fields[0], fields[1]]);
        for (pairs, view) in pairs[1..].iter_mut().zip(&moved) {
            pairs.push([fields[0], field_at(&surface, view, &[0.0])[0]]);
        }
    }
    let [x, y] = wander;
    let ways = [
        ("along the slit", along),
        ("travel", travel),
        ("wandering in x", x),
        ("wandering in y", y),
    ];
    for ((name, length), pairs) in ways.iter().zip(&pairs) {
        let found = correlation(pairs);
        // A gaussian of the length: how much longer would the length be at which it is a half?
        let length_ratio = (2.0f64.ln() / -found.ln()).sqrt();
        println!(
            "{name}: correlation {found:.3} at {:.3} mm, length {length_ratio:.3} of theory",
            length * 1e3
        );
        // The correlation's standard error is 0.018.
        assert!((length_ratio - 1.0).abs() < 0.1);
    }
}

/// The whole frame's centroid (x, in metres) behind a lens, of many surfaces; root mean square.
fn centroids(laser: &Laser, frames: u64, reflectance: impl Fn(f64, f64) -> f64) -> f64 {
    let (view, lens) = (View::at(0.8), sharp_lens());
    let places = pixels(56, 1);
    let of_surface = |seed| {
        let surface = small_surface(laser, &Scattering::surface(), 9000 + seed);
        let surface = surface.with_reflectance(&reflectance);
        let image = lens_image(&surface, &view, &lens, 0.0, &places, &places).unwrap();
        centroid(&image, &places)
    };
    let centroids: Vec<f64> = (0..frames).map(of_surface).collect();
    // Symmetrical about 0 but for half a pixel: the middle of `pixels` is a place off the window's centre.
    rms(&centroids)
}

/// The speckle limit of Dorsch, Haeusler and Herrmann, Appl. Opt. 33, 1306 (1994): sigma = lambda / (2 pi sin
/// u), for a disc; a gaussian spot has 1/sqrt 2 of it. Both follow from var = S int x^2 I^2 / (int I)^2 with
/// the speckle's area S = (lambda z)^2 / (pi a^2), for spots much larger than a speckle. Seen under theta a
/// round spot is an ellipse, which makes sqrt(cos(theta)).
#[test]
fn centroids_scatter_by_the_speckle_limit() {
    let view = View::at(0.8);
    let (sin_u, cos) = (0.5 * 50e-3 / 12.0 / view.range(), view.cos_angle());
    let limit = 650e-9 / (2.0 * PI * sin_u) * sharp_lens().to_sensor() / view.range();
    let gaussian = centroids(&Laser::focused(1.2e-3, 0.8), 400, |_, _| 1.0);
    let (um, ratio) = (gaussian * 1e6, gaussian / (limit * (0.5 * cos).sqrt()));
    println!("gaussian spot: {um:.3} um, {ratio:.3} of theory");
    assert!((ratio - 1.0).abs() < 0.15);
    // A disc as it is seen: the beam's fall is taken back by the reflectance.
    let laser = Laser::focused(1.4e-3, 0.8);
    let (beam, radius) = (0.7e-3f64, 0.7e-3f64);
    let disc = |x: f64, y: f64| {
        if (x * cos).hypot(y) < radius {
            (2.0 * (x * x + y * y) / (beam * beam)).exp()
        } else {
            0.0
        }
    };
    let uniform = centroids(&laser, 400, disc);
    println!("disc: {:.3} um for {:.3} um", uniform * 1e6, limit * 1e6);
    assert!((uniform / limit - 1.0).abs() < 0.15);
}

/// A point in focus makes Airy's pattern (2 J1(q) / q)^2, q = pi D r / lambda z, whose density in its middle
/// is the pupil's area over (lambda z)^2; out of focus by W waves at the pupil's edge the middle falls to
/// (sin(pi W) / pi W)^2.
#[test]
fn a_point_through_a_lens_makes_the_pattern_of_airy() {
    let (laser, view, surface) = point();
    let (lens, places) = (sharp_lens(), pixels(24, 1));
    let image = lens_image(&surface, &view, &lens, 0.0, &places, &places).unwrap();
    let z = lens.to_sensor();
    let peak = f64::from(image.row(12)[12]);
    let mut worst = 0.0f64;
    for (row, y) in places.iter().enumerate() {
        for (x, &light) in places.iter().zip(image.row(row)) {
            let q = (PI * lens.diameter * x.hypot(*y) / (laser.wavelength * z)).max(1e-9);
            worst = worst.max((f64::from(light) / peak - (2.0 * libm::j1(q) / q).powi(2)).abs());
        }
    }
    let area = 0.25 * PI * lens.diameter.powi(2);
    let density = image.density * (laser.wavelength * z).powi(2) / area;
    println!(
        "Airy's pattern within {worst:.1e}, density in its middle {density:.4} of area / (lambda z)^2"
    );
    assert!(worst < 5e-3 && (density - 1.0).abs() < 5e-3);
    let waves = 0.7;
    let defocus = 2.0 * waves * laser.wavelength / (0.5 * lens.diameter).powi(2);
    let blurred = with(lens, |it| {
        it.focus_distance = 1.0 / (1.0 / view.range() - defocus)
    });
    let image = lens_image(&surface, &view, &blurred, 0.0, &[0.0], &[0.0]).unwrap();
    let found = image.density * (laser.wavelength * blurred.to_sensor()).powi(2) / area;
    let expected = ((PI * waves).sin() / (PI * waves)).powi(2);
    println!("{waves} waves of defocus: {found:.4} for {expected:.4}");
    assert!((found - expected).abs() < 5e-3);
}

/// The centroid of a point's image with coma lies where the mean ray goes: lambda z W131 / a from the chief
/// ray, by the mean of W's slope over the pupil.
#[test]
fn coma_moves_the_centroid() {
    let (laser, view, surface) = point();
    let places = pixels(96, 1);
    let lens = with(sharp_lens(), |it| it.coma = 2.0);
    let of_field = |field: f64| {
        let image = lens_image(&surface, &view, &lens, field, &places, &places).unwrap();
        centroid(&image, &places)
    };
    let expected = 1.0 * laser.wavelength * lens.to_sensor() / (0.5 * lens.diameter);
    let found = of_field(0.5 * lens.full_field) - of_field(0.0);
    let (um, ratio) = (found * 1e6, found / expected);
    println!("a wave of coma: {um:.2} um, {ratio:.3} of theory");
    assert!((ratio - 1.0).abs() < 0.1);
}

#[test]
fn the_same_seed_makes_the_same_image() {
    let laser = Laser {
        linewidth: 0.5e-9,
        wavelengths: 3,
        ..Laser::focused(0.5e-3, 0.8)
    };
    let scattering = Scattering {
        polarisations: 2,
        path_spread: 0.2e-3,
        ..Scattering::surface()
    };
    let places = pixels(16, 1);
    let images = |seed: u64, lateral: [f64; 2]| {
        let surface = small_surface(&laser, &scattering, seed);
        let view = View::at(0.7).of_place(lateral);
        let lens = LensAperture::nominal(0.8);
        (
            through_slit(&surface, &view, &places, &places),
            lens_image(&surface, &view, &lens, 0.0, &places, &places).unwrap(),
        )
    };
    assert_eq!(images(1, [0.0; 2]), images(1, [0.0; 2]));
    assert_ne!(images(1, [0.0; 2]), images(2, [0.0; 2]));
    assert_ne!(images(1, [0.0; 2]), images(1, [10e-6, 0.0]));
}

#[test]
fn a_surface_too_small_is_an_error() {
    let surface = small_surface(&Laser::focused(1e-3, 0.8), &Scattering::surface(), 1);
    // Half of the beam's diverged diameter is missing.
    let view = View::at(0.8 + 3.0);
    let error = slit_image(&surface, &view, &SlitAperture::nominal(), &[0.0], &[0.0]).unwrap_err();
    println!("{error}");
    assert!(error.to_string().contains("needs a surface"));
}

/// Rows between every fourth: by linear interpolation, against those computed. What it loses are the fringes
/// of the slit's ends, whose period in the middle is lambda z / 1.5 mm, 4 rows; the frame's centre, which
/// speckle scatters by a pixel, hardly notices.
#[test]
fn rows_between_are_close() {
    for diameter in [0.5e-3, 1e-3, 2e-3] {
        let surface = small_surface(&Laser::focused(diameter, 0.8), &Scattering::surface(), 3);
        let (columns, rows) = (pixels(160, 2), pixels(600, 1));
        let image = |rows: &[f64]| through_slit(&surface, &View::at(0.8), &columns, rows);
        let exact = image(&rows);
        let between = image(&every(&rows, 4)).with_rows_between(4, rows.len());
        let level = mean(exact.light.iter().map(|&x| f64::from(x)));
        let relative = difference(&exact, &between) / level;
        let centre = |image: &Image| frame_centre(image, &columns);
        let moved = (centre(&exact) - centre(&between)) / PIXEL;
        println!(
            "spot of {diameter} m: rows between {relative:.4} of the mean off, the centre {moved:.4} pixels"
        );
        assert!(relative < 0.1 && moved.abs() < 0.03);
    }
}

/// Mean over bright rows of where a gaussian's window of 11 pixels is balanced: a fit of given width.
fn frame_centre(image: &Image, columns: &[f64]) -> f64 {
    let width = 11.0 * PIXEL;
    let energy_of = |row: usize| image.row(row).iter().sum::<f32>();
    let brightest = (0..image.rows()).map(energy_of).fold(0.0, f32::max);
    let centres = (0..image.rows())
        .filter(|&row| energy_of(row) > 0.05 * brightest)
        .map(|row| {
            let light = image.row(row);
            let sums = |centre: f64| {
                let pairs = columns.iter().zip(light);
                pairs.fold((0.0, 0.0), |(score, slope), (x, &light)| {
                    let d = (x - centre) / width;
                    let gaussian = f64::from(light) * (-0.5 * d * d).exp();
                    (score + gaussian * d, slope + gaussian * (1.0 - d * d))
                })
            };
            let energy: f64 = light.iter().map(|&light| f64::from(light)).sum();
            let moments = columns.iter().zip(light).map(|(x, &l)| x * f64::from(l));
            let mut centre = moments.sum::<f64>() / energy;
            for _ in 0..12 {
                let (score, slope) = sums(centre);
                let step = match slope > 0.0 {
                    true => score / slope,
                    false => score.signum(),
                };
                centre += width * step.clamp(-0.4, 0.4);
            }
            centre
        });
    mean(centres)
}

/// The aperture's diffraction is that of the middle of the spectrum for all wavelengths: how far is an image
/// from one that was made all with its own wavelength? A line of 1 nm, whose farther wavelengths are 0.6 nm
/// away.
#[test]
fn diffraction_hardly_depends_on_the_wavelength() {
    let laser = with(Laser::focused(1e-3, 0.8), |it| {
        (it.linewidth, it.wavelengths) = (1e-9, 3)
    });
    let mut surface = small_surface(&laser, &Scattering::surface(), 3);
    let far = Laser {
        linewidth: 0.0,
        wavelength: 1.0 / laser.spectrum()[2].wavenumber,
        ..laser
    };
    let own = small_surface(&far, &Scattering::surface(), 3);
    surface.terms.drain(..2);
    surface.terms[0].weight = 1.0;
    let (columns, rows) = (pixels(160, 2), pixels(600, 8));
    let [image, own] =
        [surface, own].map(|surface| through_slit(&surface, &View::at(0.8), &columns, &rows));
    let relative = difference(&image, &own) / rms(own.light.iter().map(|&b| f64::from(b)));
    let nm = (far.wavelength - laser.wavelength) * 1e9;
    println!("{nm:.2} nm away: {relative:.4} of the light differs");
    assert!(relative < 0.02);
}
