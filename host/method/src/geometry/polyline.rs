//! Lengths along lines of points.

/// Distance from the first point to each, along the line, in the unit of the points' distances `between` neighbours.
pub(crate) fn arc_lengths<T>(points: &[T], between: impl Fn(&T, &T) -> f64) -> Vec<f64> {
    let mut at = Vec::with_capacity(points.len());
    let mut sum = 0.0;
    for (k, point) in points.iter().enumerate() {
        if k > 0 {
            sum += between(&points[k - 1], point);
        }
        at.push(sum);
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arc_lengths_begin_at_zero_and_add_up() {
        assert_eq!(arc_lengths(&[1.0, 3.0, 2.0], |a: &f64, b: &f64| (b - a).abs()), [0.0, 2.0, 3.0]);
        assert!(arc_lengths(&[], |_: &f64, _: &f64| 1.0).is_empty());
    }
}
