//! The cases: each a name, why it is hard, and what must come out.

use crate::hard_cases::flaw::{Bad, Flaw, Second};
use crate::hard_cases::recipe::{Place, Recipe};
use crate::hard_cases::{Due, RowCase, Shape, Source, patterns};
use simulator::bound;

/// The spot for which accuracy is quoted: that of the nominal slit on the paper's sensor.
const WIDTH: f64 = 10.5;
/// A full well below the converter's largest word, in counts of a row.
const WELL: u16 = 2500;
/// A spot that a few pixels make.
const NARROW: f64 = 1.5;

/// The cases whose rows are looked at one by one.
pub fn rows() -> Vec<RowCase> {
    [
        no_spot(),
        height(),
        saturation(),
        width(),
        edge(),
        background(),
        bad_pixels(),
        second_spot(),
        shapes(),
        interference(),
        converter(),
        short_rows(),
    ]
    .concat()
}

type Words = &'static str;

struct Cases {
    group: Words,
    all: Vec<RowCase>,
}

impl Cases {
    fn of(group: Words) -> Self {
        Self { group, all: vec![] }
    }

    fn add<N, S>(&mut self, name: N, why: Words, due: Due, source: S) -> &mut RowCase
    where
        N: Into<String>,
        S: Into<Source>,
    {
        self.all.push(RowCase {
            name: name.into(),
            group: self.group,
            why,
            due,
            repair_within: None,
            source: source.into(),
        });
        self.all.last_mut().expect("a case was pushed")
    }

    fn honest(&mut self, name: impl Into<String>, why: Words, recipe: Recipe) -> &mut RowCase {
        self.add(name, why, Due::Honest, recipe)
    }

    /// A case whose flaw ought to change nothing.
    fn clean(&mut self, name: impl Into<String>, why: Words, recipe: Recipe) -> &mut RowCase {
        self.add(name, why, as_the_bound(&recipe), recipe)
    }
}

/// Five times the bound of the clean spot, and what a profile or a rounding may add.
fn as_the_bound(recipe: &Recipe) -> Due {
    Due::Centre(5.0 * clean_spot(recipe).bound() + 0.05)
}

/// The same for the bound of a spot of which only what is on the row is seen, with its centre so many widths
/// from the row's end. A fit in whose pixels the tail is missing leaves 1.4 times that.
fn as_the_cut_bound(recipe: &Recipe, widths: f64) -> Due {
    let spot = clean_spot(recipe);
    // Phases differ: that of the least of the spot.
    Due::Centre(5.0 * 1.4 * spot.bound_cut(widths * spot.width - 0.5) + 0.05)
}

fn high(width: f64, amplitude: f64) -> Recipe {
    Recipe::clean(width).spot(|spot| spot.amplitude = amplitude)
}

fn with(flaw: Flaw) -> Recipe {
    Recipe::clean(WIDTH).with(flaw)
}

fn on(pixels: usize, width: f64) -> Recipe {
    Recipe {
        pixels,
        ..Recipe::clean(width)
    }
}

/// A second spot of a share of the height, so many widths off.
fn second(share: f64, offset: f64) -> Flaw {
    Flaw::Second(Second::new(share, offset, 1.0))
}

/// A step of 50 counts, so many widths off.
fn step(offset: f64) -> Flaw {
    Flaw::Step(50.0, offset)
}

fn clean_spot(recipe: &Recipe) -> bound::Spot {
    let spot = recipe.spot.expect("a spot");
    bound::Spot {
        width: spot.width,
        amplitude: spot.amplitude,
        noise: recipe.read_noise,
        electrons_per_count: recipe.electrons_per_count,
    }
}

fn no_spot() -> Vec<RowCase> {
    const SILENT: Due = Due::Fault(&["sensor silent"]);
    const NONE: Due = Due::NoCentre;
    type Rows = fn(u64) -> Vec<u16>;
    #[rustfmt::skip] // A case a line.
    let patterns: [(&str, &str, Due, Rows); 15] = [
        ("all black", "a dead amplifier: no pixel differs", SILENT, patterns::constant::<0>),
        ("all at full scale", "flooded, or the wire is open", SILENT, patterns::constant::<4095>),
        ("all at 1000", "a held converter", SILENT, patterns::constant::<1000>),
        ("one pixel at full scale", "no noise to compare it with", NONE, patterns::lit::<1>),
        ("two pixels at full scale", "no noise to compare them with", NONE, patterns::lit::<2>),
        ("one pixel at 2000", "no noise to compare it with, and not saturated", NONE,
            patterns::half_lit::<1>),
        ("two pixels at 2000", "narrower than optics can make", NONE, patterns::half_lit::<2>),
        ("three pixels at 2000", "a box: a spot would have flanks", NONE, patterns::half_lit::<3>),
        ("40 pixels at 2000", "a box as wide as a spot", NONE, patterns::half_lit::<40>),
        ("alternating pixels", "every sum of two is the same", NONE, patterns::alternating::<1>),
        ("alternating pairs", "every sum of four is the same", NONE, patterns::alternating::<2>),
        ("alternating runs of 30", "nine boxes, all alike", NONE,
            patterns::alternating::<30>),
        ("a ramp to full scale", "the highest pixel is the last", NONE, patterns::ramp),
        ("half black, half full", "the highest block is at the edge", NONE, patterns::halves),
        ("any words", "noise over the whole range of the converter", NONE, patterns::any_words),
    ];
    let mut cases = Cases::of("No spot");
    for (name, why, due, rows) in patterns {
        cases.add(name, why, due, Source::Pattern(rows));
    }
    let noisy = |read_noise| Recipe {
        read_noise,
        ..Recipe::dark()
    };
    let none = Due::Fault(&["no spot", "too dim"]);
    let why = "the highest of many noisy places looks like a spot";
    cases.add("noise alone", why, none, Recipe::dark());
    let why = "the highest of many places with 60 counts of noise looks like a spot";
    cases.add("strong noise alone", why, none, noisy(60.0));
    let why = "the converter's steps hide the noise";
    let silent_or_none = Due::Fault(&["sensor silent", "no spot", "too dim"]);
    cases.add("no noise", why, silent_or_none, noisy(0.05));
    let hot = |pixels| {
        Flaw::Hot(Bad {
            counts: 1000.0,
            pixels,
            from_spot: (0.0, 15.0),
        })
    };
    let ripple = Flaw::Ripple(50.0, 60.0);
    #[rustfmt::skip] // A case a line.
    let flaws = [
        ("a hot pixel alone", "it stands out of the noise more than any spot", hot(1)),
        ("two hot pixels alone", "two, side by side, look like a narrow spot", hot(2)),
        ("three hot pixels alone", "three, side by side, look like a narrow spot", hot(3)),
        ("a slope alone, 2 counts a pixel", "the far end is high", Flaw::Slope(2.0)),
        ("a lamp at one end alone", "light that falls off along the row", Flaw::Glow(1500.0)),
        ("a step of 50 counts alone", "the two halves of the row have different levels", step(0.0)),
        ("a ripple alone", "every wave looks like a spot", ripple),
    ];
    for (name, why, flaw) in flaws {
        cases.add(name, why, NONE, Recipe::dark().with(flaw));
    }
    cases.all
}

fn height() -> Vec<RowCase> {
    let mut cases = Cases::of("Dim and bright");
    for amplitude in [1.0, 2.0, 5.0, 10.0, 20.0] {
        let why = "the spot is not clear of the noise";
        cases.honest(format!("{amplitude} counts"), why, high(WIDTH, amplitude));
    }
    for amplitude in [50.0, 200.0, 1000.0, 3000.0, 3700.0] {
        let why = "more light gives a better centre";
        cases.clean(format!("{amplitude} counts"), why, high(WIDTH, amplitude));
    }
    for amplitude in [10.0, 20.0, 100.0, 1000.0, 3700.0] {
        let name = format!("{amplitude} counts, sigma {NARROW}");
        let (why, recipe) = ("the spot has few pixels", high(NARROW, amplitude));
        if amplitude < 100.0 {
            cases.honest(name, why, recipe);
        } else {
            cases.clean(name, why, recipe);
        }
    }
    cases.all
}

fn saturation() -> Vec<RowCase> {
    let mut cases = Cases::of("Saturated");
    for (width, within) in [(WIDTH, 0.08), (NARROW, 0.15)] {
        for times in [1.05, 1.5, 4.0] {
            let name = format!("{times} times full scale, sigma {width}");
            let why = "the top is cut off: only the flanks show the centre";
            let case = cases.honest(name, why, high(width, times * 4095.0));
            case.repair_within = Some(within);
        }
    }
    for (width, within) in [(WIDTH, 0.08), (NARROW, 0.15)] {
        for times in [1.05, 1.5, 4.0] {
            for is_known in [true, false] {
                let knowledge = if is_known { "known" } else { "unknown" };
                let recipe = Recipe::clean(width).with_well(WELL, is_known);
                let height = times * (f64::from(WELL) - recipe.black_level);
                let name = format!("{times} times a full well, {knowledge}, sigma {width}");
                let why = "the top is cut off below the converter's largest word";
                let case = cases.honest(name, why, recipe.spot(|spot| spot.amplitude = height));
                case.repair_within = Some(within);
            }
        }
    }
    for top in [2.0f64, 5.0, 10.0, 30.0, 60.0] {
        // A gaussian exp((top / 2)^2 / (2 sigma^2)) times as high is at full scale over `top` pixels.
        let width = (top / 3.0).max(1.0);
        let times = (0.5 * (0.5 * top / width).powi(2)).exp();
        let why = "the top is flat: no pixel is the highest";
        let name = format!("a flat top of {top} pixels");
        cases.honest(name, why, high(width, times * 3795.0));
    }
    for blooming in [0.3, 1.0] {
        let name = format!("blooms {} % to both sides", 100.0 * blooming);
        let recipe = high(WIDTH, 6000.0).with(Flaw::FullWell(3600.0, blooming));
        cases.honest(name, "charge flows over into the flanks", recipe);
    }
    for share in [0.1, 0.5, 0.9] {
        let name = format!("blooms {} % to one side", 100.0 * share);
        let why = "the flank on that side is not the spot's own";
        cases.honest(name, why, high(WIDTH, 6000.0).with(Flaw::Smear(share)));
    }
    cases.honest(
        "a full well below full scale",
        "the flat top does not reach the converter's limit",
        high(WIDTH, 3000.0).with(Flaw::FullWell(2400.0, 0.0)),
    );
    cases.all
}

fn width() -> Vec<RowCase> {
    let pixels = |width: f64| match width {
        width if width < 12.0 => 512,
        width if width < 40.0 => 1024,
        _ => 2048,
    };
    let mut cases = Cases::of("Narrow and wide");
    for width in [0.3, 0.4, 0.5, 0.6, 0.8, 1.0] {
        let why = "one to three pixels have nearly all the light: they could be bad pixels";
        cases.honest(format!("sigma {width}"), why, Recipe::clean(width));
    }
    for width in [1.25, 1.5, 2.0, 3.0, 5.0, 8.0, 10.5, 15.0, 20.0, 30.0, 50.0] {
        let why = "each width has tables of its own";
        cases.clean(format!("sigma {width}"), why, on(pixels(width), width));
    }
    for width in [80.0, 120.0, 200.0] {
        let why = "the spot leaves little of the row for the background";
        cases.honest(format!("sigma {width}"), why, on(pixels(width), width));
    }
    // Half way between two of the widths that tables are made for.
    let fine = phase_tables::FINE;
    for (name, step) in [("narrow", 4.5), ("middle", 16.5), ("wide", 28.5)] {
        let width = fine.narrowest * fine.ratio.powf(step);
        let why = "no table fits exactly";
        let name = format!("between two tables, {name}");
        let case = cases.clean(name, why, Recipe::clean(width));
        // Narrow ones are flagged: they could be bad pixels.
        if width < 1.25 {
            case.due = Due::Honest;
        }
    }
    cases.all
}

fn edge() -> Vec<RowCase> {
    let mut cases = Cases::of("At the sensor's edge");
    for width in [WIDTH, NARROW, 4.0] {
        for widths in [3.0, 2.0, 1.0, 0.0, -1.0] {
            for (end, place) in [
                ("first", Place::FromStart(widths)),
                ("last", Place::FromEnd(widths)),
            ] {
                let recipe = Recipe::clean(width).spot(|spot| spot.place = place);
                let (why, due) = match widths {
                    3.0 => ("the window reaches over the edge", as_the_bound(&recipe)),
                    -1.0 => (
                        "the top is off the sensor: only one flank is left",
                        Due::Honest,
                    ),
                    _ => (
                        "a part of the spot is cut off",
                        as_the_cut_bound(&recipe, widths),
                    ),
                };
                let name = format!("{widths} sigma from the {end} pixel, sigma {width}");
                cases.add(name, why, due, recipe);
            }
        }
    }
    cases.all
}

/// A spot on a background that rises by so many counts a pixel.
fn sloped(width: f64, slope: f64) -> Recipe {
    high(width, 1200.0).on_level(60.0).with(Flaw::Slope(slope))
}

fn background() -> Vec<RowCase> {
    let mut cases = Cases::of("Background");
    for slope in [0.1, 0.3, 1.0, 2.0, -2.0, 5.0] {
        let name = format!("slope of {slope} counts a pixel");
        let why = "one flank stands higher than the other";
        let case = cases.honest(name, why, sloped(WIDTH, slope));
        // The slope's own light makes noise of up to three times the spot's: five times that bound.
        if slope.abs() <= 2.0 {
            case.repair_within = Some(0.3);
        }
    }
    for slope in [2.0, 5.0] {
        let name = format!("slope of {slope} counts a pixel, sigma {NARROW}");
        let why = "one flank of a narrow spot stands higher than the other";
        cases.honest(name, why, sloped(NARROW, slope));
    }
    for offset in [-12.0, -5.0, -2.0, 0.0, 2.0, 5.0] {
        let name = format!("step of 50 counts {offset} sigma from the spot");
        let why = "the black level is wrong by 50 counts on one side";
        cases.honest(name, why, with(step(offset)));
    }
    for counts in [50.0, 300.0, -200.0] {
        let name = format!("black level bends by {counts} counts");
        let why = "it drifts while the row is read";
        cases.honest(name, why, with(Flaw::Sag(counts)));
    }
    for black_level in [0.0, 1000.0] {
        let name = format!("black level of {black_level} counts");
        let why = "half of the noise is cut off at zero, or daylight adds to it";
        cases.clean(name, why, Recipe::clean(WIDTH).on_level(black_level));
    }
    let why = "most of the counts are black level, not spot";
    let recipe = high(WIDTH, 200.0).on_level(3700.0);
    cases.clean("black level above the signal", why, recipe);
    let why = "the spot's top and half of the noise are cut off";
    let recipe = high(WIDTH, 200.0).on_level(4090.0);
    cases.add("black level at full scale", why, Due::NoCentre, recipe);
    let why = "the spot's flanks are cut off at zero";
    let below = Recipe::clean(WIDTH).on_level(-300.0);
    cases.honest("black level below zero", why, below);
    for counts in [300.0, 1500.0] {
        let name = format!("a lamp of {counts} counts at one end");
        let why = "a background that is bent and sloped under the spot";
        cases.honest(name, why, with(Flaw::Glow(counts)));
    }
    for (share, widths, offset) in [
        (0.05, 6.0, 0.0),
        (0.05, 6.0, 3.0),
        (0.05, 15.0, 5.0),
        (0.2, 8.0, 4.0),
    ] {
        let percent = 100.0 * share;
        let name = format!("flare of {percent} %, {widths} times as wide, {offset} sigma off");
        let why = "a wide ghost under the spot tilts the background";
        cases.honest(
            name,
            why,
            with(Flaw::Ghost(Second::new(share, offset, widths))),
        );
    }
    cases.all
}

fn bad_pixels() -> Vec<RowCase> {
    /// Where bad pixels are, in widths from the spot.
    const PLACES: [(&str, (f64, f64)); 3] = [
        ("in the spot", (0.0, 2.0)),
        ("beside the spot", (3.0, 5.0)),
        ("away from the spot", (8.0, 16.0)),
    ];
    let mut cases = Cases::of("Bad pixels");
    for width in [WIDTH, NARROW] {
        for (place, from_spot) in PLACES {
            let bad = |counts, pixels| Bad {
                counts,
                pixels,
                from_spot,
            };
            #[rustfmt::skip] // A case a line.
            let flaws = [
                ("a hot pixel (+200)", "it is too weak to stand out", Flaw::Hot(bad(200.0, 1))),
                ("a hot pixel (+1000)", "it outweighs the flank that it is on", Flaw::Hot(bad(1000.0, 1))),
                ("a dead pixel", "it is a hole in the spot", Flaw::Dead(bad(300.0, 1))),
                ("a pixel stuck at full scale", "no pixel of the row is higher", Flaw::Stuck(bad(4095.0, 1))),
                ("a pixel stuck at zero", "it is below any background", Flaw::Stuck(bad(0.0, 1))),
                ("three hot pixels (+1000)", "side by side they look like a spot", Flaw::Hot(bad(1000.0, 3))),
            ];
            for (name, why, flaw) in flaws {
                let name = format!("{name} {place}, sigma {width}");
                let case = cases.honest(name, why, Recipe::clean(width).with(flaw));
                case.repair_within = match flaw {
                    // Five times the root mean square error of many such rows.
                    Flaw::Hot(Bad { pixels: 1, .. }) | Flaw::Dead(_) if width == WIDTH => {
                        Some(5.0 * 0.03)
                    }
                    _ => None,
                };
            }
        }
    }
    for share in [0.01, 0.05] {
        let name = format!("pixels differ by {} % in response", 100.0 * share);
        let why = "the brighter the light, the larger the pixels' errors";
        cases.honest(name, why, with(Flaw::Response(share)));
    }
    for counts in [5.0, 30.0] {
        let name = format!("unlit pixels differ by {counts} counts");
        let why = "a fixed pattern looks like noise, and averaging does not remove it";
        cases.honest(name, why, with(Flaw::FixedPattern(counts)));
    }
    cases.all
}

fn second_spot() -> Vec<RowCase> {
    let mut cases = Cases::of("A second spot");
    for offset in [2.0, 3.0, 5.0, 6.0, 10.0, 20.0] {
        for share in [0.05, 0.1, 0.5, 0.8, 1.0, 1.2] {
            let recipe = with(second(share, offset));
            let why = match share {
                share if share > 0.75 => "which of the two is the laser's?",
                _ if offset < 4.0 => "it merges with the spot and moves it",
                _ => "its flank is under the spot",
            };
            let due = match share > 0.75 && offset > 4.0 {
                true => Due::NoCentre,
                false => Due::Honest,
            };
            let name = format!("second spot of {:.0} % at {offset} sigma", 100.0 * share);
            let case = cases.add(name, why, due, recipe);
            // Clear of the spot it owes what it owes for one alone; half as high, twice as much.
            case.repair_within = match (share, offset) {
                (0.05 | 0.1, 6.0..) => Some(0.16),
                (0.5, 5.0..) => Some(5.0 * 0.04),
                _ => None,
            };
        }
    }
    for (share, offset, due) in [
        (0.1, 6.0, Due::Honest),
        (0.5, 5.0, Due::Honest),
        (1.0, 8.0, Due::NoCentre),
    ] {
        let percent = 100.0 * share;
        let name = format!("second spot of {percent:.0} % at {offset} sigma, sigma {NARROW}");
        let why = "the spot has few pixels";
        let recipe = Recipe::clean(NARROW).with(second(share, offset));
        cases.add(name, why, due, recipe);
    }
    cases.all
}

fn lopsided(width: f64, share: f64) -> Recipe {
    Recipe::clean(width).spot(|spot| spot.shape = Shape::Lopsided(share))
}

fn shapes() -> Vec<RowCase> {
    let mut cases = Cases::of("Other shapes");
    for width in [NARROW, 4.0, WIDTH, 15.0] {
        for (name, shape) in [
            ("sinc^2", Shape::SincSquared),
            ("Fresnel", Shape::Fresnel),
            ("1 mm laser spot", Shape::LaserSpot),
        ] {
            let name = format!("{name}, sigma {width}");
            let why = "it has side lobes or shoulders, unlike a gaussian";
            cases.clean(name, why, on(1024, width).spot(|spot| spot.shape = shape));
        }
    }
    for share in [0.05, 0.1, 0.2, 0.3, -0.3] {
        let name = format!("right side {} % wider", 100.0 * share);
        let why = "it has no single centre: peak and centroid differ";
        cases.honest(name, why, lopsided(WIDTH, share));
    }
    let name = format!("right side 30 % wider, sigma {NARROW}");
    cases.honest(name, "the spot has few pixels", lopsided(NARROW, 0.3));
    cases.all
}

fn interference() -> Vec<RowCase> {
    let mut cases = Cases::of("Interference");
    for period in [2.0, 7.3, 20.0, 63.0, 300.0] {
        for counts in [5.0, 50.0] {
            let name = format!("ripple of {counts} counts every {period} pixels");
            let why = "ripple of a supply or a clock gets into the signal";
            cases.honest(name, why, with(Flaw::Ripple(counts, period)));
        }
    }
    let name = "odd pixels 40 counts higher";
    let why = "two output amplifiers differ";
    cases.honest(name, why, with(Flaw::OddEven(40.0)));
    for share in [0.001, 0.01, 0.05] {
        for width in [WIDTH, NARROW] {
            let percent = 100.0 * share;
            let name = format!("{percent} % of the pixels are impulses, sigma {width}");
            let why = "interference: some pixels have random counts";
            cases.honest(name, why, Recipe::clean(width).with(Flaw::Impulses(share)));
        }
    }
    let noisy = |read_noise, electrons_per_count| Recipe {
        read_noise,
        electrons_per_count,
        ..Recipe::clean(WIDTH)
    };
    let name = "no shot noise, strong read noise";
    let why = "the default weights are made for another mix of noise";
    cases.clean(name, why, noisy(40.0, None));
    let name = "half an electron a count";
    let why = "the spot's top is much noisier than the background";
    cases.clean(name, why, noisy(2.0, Some(0.5)));
    cases.all
}

fn converter() -> Vec<RowCase> {
    let mut cases = Cases::of("Converter");
    for bits in [8u32, 6, 4, 2, 1] {
        let why = match bits {
            1 => "a pixel is either lit or not",
            _ => "steps are larger than the noise",
        };
        let steps = Flaw::Steps(f64::from(1u32 << (12 - bits)));
        cases.honest(format!("{bits} of 12 bits"), why, with(steps));
    }
    for (bit, at) in [(0, 1), (4, 1), (7, 0), (10, 0), (10, 1), (11, 1)] {
        let name = format!("bit {bit} stuck at {at}");
        let why = "counts jump where the bit should have changed";
        cases.honest(name, why, with(Flaw::StuckBit(bit, at == 1)));
    }
    cases.all
}

fn short_rows() -> Vec<RowCase> {
    let mut cases = Cases::of("Short rows");
    for pixels in [8, 31] {
        let place = Place::At(pixels as f64 / 2.0);
        let recipe = on(pixels, NARROW).spot(|spot| spot.place = place);
        let (why, due) = (
            "too few pixels to know the background",
            Due::Fault(&["no spot"]),
        );
        cases.add(format!("{pixels} pixels"), why, due, recipe);
    }
    for (pixels, width) in [
        (32, 1.5),
        (48, 3.0),
        (64, 10.5),
        (96, 10.5),
        (127, 10.5),
        (128, 10.5),
        (256, 40.0),
    ] {
        let place = Place::At(pixels as f64 / 2.0 - 0.3);
        let name = format!("{pixels} pixels, sigma {width}");
        let why = "the window is longer than the row, and little background is left";
        cases.honest(name, why, on(pixels, width).spot(|spot| spot.place = place));
    }
    cases.all
}
