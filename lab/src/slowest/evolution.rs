//! The evolution of slow rows.

use judges::hard_cases::mixtures::log_even;
use rand::seq::IndexedRandom as _;
use slowest_on_chip::description::{Description, Kind, SHAPES, Shape};
use slowest_on_chip::mailbox::{ESTIMATORS, QUESTIONS, Question};
use slowest_on_chip::words::PIXELS;

use super::chips::Chips;
use crate::prelude::*;

/// The slow rows that are kept for an estimator, first or following ones.
const KEPT: usize = 24;

/// Of so many new rows one owes nothing to the rows that are kept.
const NEW: u32 = 16;

/// Rows that are counted before the next ones are made.
const BATCH: usize = 4 * QUESTIONS;

#[derive(Clone, Copy, Debug)]
pub struct Slow {
    pub question: Question,
    pub instructions: u32,
}

pub struct Search {
    random: ChaCha8Rng,
    /// The slowest rows of each estimator, the slowest first: first rows and following ones.
    kept: [[Vec<Slow>; ESTIMATORS]; 2],
    pub rows: u64,
}

impl Search {
    /// The same seed gives the same rows.
    pub fn new(seed: u64) -> Self {
        Self {
            random: ChaCha8Rng::seed_from_u64(seed),
            kept: Default::default(),
            rows: 0,
        }
    }

    pub fn add(&mut self, chips: &mut Chips, questions: &[Question]) -> Result<()> {
        for (question, instructions) in questions.iter().zip(chips.count(questions)?) {
            let kept = &mut self.kept[usize::from(question.follows)][question.estimator as usize];
            let place = kept.partition_point(|slow| slow.instructions > instructions);
            // Descriptions that make the same row take the same time.
            let next = kept.get(place).map(|slow| slow.instructions);
            if place < KEPT && next != Some(instructions) {
                let slow = Slow {
                    question: *question,
                    instructions,
                };
                kept.insert(place, slow);
                kept.truncate(KEPT);
            }
            self.rows += 1;
        }
        Ok(())
    }

    pub fn step(&mut self, chips: &mut Chips) -> Result<()> {
        let questions: Vec<Question> = (0..BATCH)
            .map(|i| self.child(Estimator::ALL[i / 2 % ESTIMATORS], i % 2 == 1))
            .collect();
        self.add(chips, &questions)
    }

    pub fn slowest(&self, estimator: Estimator, follows: bool) -> Option<Slow> {
        self.kept[usize::from(follows)][estimator as usize]
            .first()
            .copied()
    }

    fn child(&mut self, estimator: Estimator, follows: bool) -> Question {
        let random = &mut self.random;
        let all = &self.kept[usize::from(follows)];
        // Most parents are slow for the same estimator.
        let mut parent = || {
            let other = random.random_range(0..ESTIMATORS);
            let is_other = random.random_ratio(1, 4);
            let kept = &all[if is_other { other } else { estimator as usize }];
            let two = [kept.choose(random)?, kept.choose(random)?];
            let slower = two.into_iter().max_by_key(|slow| slow.instructions)?;
            Some(slower.question.description)
        };
        let description = match [parent(), parent()] {
            [Some(first), Some(second)] if !random.random_ratio(1, NEW) => {
                changed(first, &second, random)
            }
            _ => new(random),
        };
        Question {
            description,
            estimator,
            follows,
        }
    }
}

fn new(random: &mut ChaCha8Rng) -> Description {
    let mut shapes = [Shape::default(); SHAPES];
    let place = random.random_range(0..PIXELS as u16 * 16);
    let width = (256.0 * log_even(random, 0.4, 120.0)) as u16;
    let flaws = random.random_range(0..SHAPES);
    for (i, shape) in shapes.iter_mut().take(flaws + 1).enumerate() {
        *shape = some_shape(place, width, random);
        if i == 0 {
            shape.kind = Kind::Spot;
            shape.rows = 3;
        }
    }
    Description {
        black: random.random_range(0..800),
        noise: (256.0 * log_even(random, 0.2, 40.0)) as u16,
        seed: random.random(),
        shapes,
    }
}

fn some_shape(place: u16, width: u16, random: &mut ChaCha8Rng) -> Shape {
    let reach = 10.0 * f64::from(width) / 16.0;
    let offset = random.random_range(-reach..=reach) as i32;
    let most = PIXELS as i32 * 16 - 1;
    let sign = if random.random_ratio(1, 5) { -1.0 } else { 1.0 };
    Shape {
        kind: *Kind::ALL.choose(random).expect("there are kinds"),
        rows: random.random_range(1..=3),
        place: (i32::from(place) + offset).clamp(0, most) as u16,
        width: (f64::from(width) * log_even(random, 0.1, 8.0)).min(65535.0) as u16,
        height: (sign * log_even(random, 2.0, 8000.0)) as i16,
        more: random.random(),
    }
}

fn changed(mut child: Description, other: &Description, random: &mut ChaCha8Rng) -> Description {
    if random.random_ratio(1, 4) {
        for (shape, others) in child.shapes.iter_mut().zip(other.shapes) {
            if random.random() {
                *shape = others;
            }
        }
    }
    for _ in 0..random.random_range(1..=4) {
        change(&mut child, random);
    }
    child
}

fn change(child: &mut Description, random: &mut ChaCha8Rng) {
    let mut shapes = child.shapes.iter();
    let spot = shapes.find(|shape| shape.kind != Kind::Nothing);
    let (place, width) = spot.map_or((20_000, 2000), |spot| (spot.place, spot.width));
    let slot = random.random_range(0..SHAPES);
    let factor = if random.random() {
        log_even(random, 0.97, 1.03)
    } else {
        log_even(random, 0.5, 2.0)
    };
    let part = random.random::<f64>();
    let scaled = |value: u16| (f64::from(value) * factor + part).min(65535.0) as u16;
    let shape = &mut child.shapes[slot];
    match random.random_range(0..14) {
        0 => child.seed = random.random(),
        1 => child.seed = child.seed.wrapping_add(random.random_range(1..64)),
        2 => child.noise = scaled(child.noise),
        3 => child.black = scaled(child.black).min(4095),
        4 | 5 => *shape = some_shape(place, width, random),
        6 => *shape = Shape::default(),
        // A single word.
        7 => {
            *shape = Shape {
                kind: Kind::Pixel,
                rows: random.random_range(1..=3),
                height: random.random_range(0..4096),
                ..some_shape(place, width, random)
            }
        }
        kind @ (8 | 9) => {
            let most = if kind == 8 { 20 } else { 2000 };
            let by = random.random_range(-most..=most);
            shape.place = shape.place.saturating_add_signed(by);
        }
        10 => shape.width = scaled(shape.width),
        11 => shape.height = (f64::from(shape.height) * factor) as i16,
        12 => shape.more = scaled(shape.more),
        _ => shape.rows = random.random_range(1..=3),
    }
    let most = PIXELS as u16 * 16 - 1;
    for shape in &mut child.shapes {
        shape.place = shape.place.min(most);
    }
}
