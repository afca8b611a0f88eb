//! The body-centred cubic lattice: where its nodes lie, how they are numbered, and how far one must look.

use glam::{DVec3, IVec3};

use super::bones::Body;
use crate::MeshError;

/// Side of a block of cubes in lattice coordinates. Those are even for corners and odd for centres, all three alike; a
/// cube is 2 wide.
pub(super) const BLOCK: i32 = 8;
/// Distances have slope 1 and no edge is longer than 2 half cubes, so the nearer end of a cut edge is at most 1 away from
/// the surface. (All reaches are in half cubes, with a little more for rounding.)
pub(super) const NODE_REACH: f64 = 1.0 + 1e-6;
/// The centre of a cube whose tetrahedra are cut is at most the longest edge away: all their corners are that near to it.
pub(super) const MARCH_REACH: f64 = 2.0 + 1e-6;
/// The centre of a cube is this near to the surface if its corner or itself is the nearer end of a cut edge:
/// `1 + sqrt(3)`, which covers the march too.
pub(super) const CUT_REACH: f64 = 2.732_051;
/// No node that a cube looks at is farther from its centre: a corner of it and an edge on, `sqrt(3) + 2`.
pub(super) const LOOK_REACH: f64 = 3.732_051;

/// Where the lattice lies in space.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lattice {
    origin: DVec3,
    /// Half a cube's side.
    pub(super) half: f64,
    /// Blocks along the longest side, a power of two.
    pub(super) blocks: i32,
}

impl Lattice {
    /// A lattice of cubes of side `step` that holds the body, shifted by fractions of a cube.
    ///
    /// # Errors
    /// The step is so small that nodes cannot be numbered.
    pub(super) fn new(body: &Body, step: f64, shift: DVec3) -> Result<Self, MeshError> {
        let (bounds, half) = (body.bounds(), 0.5 * step);
        let sides = bounds.size().max_element() / step + 4.0;
        let blocks = (sides * 2.0 / f64::from(BLOCK)).ceil().max(1.0);
        // 20 bits for each coordinate leave four for the direction.
        if !(step > 0.0 && blocks * f64::from(BLOCK) < f64::from(1 << 19)) {
            return Err(MeshError::BadParameter {
                what: "lattice step",
                expected: "a positive number, not far below the size".to_owned(),
                found: step.to_string(),
            });
        }
        // Checked above: below 2^19, and so is the next power of two or equal to it.
        let blocks = (blocks as u32).next_power_of_two() as i32;
        Ok(Self { origin: bounds.min - (DVec3::splat(2.0) - shift) * step, half, blocks })
    }

    pub(super) fn position(&self, node: IVec3) -> DVec3 {
        self.origin + self.half * node.as_dvec3()
    }

    /// Whether the surface may cut an edge that some cube of a box of cubes looks at.
    pub(super) fn may_cut(&self, body: &Body, corner: IVec3, side: i32) -> bool {
        let (middle, reach) = self.ball(corner, side, CUT_REACH);
        body.distance(middle).abs() <= reach
    }

    /// Centre and radius of a ball that holds everything within `reach` (in half cubes) of the centres of the cubes of a
    /// box from `corner`, `side` wide (in lattice coordinates).
    pub(super) fn ball(&self, corner: IVec3, side: i32, reach: f64) -> (DVec3, f64) {
        let middle = self.position(corner) + DVec3::splat(0.5 * self.half * f64::from(side));
        (middle, self.half * (f64::from(side / 2 - 1) * 3.0_f64.sqrt() + reach))
    }
}

/// Spreads the low 20 bits so that two zeros follow each.
fn spread(x: i32) -> u64 {
    let mut x = (x as u64) & 0xf_ffff;
    x = (x | (x << 32)) & 0x001f_0000_0000_ffff;
    x = (x | (x << 16)) & 0x001f_0000_ff00_00ff;
    x = (x | (x << 8)) & 0x100f_00f0_0f00_f00f;
    x = (x | (x << 4)) & 0x10c3_0c30_c30c_30c3;
    (x | (x << 2)) & 0x1249_2492_4924_9249
}

/// Takes every third bit: undoes [`spread`].
pub(super) fn gather_bits(code: u64) -> i32 {
    (0..20).map(|k| ((code >> (3 * k)) & 1) << k).sum::<u64>() as i32
}

pub(super) fn morton(node: IVec3) -> u64 {
    spread(node.x) | (spread(node.y) << 1) | (spread(node.z) << 2)
}

/// The eight cubes of the given side from `corner`, in Morton order.
pub(super) fn octants(corner: IVec3, side: i32) -> impl Iterator<Item = IVec3> {
    (0..8).map(move |k| corner + side * IVec3::new(k & 1, (k >> 1) & 1, k >> 2))
}

#[cfg(test)]
mod tests {
    use super::super::bones::{Bone, Limb};
    use super::*;

    #[test]
    fn keys_follow_the_blocks() {
        let corners: Vec<u64> = octants(IVec3::ZERO, BLOCK).flat_map(|c| octants(c, BLOCK / 2)).map(morton).collect();
        assert!(corners.is_sorted());
        assert!([0, 1, 0x5_4321, 0xf_ffff].iter().all(|&x| gather_bits(spread(x)) == x));
        assert_eq!(morton(IVec3::new(0xf_ffff, 0, 0)), 0x1249_2492_4924_9249 & ((1 << 60) - 1));
    }

    #[test]
    fn steps_that_cannot_be_numbered_are_refused() {
        let ball = Body::new(vec![Limb::new(0.1, 0.0, vec![Bone::new([0.0; 3], 1.0, [0.0; 3], 1.0)])]);
        for step in [0.0, 1e-9, f64::NAN] {
            assert!(Lattice::new(&ball, step, DVec3::ZERO).is_err());
        }
    }
}
