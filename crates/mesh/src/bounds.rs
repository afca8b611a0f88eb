use glam::DVec3;
use serde::{Deserialize, Serialize};

/// An axis-aligned bounding box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Smallest coordinates.
    pub min: DVec3,
    /// Largest coordinates.
    pub max: DVec3,
}

impl Bounds {
    /// The box round `points`; an empty slice gives a box of size 0 at the origin.
    pub fn of(points: &[DVec3]) -> Self {
        let Some(&first) = points.first() else {
            return Self { min: DVec3::ZERO, max: DVec3::ZERO };
        };
        points.iter().fold(Self { min: first, max: first }, |b, &p| Self { min: b.min.min(p), max: b.max.max(p) })
    }

    /// Middle of the box.
    pub fn centre(&self) -> DVec3 {
        // Halved first: the sum of two large coordinates may overflow.
        0.5 * self.min + 0.5 * self.max
    }

    /// Extent along each axis.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// Its eight corners; bit 0 of the index says whether x is the largest, bit 1 for y, bit 2 for z.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let largest = glam::BVec3::new(i & 1 != 0, i & 2 != 0, i & 4 != 0);
            DVec3::select(largest, self.max, self.min)
        })
    }

    /// Length of the diagonal: the unit in which distances are reported.
    pub fn diagonal(&self) -> f64 {
        self.size().length()
    }

    /// Box coordinates (0 to 1 along each axis) of a point; 0.5 along an axis without extent.
    pub fn to_box(&self, point: DVec3) -> DVec3 {
        let size = self.size();
        let along = |p: f64, lo: f64, extent: f64| if extent > 0.0 { (p - lo) / extent } else { 0.5 };
        DVec3::new(
            along(point.x, self.min.x, size.x),
            along(point.y, self.min.y, size.y),
            along(point.z, self.min.z, size.z),
        )
    }

    /// The point with the given box coordinates.
    pub fn from_box(&self, coordinates: DVec3) -> DVec3 {
        self.min + coordinates * self.size()
    }

    /// Centre and scale of the normal frame: `(p - centre) * scale` has its box centred at 0 with a diagonal of 1.
    ///
    /// A box without extent keeps scale 1.
    pub fn normal_frame(&self) -> (DVec3, f64) {
        let diagonal = self.diagonal();
        (self.centre(), if diagonal > 0.0 { diagonal.recip() } else { 1.0 })
    }
}
