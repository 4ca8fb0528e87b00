//! Where labels go so that none lies on another.

use figures::axes::TEXT;

use super::style::CHARACTER;

/// A box in pixels: left, top, right, bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Box {
    pub left: f64,
    pub top: f64,
    pub right: f64,
    pub bottom: f64,
}

impl Box {
    /// Of a text whose middle is here.
    fn of(text: &str, (x, y): Point) -> Self {
        let width = text.chars().count() as f64 * CHARACTER * f64::from(TEXT);
        let height = f64::from(TEXT) + 2.0;
        Self {
            left: x - width / 2.0,
            top: y - height / 2.0,
            right: x + width / 2.0,
            bottom: y + height / 2.0,
        }
    }

    fn grown(self, by: f64) -> Self {
        Self {
            left: self.left - by,
            top: self.top - by,
            right: self.right + by,
            bottom: self.bottom + by,
        }
    }

    fn overlaps(&self, other: &Self) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    fn contains(&self, (x, y): Point) -> bool {
        (self.left..=self.right).contains(&x) && (self.top..=self.bottom).contains(&y)
    }

    fn within(&self, other: &Self) -> bool {
        self.left >= other.left
            && self.right <= other.right
            && self.top >= other.top
            && self.bottom <= other.bottom
    }

    /// The point of the box that is nearest to one outside.
    fn nearest(&self, (x, y): Point) -> Point {
        (
            x.clamp(self.left, self.right),
            y.clamp(self.top, self.bottom),
        )
    }

    /// Whether a part of the line lies in the box (Liang and Barsky's clipping).
    fn crosses(&self, (from, to): Line) -> bool {
        let (mut enters, mut leaves) = (0.0f64, 1.0f64);
        for (start, length, least, most) in [
            (from.0, to.0 - from.0, self.left, self.right),
            (from.1, to.1 - from.1, self.top, self.bottom),
        ] {
            if length == 0.0 {
                if start < least || start > most {
                    return false;
                }
                continue;
            }
            let (a, b) = ((least - start) / length, (most - start) / length);
            enters = enters.max(a.min(b));
            leaves = leaves.min(a.max(b));
        }
        enters <= leaves
    }
}

/// A place in pixels.
pub type Point = (f64, f64);

/// A straight line between two places.
pub type Line = (Point, Point);

/// Where a label went.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    /// The text's box.
    pub text: Box,
    /// A line from the point to its label, where that is not beside it.
    pub leader: Option<Line>,
}

/// Radius of a point and the air around it.
const POINT: f64 = 9.0;

/// Places a label for each point: within the area, on no other label and on no point, if possible on none of
/// the lines, and near. From a number of orders in which they find their places, and then make room for each
/// other, the best is taken; always the same one for the same points.
pub fn place(points: &[(Point, String)], lines: &[Line], area: Box) -> Vec<Placed> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    let mut best: Option<(f64, Vec<Placed>)> = None;
    let mut random = 1u32;
    for _ in 0..100 {
        let (cost, placed) = place_in_order(points, lines, area, &order);
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, placed));
        }
        // Fisher and Yates's shuffle with Numerical Recipes' generator.
        for i in (1..order.len()).rev() {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            order.swap(i, (random >> 8) as usize % (i + 1));
        }
    }
    best.map(|(_, placed)| placed).unwrap_or_default()
}

/// Rounds in which each label looks for a better place among the others.
const ROUNDS: usize = 4;

fn place_in_order(
    points: &[(Point, String)],
    lines: &[Line],
    area: Box,
    order: &[usize],
) -> (f64, Vec<Placed>) {
    let mut placed: Vec<Option<Placed>> = vec![None; points.len()];
    let mut costs = vec![0.0; points.len()];
    for &i in order.iter().cycle().take(ROUNDS * order.len()) {
        let (point, text) = &points[i];
        placed[i] = None;
        let others: Vec<Placed> = placed.iter().flatten().copied().collect();
        let (cost, here) = candidates(*point, text)
            .map(|here| (cost(&here, *point, points, &others, lines, area), here))
            .min_by(|(a, _), (b, _)| a.total_cmp(b))
            .expect("there are candidates");
        costs[i] = cost;
        placed[i] = Some(here);
    }
    (costs.iter().sum(), placed.into_iter().flatten().collect())
}

/// All around the point, near and far.
fn candidates(point: Point, text: &str) -> impl Iterator<Item = Placed> {
    const FAR: [f64; 9] = [5.0, 16.0, 30.0, 46.0, 64.0, 84.0, 106.0, 130.0, 160.0];
    FAR.into_iter().flat_map(move |far| {
        (0..24).map(move |step| {
            let (sin, cos) = (f64::from(step) * std::f64::consts::TAU / 24.0).sin_cos();
            let size = Box::of(text, (0.0, 0.0));
            let text = Box::of(
                text,
                (
                    point.0 + cos * (POINT + far + size.right),
                    point.1 + sin * (POINT + far + size.bottom),
                ),
            );
            Placed {
                text,
                leader: (far > 5.0).then(|| (point, text.nearest(point))),
            }
        })
    })
}

fn cost(
    here: &Placed,
    point: Point,
    points: &[(Point, String)],
    others: &[Placed],
    lines: &[Line],
    area: Box,
) -> f64 {
    let mut cost = 0.0;
    let mut charge = |price: f64, times: usize| cost += price * times as f64;
    charge(1e5, usize::from(!here.text.within(&area)));
    let air = here.text.grown(2.0);
    charge(
        1e4,
        others
            .iter()
            .filter(|other| air.overlaps(&other.text))
            .count(),
    );
    let on_point = |other: &Point| here.text.grown(POINT).contains(*other);
    charge(
        1e4,
        points.iter().filter(|(other, _)| on_point(other)).count(),
    );
    charge(
        100.0,
        lines
            .iter()
            .filter(|line| here.text.crosses(**line))
            .count(),
    );
    let to = here.text.nearest(point);
    let far = (to.0 - point.0).hypot(to.1 - point.1);
    // A long line to a label is worse than two short ones.
    charge(1.0, (far + far * far / 60.0) as usize);
    for other in others {
        // A line over a label, either way, or over a line.
        let over = other
            .leader
            .is_some_and(|leader| here.text.grown(2.0).crosses(leader));
        charge(3e3, usize::from(over));
    }
    if let Some(leader) = here.leader {
        let over = |text: &Box| text.grown(2.0).crosses(leader);
        charge(3e3, others.iter().filter(|other| over(&other.text)).count());
        let crossing = others
            .iter()
            .filter(|other| other.leader.is_some_and(|other| cross(leader, other)))
            .count();
        charge(500.0, crossing);
        let near = |other: &Point| {
            *other != point && {
                let around = Box {
                    left: other.0 - 6.0,
                    top: other.1 - 6.0,
                    right: other.0 + 6.0,
                    bottom: other.1 + 6.0,
                };
                around.crosses(leader)
            }
        };
        charge(
            200.0,
            points.iter().filter(|(other, _)| near(other)).count(),
        );
    }
    cost
}

fn cross((a, b): Line, (c, d): Line) -> bool {
    let side =
        |p: Point, q: Point, r: Point| (q.0 - p.0) * (r.1 - p.1) - (q.1 - p.1) * (r.0 - p.0) > 0.0;
    side(a, b, c) != side(a, b, d) && side(c, d, a) != side(c, d, b)
}

/// Moves labels at these heights, which are in ascending order, apart until they are `apart` from one
/// another, within the range, and no further than that takes.
pub fn spread(heights: &[f64], apart: f64, range: (f64, f64)) -> Vec<f64> {
    // Groups of labels that touch lie about the mean of where they want to be.
    struct Group {
        wanted: f64,
        count: f64,
    }
    let top = |group: &Group| {
        let span = (group.count - 1.0) * apart;
        let middle = group.wanted / group.count;
        // The upper end of the range wins where there is no room.
        (middle - span / 2.0).min(range.1 - span).max(range.0)
    };
    let mut groups: Vec<Group> = vec![];
    for &height in heights {
        groups.push(Group {
            wanted: height,
            count: 1.0,
        });
        while let [.., upper, lower] = &groups[..] {
            if top(upper) + upper.count * apart <= top(lower) {
                break;
            }
            let (wanted, count) = (upper.wanted + lower.wanted, upper.count + lower.count);
            groups.truncate(groups.len() - 2);
            groups.push(Group { wanted, count });
        }
    }
    groups
        .iter()
        .flat_map(|group| {
            let first = top(group);
            (0..group.count as usize).map(move |i| first + i as f64 * apart)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: Box = Box {
        left: 0.0,
        top: 0.0,
        right: 600.0,
        bottom: 400.0,
    };

    #[test]
    fn labels_of_a_crowd_lie_apart_and_inside() {
        let points: Vec<(Point, String)> = (0..10)
            .map(|i| {
                (
                    (250.0 + 12.0 * f64::from(i), 380.0),
                    format!("estimator {i}"),
                )
            })
            .collect();
        let placed = place(&points, &[], AREA);
        assert_eq!(placed.len(), 10);
        for (i, here) in placed.iter().enumerate() {
            assert!(here.text.within(&AREA), "{here:?}");
            for other in &placed[..i] {
                assert!(!here.text.overlaps(&other.text), "{here:?} {other:?}");
            }
            for (point, _) in &points {
                assert!(!here.text.contains(*point), "{here:?} {point:?}");
            }
        }
    }

    #[test]
    fn a_line_crosses_a_box_or_misses_it() {
        for (line, crosses) in [
            (((-10.0, 200.0), (700.0, 210.0)), true),
            (((10.0, 10.0), (20.0, 20.0)), true),
            (((-10.0, 50.0), (-10.0, 350.0)), false),
            (((-100.0, 200.0), (-1.0, 200.0)), false),
            (((-50.0, 10.0), (10.0, -60.0)), false),
            (((-50.0, 60.0), (60.0, -50.0)), true),
        ] {
            assert_eq!(AREA.crosses(line), crosses, "{line:?}");
        }
    }

    #[test]
    fn a_label_alone_is_beside_its_point() {
        let placed = place(&[((300.0, 200.0), "alone".into())], &[], AREA);
        assert!(placed[0].leader.is_none());
        assert!(place(&[], &[], AREA).is_empty());
    }

    #[test]
    fn heights_spread_no_further_than_they_must() {
        let spread = |heights: &[f64]| spread(heights, 10.0, (0.0, 100.0));
        assert_eq!(spread(&[10.0, 30.0, 31.0, 90.0]), [10.0, 25.5, 35.5, 90.0]);
        assert_eq!(spread(&[95.0, 99.0, 100.0]), [80.0, 90.0, 100.0]);
        assert_eq!(spread(&[1.0, 2.0]), [0.0, 10.0]);
    }
}
