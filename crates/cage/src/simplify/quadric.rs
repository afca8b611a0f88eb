use glam::DVec3;

/// A quadratic form over space: the weighted sum of squared distances to planes (Garland and Heckbert 1997, Section 4).
///
/// Value at `x`: `x^T A x + 2 b^T x + c`, with the symmetric `A` stored by its upper triangle.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    xx: f64,
    xy: f64,
    xz: f64,
    yy: f64,
    yz: f64,
    zz: f64,
    b: DVec3,
    c: f64,
}

impl Quadric {
    /// `weight` times the squared distance to the plane through `point` with unit normal `n`.
    pub(super) fn plane(n: DVec3, point: DVec3, weight: f64) -> Self {
        let d = -n.dot(point);
        let w = weight * n;
        Self {
            xx: w.x * n.x,
            xy: w.x * n.y,
            xz: w.x * n.z,
            yy: w.y * n.y,
            yz: w.y * n.z,
            zz: w.z * n.z,
            b: w * d,
            c: weight * d * d,
        }
    }

    /// `weight` times the squared distance to a point.
    pub(super) fn point(p: DVec3, weight: f64) -> Self {
        Self { xx: weight, yy: weight, zz: weight, b: -weight * p, c: weight * p.length_squared(), ..Self::default() }
    }

    /// Reads both ends (see `Simplifier::read_ahead`).
    #[inline]
    pub(super) fn touch(&self) -> u64 {
        self.xx.to_bits() ^ self.c.to_bits()
    }

    pub(super) fn add(&mut self, o: &Self) {
        self.xx += o.xx;
        self.xy += o.xy;
        self.xz += o.xz;
        self.yy += o.yy;
        self.yz += o.yz;
        self.zz += o.zz;
        self.b += o.b;
        self.c += o.c;
    }

    /// Value at `p`; rounding may make it slightly negative, which counts as 0.
    pub(super) fn at(&self, p: DVec3) -> f64 {
        let ax = self.xx * p.x + self.xy * p.y + self.xz * p.z;
        let ay = self.xy * p.x + self.yy * p.y + self.yz * p.z;
        let az = self.xz * p.x + self.yz * p.y + self.zz * p.z;
        (ax * p.x + ay * p.y + az * p.z + 2.0 * self.b.dot(p) + self.c).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_weighted_squared_distances() {
        let n = DVec3::new(1.0, 2.0, -2.0) / 3.0;
        let on_plane = DVec3::new(0.3, -0.1, 0.7);
        let mut q = Quadric::plane(n, on_plane, 2.0);
        q.add(&Quadric::point(DVec3::Y, 0.5));
        for p in [DVec3::ZERO, DVec3::new(1.0, -4.0, 2.0), on_plane] {
            let expected = 2.0 * n.dot(p - on_plane).powi(2) + 0.5 * p.distance_squared(DVec3::Y);
            assert!((q.at(p) - expected).abs() < 1e-13 * (1.0 + expected));
        }
    }
}
