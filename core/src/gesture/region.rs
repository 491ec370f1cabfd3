//! The seven regions round the interaction box (paper II-B): home, and one behind each face.

use crate::{Point, Vector};

/// A box above the hand sensor, along the axes of its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InteractionBox {
    center_mm: Point,
    half_mm: Vector,
}

impl Default for InteractionBox {
    /// The paper's 100 mm cube, its middle 200 mm above the sensor.
    fn default() -> Self {
        Self { center_mm: Point::new(0.0, 200.0, 0.0), half_mm: Vector::repeat(50.0) }
    }
}

impl InteractionBox {
    /// A cube by its middle and edge; none unless finite and with an edge above zero.
    pub fn new(center_mm: Point, edge_mm: f32) -> Option<Self> {
        Self::with_edges(center_mm, Vector::repeat(edge_mm))
    }

    /// A box by its middle and its edges along x, y and z; none unless finite and with edges above zero.
    pub fn with_edges(center_mm: Point, edges_mm: Vector) -> Option<Self> {
        let valid =
            center_mm.iter().chain(&edges_mm).all(|v| v.is_finite()) && edges_mm.iter().all(|&e| e > 0.0);
        valid.then_some(Self { center_mm, half_mm: edges_mm * 0.5 })
    }

    /// How far the palm is out of the box along a region's direction, mm; negative inside.
    pub fn outside_mm(&self, palm_mm: &Point, direction: &Vector) -> f32 {
        (palm_mm - self.center_mm).dot(direction) - self.half_mm.dot(&direction.abs())
    }

    /// `getRegion` of Alg. 1, with hysteresis: `current` ends only when the palm is `hysteresis_mm` inside its face, or
    /// that much further along another axis.
    pub fn region(&self, palm_mm: &Point, current: Region, hysteresis_mm: f32) -> Region {
        let furthest = Region::furthest(&(palm_mm - self.center_mm), &self.half_mm);
        let outside = |region: Region| region.direction().map(|d| self.outside_mm(palm_mm, &d));
        let reach_mm = outside(furthest).unwrap_or(0.0);
        match outside(current) {
            Some(kept_mm) if kept_mm >= -hysteresis_mm && kept_mm + hysteresis_mm >= reach_mm => current,
            _ if reach_mm > 0.0 => furthest,
            _ => Region::Home,
        }
    }
}

/// Where the palm is, and so which way the camera goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Region {
    /// In the box: the camera turns with the palm.
    Home,
    /// Sensor's -x.
    Left,
    /// Sensor's +x.
    Right,
    /// Sensor's +y.
    Up,
    /// Sensor's -y.
    Down,
    /// Sensor's -z, away from the user.
    Inward,
    /// Sensor's +z, toward the user.
    Outward,
}

impl Region {
    /// `u_d` of Alg. 1, sensor frame; none at home.
    pub fn direction(self) -> Option<Vector> {
        match self {
            Self::Home => None,
            Self::Left => Some(-Vector::x()),
            Self::Right => Some(Vector::x()),
            Self::Up => Some(Vector::y()),
            Self::Down => Some(-Vector::y()),
            Self::Inward => Some(-Vector::z()),
            Self::Outward => Some(Vector::z()),
        }
    }

    /// The direction in which `offset_mm` from the middle is furthest beyond, or nearest to, a face.
    fn furthest(offset_mm: &Vector, half_mm: &Vector) -> Self {
        let beyond_mm = offset_mm.abs() - half_mm;
        let pick = |value: f32, positive, negative| if value > 0.0 { positive } else { negative };
        if beyond_mm.x >= beyond_mm.y && beyond_mm.x >= beyond_mm.z {
            pick(offset_mm.x, Self::Right, Self::Left)
        } else if beyond_mm.y >= beyond_mm.z {
            pick(offset_mm.y, Self::Up, Self::Down)
        } else {
            pick(offset_mm.z, Self::Outward, Self::Inward)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f32, y: f32, z: f32) -> Point {
        Point::new(x, 200.0 + y, z)
    }

    #[test]
    fn the_seven_regions_are_behind_the_faces_of_the_box() {
        let cube = InteractionBox::default();
        for (palm, region) in [
            (at(49.0, -49.0, 49.0), Region::Home),
            (at(-51.0, 0.0, 0.0), Region::Left),
            (at(51.0, 50.0, -50.0), Region::Right),
            (at(0.0, 51.0, 0.0), Region::Up),
            (at(60.0, -61.0, 60.0), Region::Down),
            (at(0.0, 0.0, -51.0), Region::Inward),
            (at(0.0, 0.0, 51.0), Region::Outward),
        ] {
            assert_eq!(cube.region(&palm, Region::Home, 5.0), region, "{palm}");
        }
    }

    #[test]
    fn a_hand_that_trembles_at_a_border_stays_in_its_region() {
        let cube = InteractionBox::default();
        let mut region = Region::Home;
        let mut changes = 0;
        for i in 0..100 {
            let tremor = if i % 2 == 0 { 2.0 } else { -2.0 };
            let next = cube.region(&at(50.0 + tremor, 0.0, 0.0), region, 5.0);
            changes += u32::from(next != region);
            region = next;
        }
        for i in 0..100 {
            let tremor = if i % 2 == 0 { 2.0 } else { -2.0 };
            let next = cube.region(&at(70.0, 70.0 + tremor, 0.0), region, 5.0);
            changes += u32::from(next != region);
            region = next;
        }
        assert_eq!((changes, region), (1, Region::Right));
        assert_eq!(cube.region(&at(44.0, 0.0, 0.0), region, 5.0), Region::Home);
        assert_eq!(cube.region(&at(70.0, 76.0, 0.0), region, 5.0), Region::Up);
    }

    #[test]
    fn a_box_has_a_finite_place_and_size() {
        let origin = Point::origin();
        assert!(
            [0.0, -1.0, f32::NAN, f32::INFINITY]
                .into_iter()
                .all(|e| InteractionBox::new(origin, e).is_none())
        );
        assert!(InteractionBox::new(Point::new(f32::NAN, 0.0, 0.0), 100.0).is_none());
        assert!(InteractionBox::with_edges(origin, Vector::new(1.0, 0.0, 1.0)).is_none());
        let flat = InteractionBox::with_edges(origin, Vector::new(100.0, 10.0, 100.0)).unwrap();
        assert_eq!(flat.region(&Point::new(40.0, 6.0, 0.0), Region::Home, 1.0), Region::Up);
        let small = InteractionBox::new(origin, 20.0).unwrap();
        assert_eq!(small.region(&Point::new(0.0, 0.0, 11.0), Region::Home, 1.0), Region::Outward);
    }
}
