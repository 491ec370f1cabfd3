//! Corners fitted to the best scored points, and strung together to chains (ours; the paper does not say how edge points are
//! ordered).

pub mod chain;
pub mod corner;
pub mod loops;
pub mod obstruction;
pub mod splice;
pub mod step;
pub mod support;

use nalgebra::{Point3, Vector3};

/// Two faces that meet in a line, concave as the camera sees them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InsideCorner {
    /// Foot of the candidate on the line, mm.
    pub position: Point3<f32>,
    /// Unit direction of the line; its sign means nothing.
    pub direction: Vector3<f32>,
    /// Unit normals of the faces, toward the camera.
    pub faces: [Vector3<f32>; 2],
    /// Share of the surrounding points that lie on the faces.
    pub share: f32,
}

/// An ordered run of corners. The first of `faces` is the same face all along.
#[derive(Debug, Clone, Default)]
pub struct Chain {
    /// In order.
    pub links: Vec<ChainLink>,
    /// Whether the last is followed by the first.
    pub closed: bool,
    /// Number of corners that support it.
    pub support: usize,
    /// Mean share of the points about its corners that lie on the two faces.
    pub share: f32,
}

/// One averaged corner of a chain.
#[derive(Debug, Clone, Copy)]
pub struct ChainLink {
    /// On the line, mm.
    pub position: Point3<f32>,
    /// Unit, along the chain.
    pub direction: Vector3<f32>,
    /// Unit normals of the faces.
    pub faces: [Vector3<f32>; 2],
}

impl Chain {
    /// Goes on as another; where, its links do not tell.
    pub fn take(&mut self, other: Self) {
        let support = self.support + other.support;
        let part = |chain: &Self| chain.share * chain.support as f32 / support.max(1) as f32;
        self.share = part(self) + part(&other);
        self.support = support;
        self.links.extend(other.links);
    }

    /// Length along the links, mm.
    pub fn length_mm(&self) -> f32 {
        self.links.windows(2).map(|w| (w[1].position - w[0].position).norm()).sum()
    }
}

impl From<&InsideCorner> for ChainLink {
    fn from(corner: &InsideCorner) -> Self {
        Self { position: corner.position, direction: corner.direction, faces: corner.faces }
    }
}
