//! The map of the pixels: what it leaves of the pixels' differences, and what no map may do to a row.

use crate::comb::quiet;
use crate::records::cases;
use crate::support::*;
use crc::{CRC_32_ISO_HDLC, Crc};
use simulator::scene::Ambient;
use slitrange::light::ambient::AmbientMode;
use slitrange::row::pixels::flat_field::{FlatField, Kind, ROWS};
use slitrange::row::pixels::map::{Correction, Entry, MAX_MAP_PIXELS, PixelMap};
use slitrange_device::store::encoded_map::{Read, Reader, Word, Words};

/// Counts of light in the lit rows.
const LIGHT: f64 = 2000.0;

/// A sensor whose pixels differ, before white paper.
fn paper(seed: u64, response: f64, counts: f64) -> Scene {
    let pixels = format!("response.deviation = {response}\nfixed_pattern.counts = {counts}");
    with(listing(Scene::white_paper(), &pixels), |it| it.seed = seed)
}

fn dark(scene: Scene) -> Simulation {
    Simulation::new(with(scene, |it| it.spot = None))
}

/// The same sensor without the laser, in the dark or in light that falls by a fifth along the sensor.
fn without_laser(paper: &Scene, light: f64) -> Simulation {
    let counts_per_second = light / paper.exposure;
    let slope = -0.2 * counts_per_second / 3648.0;
    let ambient = Ambient {
        counts_per_second,
        slope,
    };
    dark(with(paper.clone(), |it| it.ambient = Some(ambient)))
}

fn words_of(simulation: &Simulation, row: u64) -> Vec<u16> {
    let scene = simulation.scene();
    let light = simulation.row(row, scene.distance, scene.exposure);
    words(&light, &scene.geometry())
}

fn take(
    field: &mut FlatField,
    kind: Kind,
    geometry: &Geometry,
    row: impl Fn(u64) -> Vec<u16>,
) -> Result<Taken, TakeError> {
    field.begin(kind, geometry)?;
    let taken = (0..u64::from(ROWS)).find_map(|number| field.add(&mut row(number), geometry));
    taken.expect("the last row ends it")
}

fn map_of(paper: &Scene) -> Box<FlatField> {
    let mut field = Box::new(FlatField::new());
    // Other rows than those of the frames.
    for (kind, light, first) in [(Kind::Dark, 0.0, 10_000), (Kind::Lit, LIGHT, 20_000)] {
        let scene = without_laser(paper, light);
        let geometry = paper.geometry();
        let row = |row| words_of(&scene, first + row);
        let taken = take(&mut field, kind, &geometry, row);
        let taken = taken.unwrap_or_else(|error| panic!("{kind:?}: {error}"));
        let expected = paper.black_level.map_or(0.0, |_| 300.0) + light;
        assert!((taken.mean.to_f64() - expected).abs() < 10.0, "{taken:?}");
    }
    field
}

/// The error of a frame's centre in pixels, its claimed uncertainty, and the share of the pixels that differ.
type Frame = [f64; 3];

fn frame_of(measured: &Measured, truth: f64) -> Frame {
    let (frame, by) = (measured.frame, measured.estimator);
    let pixels = (measured.pixels).of_centre(by, frame.width, frame.amplitude, measured.ambient);
    let error = frame.centre.to_f64() - truth;
    [error, frame.uncertainty.to_f64(), pixels.into()]
}

fn frame(paper: &Scene, centre: f64, rows: u16, map: Option<&PixelMap>) -> Frame {
    let simulation = Simulation::new(paper.clone());
    let options = options(|it| it.rows = rows);
    let distance = paper.optics.distance(centre);
    let measured = frames::measure(&simulation, options, distance, 0, map).expect("a centre");
    frame_of(&measured, simulation.true_centre(0, distance))
}

/// The pixels of places 400 pixels apart are independent, so eight places on a sensor count as eight sensors.
#[test]
fn a_map_leaves_the_error_that_it_states() {
    const SENSORS: u64 = 26;
    println!("response offset rows | error without, mpx | error, mpx | r | pixels | error / claim");
    for (response, counts) in [(0.005, 2.0), (0.01, 5.0), (0.02, 2.0), (0.02, 5.0)] {
        let frames = (0..SENSORS).into_par_iter().flat_map_iter(|sensor| {
            let paper = paper(1 + sensor, response, counts);
            let field = map_of(&paper);
            let of_place = |place| {
                let centre = 420.0 + 400.0 * f64::from(place) + 0.123 * sensor as f64;
                let maps = [None, Some(field.map().expect("a map"))];
                [1, 16, 64].map(|rows| maps.map(|map| frame(&paper, centre, rows, map)))
            };
            (0..8).map(of_place).collect::<Vec<_>>()
        });
        let frames: Vec<[[Frame; 2]; 3]> = frames.collect();
        assert!(frames.len() >= 200);
        for (index, rows) in [1, 16, 64].into_iter().enumerate() {
            let [without, with] = [0, 1]
                .map(|map| [0, 1, 2].map(|part| rms(frames.iter().map(|it| it[index][map][part]))));
            let [before, error, noise, pixels] =
                [without[0], with[0], with[1], with[2]].map(|it| 1e3 * it);
            let ratio = error / noise.hypot(pixels);
            let percent = 100.0 * response;
            print!("{percent:4.1} % {counts} {rows:4} | {before:6.2} | ");
            println!("{error:6.2} | {noise:6.2} | {pixels:6.2} | {ratio:.3}");
            // 320 values: 4 %.
            assert!((0.9..1.1).contains(&ratio), "{ratio}");
            // Without a map, the claim is what the data sheet allows.
            let allowed = without[0] / without[1].hypot(without[2]);
            println!("    without a map {allowed:.3} of the claim");
            assert!(allowed < 1.1);
        }
    }
}

/// The frame of a sensor beside a window, with `ambient subtract`.
fn subtracted_frame(paper: &Scene, centre: f64, map: Option<&PixelMap>) -> Frame {
    let window = "ambient = { counts_per_second = 100e3, slope = 11.0 }";
    let distance = paper.optics.distance(centre);
    let scene = with(listing(paper.clone(), window), |it| it.distance = distance);
    let options = options(|it| it.ambient = AmbientMode::Subtract);
    let mut measurement = Measurement::new(paper.geometry(), options);
    let (dark, lit) = (dark(scene.clone()), Simulation::new(scene));
    let mut row = 0;
    let mut next = |simulation: &Simulation| {
        row += 1;
        words_of(simulation, row)
    };
    for _ in 0..128 {
        measurement.ambient_row(&next(&dark));
    }
    let measured = loop {
        measurement.ambient_row(&next(&dark));
        if let Some(result) = measurement.row_with(&mut next(&lit), None, map) {
            break result.expect("a centre");
        }
    };
    frame_of(&measured, lit.true_centre(0, lit.scene().distance))
}

/// Subtracting removes the offsets of the pixels, and the map corrects their gains. A map that corrected the
/// offsets too would write them into the row again.
#[test]
fn a_map_corrects_only_the_gains_of_subtracted_rows() {
    let frames = (0..4u64).into_par_iter().flat_map(|seed| {
        let paper = paper(seed, 0.02, 15.0);
        let field = map_of(&paper);
        let map = field.map();
        let of = |place| {
            let centre = 424.3 + 400.0 * f64::from(place);
            [None, map].map(|map| subtracted_frame(&paper, centre, map))
        };
        (0..8).map(of).collect::<Vec<_>>()
    });
    let frames: Vec<[Frame; 2]> = frames.collect();
    let [bare, corrected] = [0, 1].map(|i| rms(frames.iter().map(|frame| frame[i][0])));
    let of_claim = |[_, [error, noise, pixels]]: &[Frame; 2]| error / noise.hypot(*pixels);
    let claims = rms(frames.iter().map(of_claim));
    println!("without a map {bare:.5} px, with it {corrected:.5} px, {claims:.2} of the claim");
    assert!(corrected < 0.4 * bare);
    // The RMS of 32 errors is known to 13 %.
    assert!((0.5..1.5).contains(&claims));
}

#[test]
fn rows_that_make_no_map_are_refused_with_a_reason() {
    let paper = paper(1, 0.01, 5.0);
    let geometry = paper.geometry();
    let dark = without_laser(&paper, 0.0);
    let mut field = Box::new(FlatField::new());
    assert_eq!(field.begin(Kind::Lit, &geometry), Err(TakeError::NoDark));
    let mut of = |kind, scene: &Simulation| {
        let row = |number| words_of(scene, number);
        take(&mut field, kind, &geometry, row)
    };
    // The laser's spot in the dark.
    let error = of(Kind::Dark, &Simulation::new(paper.clone()));
    let Err(TakeError::SpotInTheDark { pixel, .. }) = error else {
        panic!("{error:?}");
    };
    assert!(pixel.abs_diff(1771) < 40);
    let error = of(Kind::Dark, &without_laser(&paper, 400.0));
    assert!(matches!(error, Err(TakeError::NotDark { .. })));
    of(Kind::Dark, &dark).expect("dark rows");
    let light = [-20.0, 300.0, 5000.0].map(|light| without_laser(&paper, light));
    let mut refused: Vec<_> = light.iter().map(|scene| of(Kind::Lit, scene)).collect();
    // A weak spot on even light.
    let a_second = LIGHT / paper.exposure;
    let even = format!("ambient = {{ counts_per_second = {a_second}, slope = 0.0 }}");
    let height = paper.spot.expect("a spot").counts_per_second;
    let weak = listing(paper.clone(), &even).with_height(height / 8.0);
    refused.push(of(Kind::Lit, &Simulation::new(weak)));
    // Light on a part of the sensor.
    let lit = without_laser(&paper, LIGHT);
    refused.push(take(&mut field, Kind::Lit, &geometry, |number| {
        let mut words = words_of(&lit, number);
        words[..1500].copy_from_slice(&words_of(&dark, number)[..1500]);
        words
    }));
    assert_eq!(field.map(), None);
    for error in &refused {
        println!("{}", error.as_ref().expect_err("no map"));
    }
    assert!(matches!(
        refused[..],
        [
            Err(TakeError::DarkIsBrighter { .. }),
            Err(TakeError::TooDim { .. }),
            Err(TakeError::Saturated { .. }),
            Err(TakeError::Uneven { .. }),
            Err(TakeError::TooDimAt { .. }),
        ]
    ));
    // The dark rows are still there.
    let lit = |number| words_of(&lit, number);
    take(&mut field, Kind::Lit, &geometry, lit).expect("a map");
    assert!(field.map().is_some());
}

/// A dead pixel, a bright one and a hot one are counted, and do not spoil their neighbours.
#[test]
fn pixels_that_differ_too_much_are_counted() {
    let paper = paper(3, 0.005, 2.0);
    let geometry = paper.geometry();
    let mut field = Box::new(FlatField::new());
    let first = geometry.light.start;
    for (kind, light) in [(Kind::Dark, 0.0), (Kind::Lit, LIGHT)] {
        let scene = without_laser(&paper, light);
        take(&mut field, kind, &geometry, |row| {
            let mut counts = scene.row(row, paper.distance, paper.exposure);
            counts[first + 1000] = 300.0;
            counts[first + 2000] = 300.0 + light as f32 * 1.8;
            counts[first + 3000] += 1500.0;
            words(&counts, &geometry)
        })
        .expect("rows");
    }
    let map = field.map().expect("a map");
    // 1800 of 2000: the light falls by a fifth along the sensor.
    assert_eq!(map.summary().outside, 2);
    for (at, entry) in map.entries().iter().enumerate() {
        let is_bad = [1000, 2000, 3000].contains(&at);
        assert!(is_bad || entry.gain_q15().abs() < 1000, "{at} {entry:?}");
    }
    assert_eq!(map.entries()[1000].gain_q15(), 1 << 14);
    assert_eq!(map.entries()[3000].offset_q4(), 1 << 14);
}

/// A map with these entries, as flash holds it.
fn map_with(entries: &[Entry]) -> Box<PixelMap> {
    let word =
        |low: u16, high: u16| -> Word { (u32::from(low) | u32::from(high) << 16).to_le_bytes() };
    let numbers = [entries.len() as u16, 30, 20, 1000].map(|it| word(it, 0));
    let mut words = vec![[b'F', b'L', 1, !1], [1, 0, 0, 0]];
    words.extend(numbers);
    let of_entry = |it: &Entry| word(it.offset_q4() as u16, it.gain_q15() as u16);
    words.extend(entries.iter().map(of_entry));
    // As of zlib.
    let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&words.concat());
    words.push(crc.to_le_bytes());
    let mut map = Box::new(PixelMap::EMPTY);
    let mut reader = Reader::default();
    let read = words.iter().map(|&word| reader.take(word, Some(&mut map)));
    assert_eq!(read.last(), Some(Read::Whole(1)));
    assert!(Words::new(&map, 1).eq(words));
    map
}

/// Measures a row of quiet paper, and the same row with pixels that make 0.8 of their light, without a map
/// and with the map of these pixels, whose centre is that of the even row.
fn with_darker_pixels(
    scene: Scene,
    options: Options,
    region: Region,
    is_darker: impl Fn(f64, f64) -> bool,
) {
    let scene = scene.without(Effect::ShotNoise).without(Effect::ReadNoise);
    let geometry = scene.geometry();
    let light = scene.row(0, 0.8, scene.exposure);
    let black = scene.black_level.expect("a level").counts;
    let read = |row: &[f32], options, map: Option<&PixelMap>| {
        let options = Options { rows: 1, ..options };
        let mut measurement = Measurement::new(geometry.clone(), options);
        let measured = measurement.row_with(&mut words(row, &geometry), None, map);
        let measured = measured.expect("a frame of one row").expect("a centre");
        measured.frame.centre.to_f64()
    };
    let even = read(&light, options, None);
    let gain = |pixel: usize| match is_darker(pixel as f64, even) {
        true => 0.8,
        false => 1.0,
    };
    let mut uneven = light.clone();
    for (count, pixel) in uneven[geometry.light.clone()].iter_mut().zip(0..) {
        *count = (black + (f64::from(*count) - black) * gain(pixel)) as f32;
    }
    let entry = |pixel| Entry::new(0, ((1.0 / gain(pixel) - 1.0) * 32768.0) as i16);
    let entries = (0..MAX_MAP_PIXELS).map(|it| entry(it).expect("small"));
    let entries: Vec<Entry> = entries.collect();
    let map = map_with(&entries);
    let options = Options { region, ..options };
    let [bare, corrected] = [None, Some(&*map)].map(|map| read(&uneven, options, map) - even);
    println!("without a map off by {bare:.4} px, with it by {corrected:.4} px");
    // Rounding to counts remains.
    assert!(bare.abs() > 0.1 && corrected.abs() < 0.005);
}

/// The windows around the images of a comb overlap. Pixels between two images have another gain than those
/// around them: if the map corrected them twice, they would tilt the images.
#[test]
fn a_map_corrects_each_pixel_of_a_comb_once() {
    let scene = quiet();
    let centres = scene.openings();
    let centres: Vec<f64> = centres.iter().map(|slit| slit.centre(0.8)).collect();
    let options = options(|it| it.slits = Slits::Comb);
    // Beyond 10 pixels on each image's right side.
    let beside = |off: f64| (10.0..60.0).contains(&off);
    let is_darker = |pixel, _| centres.iter().any(|it| beside(pixel - it));
    with_darker_pixels(scene, options, Region::ALL, is_darker);
}

/// The pixels to the right of the spot's centre are darker. A map that corrected other pixels than those of
/// the region would leave that error.
#[test]
fn a_map_corrects_the_pixels_of_a_region() {
    let region = Region::new(1433, 2100).expect("a region");
    let is_darker = |pixel, centre| pixel > centre;
    with_darker_pixels(scene("quiet-paper"), Options::default(), region, is_darker);
}

fn entries() -> impl Strategy<Value = Vec<Entry>> {
    let edges = |most: i16| prop_oneof![Just(most), Just(-most), -most..=most];
    let entry = (edges(1 << 14), edges(1 << 14));
    prop::collection::vec(entry, 1..200).prop_map(|some| {
        let entry = |&(offset, gain): &(i16, i16)| Entry::new(offset, gain).expect("in range");
        let all = some.iter().map(entry).cycle();
        all.take(MAX_MAP_PIXELS).collect()
    })
}

proptest! {
    #![proptest_config(cases(64))]

    #[test]
    fn no_map_makes_or_hides_saturation(
        entries in entries(),
        row in prop::collection::vec(0u16..=4095, 3648),
        black in any::<i32>(),
        bits in prop_oneof![Just(12u8), 0u8..=16],
        begin in 0usize..4000,
        length in 0usize..4000,
        saturation in prop_oneof![Just(4095), any::<u16>()],
    ) {
        let map = map_with(&entries);
        let geometry = with(tcd1304dg(), |it| {
            (it.polarity, it.bits, it.saturation) = (Polarity::Rising, bits, saturation);
        });
        let mut corrected = row.clone();
        let black = Counts::from_bits(black);
        map.correct(&mut corrected, begin..begin + length, black, &geometry, Correction::OffsetAndGain);
        let saturation = geometry.saturated_from();
        for (at, (before, after)) in row.iter().zip(&corrected).enumerate() {
            prop_assert_eq!(*before >= saturation, *after >= saturation);
            if *before >= saturation || !(begin..begin + length).contains(&at) {
                prop_assert_eq!(before, after);
            }
        }
    }

    #[test]
    fn any_map_and_any_row_measure(
        entries in entries(),
        row in prop::collection::vec(0u16..=4095, 3694),
        height in 0u16..4000,
        rows in 1u16..4,
    ) {
        let map = map_with(&entries);
        let options = Options { rows, ..Options::default() };
        let mut measurement = Measurement::new(tcd1304dg(), options);
        for _ in 0..4 {
            let mut words = row.clone();
            for (at, word) in words.iter_mut().enumerate() {
                let u = (at as f64 - 1800.0) / 9.0;
                let spot = f64::from(height) * (-0.5 * u * u).exp();
                *word = 3800u16.saturating_sub(spot as u16).saturating_sub(*word % 16);
            }
            measurement.row_with(&mut words, None, Some(&map));
            measurement.row_with(&mut row.clone(), None, Some(&map));
        }
    }
}
