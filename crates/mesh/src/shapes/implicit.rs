//! Surfaces of signed distances as closed meshes: marching tetrahedra on a body-centred cubic lattice.
//!
//! The lattice is the corners and the centres of cubes. Its tetrahedra are spanned by two centres that face each other
//! and an edge of the square between them. Every cut edge belongs to its end nearer to the surface, and all cuts of one
//! lattice node become one vertex (Treece, Prager and Gee, "Regularised marching tetrahedra", 1999): two thirds of the
//! vertices go, and with them the slivers. Where that would tie the surface to itself, a node keeps its cuts apart.

use glam::{DVec3, IVec3};
use rayon::prelude::*;

use super::bones::Body;
use super::lattice::{BLOCK, CUT_REACH, LOOK_REACH, Lattice, MARCH_REACH, NODE_REACH, gather_bits, morton, octants};
use crate::{MeshError, TriMesh};

/// Nodes a block looks at beyond its own, on each side.
const HALO: i32 = 2;
/// Values along one side of a block's store, for corners or for centres.
const SIDE: usize = ((BLOCK + 2 * HALO) / 2 + 1) as usize;
/// In place of the direction of a cut: all cuts of a node together.
const WHOLE: u64 = 15;

/// A node and a direction (or [`WHOLE`]): Morton code of the node, then four bits. Sorted keys are near in space.
type Key = u64;

/// The fourteen neighbours of a node: eight across cube corners, six along the axes.
const NEIGHBOURS: [IVec3; 14] = [
    IVec3::new(-1, -1, -1),
    IVec3::new(1, -1, -1),
    IVec3::new(-1, 1, -1),
    IVec3::new(1, 1, -1),
    IVec3::new(-1, -1, 1),
    IVec3::new(1, -1, 1),
    IVec3::new(-1, 1, 1),
    IVec3::new(1, 1, 1),
    IVec3::new(-2, 0, 0),
    IVec3::new(2, 0, 0),
    IVec3::new(0, -2, 0),
    IVec3::new(0, 2, 0),
    IVec3::new(0, 0, -2),
    IVec3::new(0, 0, 2),
];

/// For each set of inside corners of a tetrahedron (bit k: corner k): how many, and an even permutation that puts the
/// lone corner, or the two inside ones, first.
const CASES: [(usize, [usize; 4]); 16] = [
    (0, [0, 1, 2, 3]),
    (1, [0, 1, 2, 3]),
    (1, [1, 0, 3, 2]),
    (2, [0, 1, 2, 3]),
    (1, [2, 3, 0, 1]),
    (2, [0, 2, 3, 1]),
    (2, [1, 2, 0, 3]),
    (3, [3, 2, 1, 0]),
    (1, [3, 2, 1, 0]),
    (2, [0, 3, 1, 2]),
    (2, [1, 3, 2, 0]),
    (3, [2, 3, 0, 1]),
    (2, [2, 3, 0, 1]),
    (3, [1, 0, 3, 2]),
    (3, [0, 1, 2, 3]),
    (4, [0, 1, 2, 3]),
];

/// A mesh before its vertices are numbered: one block's share.
#[derive(Default)]
struct Piece {
    /// In increasing order.
    vertices: Vec<(Key, DVec3)>,
    triangles: Vec<[Key; 3]>,
}

/// The surface of one body cut by one lattice, before connectivity is made.
pub(super) struct Cut<'a> {
    body: &'a Body,
    lattice: Lattice,
    blocks: Vec<IVec3>,
    pieces: Vec<Piece>,
}

impl<'a> Cut<'a> {
    /// Cuts the surface of `body` by `lattice`: the costly part, done in parallel.
    pub(super) fn new(body: &'a Body, lattice: Lattice) -> Self {
        let blocks = cut_blocks(body, &lattice);
        let pieces = blocks.par_iter().map(|&corner| Block::new(body, &lattice, corner, &[]).piece()).collect();
        Self { body, lattice, blocks, pieces }
    }

    /// Number of vertices that [`Self::mesh`] has, but for the few added where nodes are taken apart.
    pub(super) fn vertex_count(&self) -> usize {
        self.pieces.iter().map(|p| p.vertices.len()).sum()
    }

    /// A closed, manifold, outward oriented mesh; its vertices are near the surface, not on it.
    ///
    /// Vertex order follows a Morton curve through the lattice.
    ///
    /// # Errors
    /// Never for a body that fits the lattice; connectivity is checked all the same.
    pub(super) fn mesh(mut self) -> Result<TriMesh, MeshError> {
        let mut apart: Vec<u64> = Vec::new();
        loop {
            let (mesh, nodes) = assemble(&self.pieces)?;
            let tied = tied_vertices(&mesh);
            if tied.is_empty() {
                return Ok(mesh);
            }
            let mut grown = apart.clone();
            grown.extend(tied.iter().map(|&v| nodes[v as usize]));
            grown.sort_unstable();
            grown.dedup();
            if grown.len() == apart.len() {
                // Taken apart and still tied: their neighbours are to blame.
                let around = |v: &u32| mesh.topology().neighbours(*v as usize).iter().map(|&w| nodes[w as usize]);
                grown.extend(tied.iter().flat_map(around));
                grown.sort_unstable();
                grown.dedup();
            }
            if grown.len() == apart.len() {
                // With every node of a region apart this is plain marching tetrahedra, which is manifold.
                mesh.topology().require_manifold()?;
                return Ok(mesh);
            }
            apart = grown;
            self.take_apart(&apart);
        }
    }

    /// Makes the pieces again of the blocks that look at a node of `apart`.
    fn take_apart(&mut self, apart: &[u64]) {
        // A block looks at its own nodes and two steps beyond the upper sides.
        let lookers = |&code: &u64| {
            let node = IVec3::new(gather_bits(code), gather_bits(code >> 1), gather_bits(code >> 2));
            octants(IVec3::ZERO, 2).map(move |back| morton((node - back) & IVec3::splat(!(BLOCK - 1))))
        };
        let mut touched: Vec<u64> = apart.iter().flat_map(lookers).collect();
        touched.sort_unstable();
        let (body, lattice) = (self.body, &self.lattice);
        self.pieces.par_iter_mut().zip(&self.blocks).for_each(|(piece, &corner)| {
            if touched.binary_search(&morton(corner)).is_ok() {
                *piece = Block::new(body, lattice, corner, apart).piece();
            }
        });
    }
}

/// Corners of the blocks that may meet the surface, in Morton order.
fn cut_blocks(body: &Body, lattice: &Lattice) -> Vec<IVec3> {
    let mut side = lattice.blocks * BLOCK;
    let mut corners = vec![IVec3::ZERO];
    while side > BLOCK {
        side /= 2;
        corners = corners
            .par_iter()
            .flat_map_iter(|&corner| octants(corner, side))
            .filter(|&corner| lattice.may_cut(body, corner, side))
            .collect();
    }
    corners
}

/// The lattice nodes of one block, their distances found when first asked for.
struct Block<'a> {
    /// What of it counts here.
    body: Body,
    lattice: &'a Lattice,
    corner: IVec3,
    /// Morton codes of the nodes whose cuts are kept apart, sorted.
    apart: &'a [u64],
    /// Corners, then centres; NaN: not yet known.
    values: Vec<f64>,
}

impl<'a> Block<'a> {
    fn new(body: &Body, lattice: &'a Lattice, corner: IVec3, apart: &'a [u64]) -> Self {
        let (middle, reach) = lattice.ball(corner, BLOCK, LOOK_REACH);
        Self { body: body.near(middle, reach), lattice, corner, apart, values: vec![f64::NAN; 2 * SIDE * SIDE * SIDE] }
    }

    fn value(&mut self, node: IVec3) -> f64 {
        let local = node - self.corner + IVec3::splat(HALO);
        let at = |x: i32| (x >> 1) as usize;
        let slot = (((local.x & 1) as usize * SIDE + at(local.z)) * SIDE + at(local.y)) * SIDE + at(local.x);
        if self.values[slot].is_nan() {
            self.values[slot] = self.body.distance(self.lattice.position(node));
        }
        self.values[slot]
    }

    /// Visits the cubes near the surface, eight at a time.
    fn piece(&mut self) -> Piece {
        let mut piece = Piece::default();
        for eighth in octants(self.corner, BLOCK / 2) {
            if self.lattice.may_cut(&self.body, eighth, BLOCK / 2) {
                for cube in octants(eighth, 2) {
                    let reach = self.value(cube + IVec3::ONE).abs() / self.lattice.half;
                    if reach <= MARCH_REACH {
                        self.march(cube, &mut piece.triangles);
                    }
                    if reach <= CUT_REACH {
                        self.gather(cube, &mut piece.vertices);
                        self.gather(cube + IVec3::ONE, &mut piece.vertices);
                    }
                }
            }
        }
        piece.vertices.sort_unstable_by_key(|v| v.0);
        piece
    }

    /// The tetrahedra round the upper sides of a cube.
    fn march(&mut self, cube: IVec3, triangles: &mut Vec<[Key; 3]>) {
        const AXES: [IVec3; 3] = [IVec3::X, IVec3::Y, IVec3::Z];
        let centre = cube + IVec3::ONE;
        for axis in 0..3 {
            let (forward, right, up) = (AXES[axis], AXES[(axis + 1) % 3], AXES[(axis + 2) % 3]);
            let middle = centre + forward;
            // Counter-clockwise seen from the far centre, so that every tetrahedron below is positively oriented.
            let ring = [middle - right - up, middle + right - up, middle + right + up, middle - right + up];
            let across = centre + 2 * forward;
            let inside = |block: &mut Self, node| block.value(node) < 0.0;
            let (near, far) = (inside(self, centre), inside(self, across));
            let corners = ring.map(|node| inside(self, node));
            if corners.iter().all(|&c| c == near) && far == near {
                continue;
            }
            for k in 0..4 {
                let next = (k + 1) % 4;
                let mask = [near, far, corners[k], corners[next]];
                let mask = mask.iter().enumerate().map(|(i, &bit)| usize::from(bit) << i).sum::<usize>();
                self.tetrahedron([centre, across, ring[k], ring[next]], CASES[mask], triangles);
            }
        }
    }

    fn tetrahedron(&mut self, nodes: [IVec3; 4], (inside, order): (usize, [usize; 4]), triangles: &mut Vec<[Key; 3]>) {
        let [a, b, c, d] = order.map(|k| nodes[k]);
        // Cuts of one node are one vertex, so many a triangle is an edge or a point.
        let mut push = |u, v, w| {
            if u != v && v != w && w != u {
                triangles.push([u, v, w]);
            }
        };
        match inside {
            1 => push(self.cut(a, b), self.cut(a, c), self.cut(a, d)),
            2 => {
                let (ac, ad, bd, bc) = (self.cut(a, c), self.cut(a, d), self.cut(b, d), self.cut(b, c));
                push(ac, ad, bd);
                push(ac, bd, bc);
            }
            3 => push(self.cut(a, b), self.cut(a, d), self.cut(a, c)),
            _ => {}
        }
    }

    /// The vertex on a cut edge.
    fn cut(&mut self, a: IVec3, b: IVec3) -> Key {
        let (from, to) = if self.owns(a, b) { (a, b) } else { (b, a) };
        let node = morton(from);
        if self.apart.binary_search(&node).is_err() {
            return (node << 4) | WHOLE;
        }
        let direction = NEIGHBOURS.iter().position(|&n| n == to - from).expect("an edge of the lattice");
        (node << 4) | direction as u64
    }

    /// Whether the cut between `a` and `b` belongs to `a`: it is nearer, or as near and earlier.
    fn owns(&mut self, a: IVec3, b: IVec3) -> bool {
        let (near, far) = (self.value(a).abs(), self.value(b).abs());
        near < far || (near == far && a.to_array() < b.to_array())
    }

    /// The vertices of one node: the mean of its cuts, or each of them.
    fn gather(&mut self, node: IVec3, vertices: &mut Vec<(Key, DVec3)>) {
        let here = self.value(node);
        if here.abs() > NODE_REACH * self.lattice.half {
            return;
        }
        let (mut sum, mut cuts) = (DVec3::ZERO, 0.0);
        let apart = self.apart.binary_search(&morton(node)).is_ok();
        for (direction, &step) in NEIGHBOURS.iter().enumerate() {
            let there = self.value(node + step);
            if (here < 0.0) == (there < 0.0) || !self.owns(node, node + step) {
                continue;
            }
            let cut = self.lattice.position(node).lerp(self.lattice.position(node + step), here / (here - there));
            if apart {
                vertices.push(((morton(node) << 4) | direction as u64, cut));
            } else {
                sum += cut;
                cuts += 1.0;
            }
        }
        if cuts > 0.0 {
            vertices.push(((morton(node) << 4) | WHOLE, sum / cuts));
        }
    }
}

/// Numbers the vertices that some triangle uses, in order of their keys; also gives the node of each.
fn assemble(pieces: &[Piece]) -> Result<(TriMesh, Vec<u64>), MeshError> {
    let vertices: Vec<(Key, DVec3)> = pieces.iter().flat_map(|p| p.vertices.iter().copied()).collect();
    // Where each block's vertices begin; blocks are in Morton order, so the whole list is sorted.
    let mut starts = vec![0];
    starts.extend(pieces.iter().scan(0, |end, p| {
        *end += p.vertices.len();
        Some(*end)
    }));
    let number = |key: Key, home: usize| -> u32 {
        let found =
            vertices[starts[home]..starts[home + 1]].binary_search_by_key(&key, |v| v.0).map(|i| starts[home] + i);
        let at = found.or_else(|_| vertices.binary_search_by_key(&key, |v| v.0));
        at.expect("the block that owns a cut node is visited") as u32
    };
    let triangles: Vec<[u32; 3]> = pieces
        .par_iter()
        .enumerate()
        .flat_map_iter(|(home, piece)| piece.triangles.iter().map(move |t| (home, t)))
        .map(|(home, t)| t.map(|key| number(key, home)))
        .collect();
    let mut used = vec![u32::MAX; vertices.len()];
    for &v in triangles.iter().flatten() {
        used[v as usize] = 0;
    }
    for (number, u) in (0..).zip(used.iter_mut().filter(|u| **u == 0)) {
        *u = number;
    }
    let (keys, positions): (Vec<Key>, Vec<DVec3>) =
        vertices.into_iter().zip(&used).filter(|(_, u)| **u != u32::MAX).map(|(v, _)| v).unzip();
    let triangles = triangles.into_iter().map(|t| t.map(|v| used[v as usize])).collect();
    Ok((TriMesh::new(positions, triangles)?, keys.into_iter().map(|key| key >> 4).collect()))
}

/// Vertices at an edge that has not exactly two faces of opposite directions, and those whose faces form more than one fan.
fn tied_vertices(mesh: &TriMesh) -> Vec<u32> {
    let topology = mesh.topology();
    let forward = |face: u32, [a, b]: [u32; 2]| {
        let t = topology.triangles()[face as usize];
        [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]].contains(&[a, b])
    };
    let is_tied = |e: usize, ends: [u32; 2]| match *topology.edge_faces(e) {
        [f, g] => forward(f, ends) == forward(g, ends),
        _ => true,
    };
    let edges = topology.edges().par_iter().enumerate().filter(|(e, ends)| is_tied(*e, **ends));
    let mut tied: Vec<u32> = edges.flat_map_iter(|(_, ends)| *ends).collect();
    tied.par_extend((0..mesh.vertex_count() as u32).into_par_iter().filter(|&v| topology.fan_count(v as usize) != 1));
    tied.sort_unstable();
    tied.dedup();
    tied
}

#[cfg(test)]
mod tests {
    use super::super::bones::{Bone, Limb};
    use super::*;
    use crate::shapes::tests::*;

    fn ball(radius: f64) -> Body {
        Body::new(vec![Limb::new(0.1, 0.0, vec![Bone::new([0.1, 0.2, 0.3], radius, [0.1, 0.2, 0.3], radius)])])
    }

    /// Each corner of a tetrahedron inside or not: the faces that are cut out separate the two, outward oriented.
    #[test]
    fn permutations_are_even_and_put_the_lone_corner_or_the_inside_pair_first() {
        for (mask, (inside, order)) in CASES.iter().enumerate() {
            assert_eq!(mask.count_ones() as usize, *inside);
            let swaps =
                (0..4).flat_map(|i| (i + 1..4).map(move |j| (i, j))).filter(|&(i, j)| order[i] > order[j]).count();
            assert_eq!(swaps % 2, 0);
            let is_inside = order.map(|k| mask >> k & 1 == 1);
            match inside {
                1 => assert_eq!(is_inside, [true, false, false, false]),
                2 => assert_eq!(is_inside, [true, true, false, false]),
                3 => assert_eq!(is_inside, [false, true, true, true]),
                _ => {}
            }
        }
    }

    #[test]
    fn neighbours_come_in_opposite_pairs_of_equal_parity() {
        for n in NEIGHBOURS {
            assert!(NEIGHBOURS.contains(&-n));
            assert!((n & 1) == IVec3::ZERO || (n & 1) == IVec3::ONE);
        }
    }

    /// Vertices lie within a lattice step of a ball, and the volume converges, wherever the lattice lies.
    #[test]
    fn balls_are_closed_and_near_their_size() {
        for (step, shift) in [(0.5, 0.0), (0.31, 0.3), (0.1, 0.77), (0.05, 0.5)] {
            let body = ball(1.0);
            let cut = Cut::new(&body, Lattice::new(&body, step, DVec3::splat(shift)).expect("a fair step"));
            let count = cut.vertex_count();
            let mesh = cut.mesh().expect("a closed surface");
            assert_closed(&mesh, 2);
            assert!(mesh.vertex_count() >= count * 99 / 100, "few vertices are unused");
            for p in &mesh.positions {
                assert!(body.distance(*p).abs() < 0.3 * step);
            }
            let volume = mesh.signed_volume() / (4.0 / 3.0 * std::f64::consts::PI);
            assert!((volume - 1.0).abs() < step, "{step}: {volume}");
        }
    }

    /// Two balls a fraction of a step apart, and a thin rod: hard for merged vertices, but still manifold and closed.
    #[test]
    fn surfaces_finer_than_the_lattice_stay_manifold() {
        for (i, gap) in [0.001, 0.01, 0.05, 0.1].into_iter().enumerate() {
            let balls = [-0.5 - gap, 0.5 + gap].map(|x| Bone::new([x, 0.0, 0.0], 0.5, [x, 0.0, 0.0], 0.5));
            let rod = Bone::new([0.0, 0.6, -1.0], 0.06, [0.3, 0.7, 1.0], 0.04);
            let body = Body::new([balls[0], balls[1], rod].map(|b| Limb::new(0.001, 0.0, vec![b])).to_vec());
            for k in 0..10 {
                let step = 0.09 + 0.013 * f64::from(k) + 0.001 * i as f64;
                let lattice = Lattice::new(&body, step, DVec3::splat(0.1 * f64::from(k))).expect("a fair step");
                let mesh = Cut::new(&body, lattice).mesh().expect("a closed surface");
                let topology = mesh.topology();
                assert_eq!(topology.require_manifold(), Ok(()));
                assert_eq!(topology.require_closed(), Ok(()));
                assert_eq!(topology.require_oriented(), Ok(()));
            }
        }
    }
}
