//! What the paper reports in its section III.

/// Fitness before the registration, and the iteration at which it settles: cylinder, Y shape (III-B).
pub(super) const FITNESS: [(&str, f64, u32); 2] = [("Cylinder", 0.86, 5), ("Y-shaped", 0.81, 15)];
/// Threshold at which F1 peaks: cylinder, Y shape (III-C).
pub(super) const BEST_THRESHOLD: [(&str, f64); 2] = [("Cylinder", 53.0), ("Y-shaped", 60.0)];
/// Table I: detected points, points after optimization, RMSE in mm and in degrees.
pub(super) const RMSE: [(&str, usize, usize, f64, f64); 2] =
    [("Cylinder", 78, 300, 0.7, 1.5), ("Y-shaped", 65, 300, 0.8, 1.3)];
/// Table II: run time in ms and speed in mm/s on the 500 mm V butt, from one view, mean of 20 runs.
pub(super) const RUNTIME: [(&str, f64, f64); 4] = [
    ("flat", 3691.0, 135.0),
    ("tilted", 3891.0, 129.0),
    ("horizontal", 3600.0, 139.0),
    ("vertical", 4100.0, 122.0),
];
/// III-A: time from gesture to motion, ms: straight motions, rotation; with sensor and robot.
pub(super) const INTERACTION_MS: [f64; 2] = [50.0, 900.0];
