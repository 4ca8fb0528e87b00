//! What is worth its time.

/// The Pareto front: the places of those points (time, error), in order of time, that no other point of at
/// most the same time beats or equals in error. An error that is smaller by less than the relative `chance`
/// is taken for equal. Points that are not numbers are left out.
pub fn front(points: &[(f64, f64)], chance: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len())
        .filter(|&i| points[i].0.is_finite() && points[i].1.is_finite())
        .collect();
    order.sort_by(|&a, &b| {
        let ((time_a, error_a), (time_b, error_b)) = (points[a], points[b]);
        time_a.total_cmp(&time_b).then(error_a.total_cmp(&error_b))
    });
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i].1 < best * (1.0 - chance);
        if better {
            best = points[i].1;
        }
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_faster_beats() {
        let points = [(3.0, 1.1), (1.0, 5.0), (2.0, 5.5), (4.0, 1.0), (5.0, 1.05)];
        assert_eq!(front(&points, 0.0), [1, 0, 3]);
        // A tenth better is chance here: only the first of two remains.
        assert_eq!(front(&points, 0.15), [1, 0]);
    }

    #[test]
    fn the_first_of_a_tie_is_kept_and_nan_is_left_out() {
        let points = [
            (1.0, 2.0),
            (1.0, 1.5),
            (1.0, 1.5),
            (0.5, f64::NAN),
            (2.0, 1.5),
        ];
        assert_eq!(front(&points, 0.0), [1]);
        assert!(front(&[], 0.0).is_empty());
    }
}
