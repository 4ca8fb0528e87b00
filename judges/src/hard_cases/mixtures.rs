//! Random rows: clean ones, and such with one to three flaws of the catalogue's kinds, over the catalogue's
//! ranges.
//!
//! Nothing is left out because an estimator fails at it. One thing is left out because no single row can show
//! it: speckle on a laser spot smaller than the slit's resolution moves the whole spot and leaves its shape
//! alone. It is judged in frames of a moving target, where rows disagree.

use crate::hard_cases::flaw::{Bad, Flaw, Second};
use crate::hard_cases::recipe::{Place, Recipe, Spot};
use crate::hard_cases::{HardRow, Shape};
use rand::seq::index;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// A row that was drawn at random, and can be drawn again by its seed.
#[derive(Clone, Debug, PartialEq)]
pub struct RandomRow {
    /// The seed.
    pub seed: u64,
    /// What is wrong with it; nothing with a clean one.
    pub kinds: Vec<Kind>,
    /// What it is made of.
    pub recipe: Recipe,
}

macro_rules! kinds {
    ($($(#[$what:meta])+ $kind:ident = $name:literal,)+) => {
        /// What can be wrong with a random row.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Kind {
            $($(#[$what])+ $kind,)+
        }

        impl Kind {
            /// All of them, in order, with their names.
            pub const ALL: [(Self, &str); [$($name),+].len()] = [$((Self::$kind, $name)),+];
        }
    };
}

kinds! {
    /// There is no spot.
    NoSpot = "no spot",
    /// The spot is up to four times as high as full scale.
    Saturated = "saturated",
    /// Its sigma is between 0.3 and 0.8 pixels, or between 30 and 200.
    ExtremeWidth = "very narrow or wide",
    /// Its centre is between one sigma beyond the edge and three inside.
    Edge = "at the edge",
    /// The background rises or falls by up to 5 counts a pixel.
    Slope = "slope",
    /// The black level jumps by up to 50 counts within 12 sigma of the spot.
    Step = "step of the black level",
    /// It bends by up to 300 counts.
    Sag = "black level bends",
    /// It is anywhere from 300 below zero to 4090.
    BlackLevel = "any black level",
    /// A lamp lights one end by up to 1500 counts.
    Glow = "lamp at one end",
    /// A ghost of 1 to 20 %, 4 to 15 times as wide, up to 6 sigma off.
    Ghost = "wide flare",
    /// One to three hot pixels within 16 sigma.
    Hot = "hot pixels",
    /// One to three dead ones.
    Dead = "dead pixels",
    /// One stuck at any count.
    Stuck = "a stuck pixel",
    /// Pixels differ by 0.2 to 5 % in response.
    Response = "uneven response",
    /// Unlit pixels differ by 1 to 30 counts.
    FixedPattern = "fixed pattern",
    /// The full well is below full scale, and blooms to both sides.
    FullWell = "blooms to both sides",
    /// A full well that blooms to one side.
    Smear = "blooms to one side",
    /// A second spot of 5 to 120 % at 2 to 20 sigma.
    Second = "second spot",
    /// One side is up to 30 % wider than the other.
    Lopsided = "lopsided spot",
    /// A ripple of 1 to 50 counts with a period of 2 to 300 pixels.
    Ripple = "ripple",
    /// Odd pixels read up to 40 counts more or less.
    OddEven = "odd and even pixels",
    /// 0.1 to 5 % of the pixels are impulses.
    Impulses = "impulses",
    /// The converter has 1 to 10 bits.
    CoarseSteps = "coarse converter",
    /// One of its bits is stuck.
    StuckBit = "stuck bit",
    /// The row has 32 to 128 pixels.
    ShortRow = "short row",
    /// Read noise of 8 to 60 counts, or half an electron to two a count.
    Noise = "strong noise",
}

/// A spot that nothing is wrong with: any profile but a lopsided one, sigma 0.8 to 30, from the dimmest that
/// gives a centre to 4000 counts, with read noise of 0.5 to 8 counts and 2 to 20 electrons a count or no shot
/// noise, whole on the row.
pub fn clean(seed: u64) -> RandomRow {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (kinds, recipe) = (vec![], clean_recipe(&mut random));
    RandomRow {
        seed,
        kinds,
        recipe,
    }
}

/// The same with one to three flaws, each number as likely, and each kind as likely.
pub fn mixture(seed: u64) -> RandomRow {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut recipe = clean_recipe(&mut random);
    let count = random.random_range(1..=3);
    let mut chosen = index::sample(&mut random, Kind::ALL.len(), count).into_vec();
    // In the order of the kinds: those that change the spot, which others go by, come first.
    chosen.sort_unstable();
    let kinds: Vec<Kind> = chosen.into_iter().map(|i| Kind::ALL[i].0).collect();
    for kind in &kinds {
        kind.put_into(&mut recipe, &mut random);
    }
    if kinds.contains(&Kind::NoSpot) {
        recipe.spot = None;
    }
    RandomRow {
        seed,
        kinds,
        recipe,
    }
}

impl RandomRow {
    /// The row.
    pub fn row(&self) -> HardRow {
        self.recipe.row(self.seed, 0)
    }
}

fn clean_recipe(random: &mut ChaCha8Rng) -> Recipe {
    use Shape::{Fresnel, Gaussian, LaserSpot, SincSquared};
    let shapes = [Gaussian, SincSquared, Fresnel, LaserSpot];
    let shape = shapes[random.random_range(0..shapes.len())];
    let width = log_even(random, 0.8, 30.0);
    let read_noise = log_even(random, 0.5, 8.0);
    let has_shot_noise = random.random_bool(0.75);
    let electrons_per_count = has_shot_noise.then(|| log_even(random, 2.0, 20.0));
    let black_level = random.random_range(60.0..400.0);
    // Nothing is cut off at full scale: five standard deviations of a bright pixel's noise.
    let bright = electrons_per_count.map_or(0.0, |electrons| 4000.0 / electrons);
    let highest = 4094.0 - black_level - 5.0 * (read_noise * read_noise + bright).sqrt();
    let dimmest = dimmest(width, read_noise, electrons_per_count);
    let amplitude = log_even(random, dimmest, highest);
    let pixels = if width < 12.0 { 512 } else { 1024 };
    // Whole: five sigma, where a gaussian has a millionth of its height left.
    let margin = 5.0 * width + 2.0;
    let place = random.random_range(margin..pixels as f64 - 1.0 - margin);
    Recipe {
        pixels,
        spot: Some(Spot {
            shape,
            width,
            amplitude,
            place: Place::At(place),
        }),
        black_level,
        read_noise,
        electrons_per_count,
        saturation: slitrange::row::LARGEST_COUNT,
        flaws: vec![],
    }
}

/// The height in counts at which the bound is an eighth of the width, which is the least certain centre that
/// is given out: in white noise the bound is 1.06 sqrt(width) noise / height, in shot noise sqrt(0.4 width /
/// (height electrons)).
fn dimmest(width: f64, noise: f64, electrons_per_count: Option<f64>) -> f64 {
    let in_white = 8.0 * 1.0622 * (noise * noise + 1.0 / 12.0).sqrt() / width.sqrt();
    let in_shot = electrons_per_count.map_or(0.0, |electrons| 64.0 * 0.3989 / (width * electrons));
    in_white.max(in_shot)
}

/// A number that is even over its logarithm.
pub fn log_even(random: &mut ChaCha8Rng, from: f64, to: f64) -> f64 {
    from * (to / from).powf(random.random())
}

fn either_sign(random: &mut ChaCha8Rng, value: f64) -> f64 {
    if random.random() { value } else { -value }
}

impl Kind {
    /// Does it to a recipe, with parameters that are evenly drawn over its range, or evenly over their
    /// logarithms where they span decades.
    fn put_into(self, recipe: &mut Recipe, random: &mut ChaCha8Rng) {
        let flaw = match self {
            // The other flaws still go by its place: it goes last.
            Self::NoSpot => return,
            Self::Saturated => return set_height(recipe, 1.05 * 4095.0, random),
            Self::ExtremeWidth => return set_width(recipe, random),
            Self::Edge => return to_the_edge(recipe, random),
            Self::Lopsided => {
                let share = random.random_range(-0.3..0.3);
                return change(recipe, |spot| spot.shape = Shape::Lopsided(share));
            }
            Self::BlackLevel => {
                recipe.black_level = random.random_range(-300.0..4090.0);
                return;
            }
            Self::ShortRow => {
                let pixels = random.random_range(32..=128);
                recipe.pixels = pixels;
                let place = random.random_range(0.0..pixels as f64 - 1.0);
                return change(recipe, |spot| spot.place = Place::At(place));
            }
            Self::Noise => {
                if random.random() {
                    recipe.read_noise = log_even(random, 8.0, 60.0);
                } else {
                    recipe.electrons_per_count = Some(log_even(random, 0.5, 2.0));
                }
                return;
            }
            Self::Slope => {
                let slope = random.random_range(0.0..5.0);
                Flaw::Slope(either_sign(random, slope))
            }
            Self::Step => {
                let counts = random.random_range(-50.0..50.0);
                Flaw::Step(counts, random.random_range(-12.0..12.0))
            }
            Self::Sag => Flaw::Sag(random.random_range(-300.0..300.0)),
            Self::Glow => Flaw::Glow(random.random_range(0.0..1500.0)),
            Self::Ghost => {
                let offset = random.random_range(0.0..6.0);
                let share = log_even(random, 0.01, 0.2);
                let widths = random.random_range(4.0..15.0);
                Flaw::Ghost(Second::new(share, either_sign(random, offset), widths))
            }
            Self::Hot => {
                let counts = log_even(random, 50.0, 3000.0);
                Flaw::Hot(bad(random, counts, 3))
            }
            // It sees nothing: it reads the black level.
            Self::Dead => Flaw::Dead(bad(random, recipe.black_level, 3)),
            Self::Stuck => {
                let counts = random.random_range(0.0..4095.0);
                Flaw::Stuck(bad(random, counts, 1))
            }
            Self::Response => Flaw::Response(log_even(random, 0.002, 0.05)),
            Self::FixedPattern => Flaw::FixedPattern(log_even(random, 1.0, 30.0)),
            Self::FullWell => {
                set_height(recipe, 3600.0, random);
                let well = random.random_range(1500.0..4000.0);
                Flaw::FullWell(well, random.random_range(0.0..1.0))
            }
            Self::Smear => {
                set_height(recipe, 3600.0, random);
                Flaw::Smear(random.random_range(0.1..0.9))
            }
            Self::Second => {
                let offset = random.random_range(2.0..20.0);
                Flaw::Second(Second {
                    share: random.random_range(0.05..1.2),
                    offset: either_sign(random, offset),
                    widths: log_even(random, 0.7, 1.5),
                })
            }
            Self::Ripple => Flaw::Ripple(log_even(random, 1.0, 50.0), log_even(random, 2.0, 300.0)),
            Self::OddEven => Flaw::OddEven(random.random_range(-40.0..40.0)),
            Self::Impulses => Flaw::Impulses(log_even(random, 0.001, 0.05)),
            // 10 bits of 12 down to one.
            Self::CoarseSteps => Flaw::Steps(f64::from(1u32 << random.random_range(2..=11))),
            Self::StuckBit => Flaw::StuckBit(random.random_range(0..12), random.random()),
        };
        recipe.flaws.push(flaw);
    }
}

fn change(recipe: &mut Recipe, how: impl FnOnce(&mut Spot)) {
    if let Some(spot) = &mut recipe.spot {
        how(spot);
    }
}

/// From so many counts to four times full scale.
fn set_height(recipe: &mut Recipe, least: f64, random: &mut ChaCha8Rng) {
    let height = log_even(random, least, 4.0 * 4095.0);
    change(recipe, |spot| spot.amplitude = height);
}

/// Narrower than any table is made for, or wider than any clean spot.
fn set_width(recipe: &mut Recipe, random: &mut ChaCha8Rng) {
    if random.random() {
        let width = log_even(random, 0.3, 0.8);
        return change(recipe, |spot| spot.width = width);
    }
    recipe.pixels = 2048;
    let width = log_even(random, 30.0, 200.0);
    let place = random.random_range(500.0..1548.0);
    change(recipe, |spot| {
        (spot.width, spot.place) = (width, Place::At(place));
    });
}

/// From one width beyond either edge to three inside.
fn to_the_edge(recipe: &mut Recipe, random: &mut ChaCha8Rng) {
    let last = recipe.pixels as f64 - 1.0;
    let (widths, at_the_end) = (random.random_range(-1.0..3.0), random.random());
    change(recipe, |spot| {
        let inside = widths * spot.width;
        spot.place = Place::At(if at_the_end { last - inside } else { inside });
    });
}

fn bad(random: &mut ChaCha8Rng, counts: f64, most: usize) -> Bad {
    let places = [(0.0, 2.0), (2.0, 6.0), (6.0, 16.0)];
    Bad {
        counts,
        pixels: random.random_range(1..=most),
        from_spot: places[random.random_range(0..places.len())],
    }
}
