//! Colours that page and picture share.

/// Heights from low to high: even in lightness, and legible with any colour vision (viridis without its darkest end).
pub(super) const RAMP: [[u8; 3]; 6] =
    [[62, 74, 137], [49, 104, 142], [38, 130, 142], [53, 183, 121], [143, 215, 68], [253, 231, 37]];

/// Seams, in the order of their ids: apart from the ramp and from each other.
const SEAMS: [[u8; 3]; 8] = [
    [230, 57, 70],
    [255, 140, 0],
    [214, 51, 200],
    [0, 160, 255],
    [255, 92, 138],
    [170, 90, 255],
    [255, 196, 0],
    [0, 200, 180],
];

/// Colour of a seam.
pub(super) fn of_seam(id: usize) -> [u8; 3] {
    SEAMS[id.wrapping_sub(1) % SEAMS.len()]
}

/// Place `t`, 0..1, on the ramp.
pub(super) fn on_ramp(t: f64) -> [u8; 3] {
    let place = t.clamp(0.0, 1.0) * (RAMP.len() - 1) as f64;
    let k = (place as usize).min(RAMP.len() - 2);
    let share = place - k as f64;
    let between = |a: u8, b: u8| (f64::from(a) + share * (f64::from(b) - f64::from(a))).round() as u8;
    [0, 1, 2].map(|c| between(RAMP[k][c], RAMP[k + 1][c]))
}

/// As style sheets and SVG write it.
pub(super) fn css([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ramp_begins_and_ends_at_its_ends() {
        assert_eq!((on_ramp(-1.0), on_ramp(2.0)), (RAMP[0], RAMP[5]));
        assert_eq!(on_ramp(0.2), RAMP[1]);
        assert_eq!(css([0, 16, 255]), "#0010ff");
    }
}
