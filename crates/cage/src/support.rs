//! Which cage vertices a point may follow: the nearest ones, but none across a gap between limbs.
//!
//! Rows must change smoothly from one shape vertex to the next, or the seam is an edge error. So the nearest vertices are found
//! exactly, by distance in space, and each has a *trust* between 0 and 1 that fades as the way along the surface gets
//! longer than the straight one. Around a limb the two differ by at most pi / 2, and a little for the detour along edges; to
//! a limb that merely touches, or to another component, the way is far longer or there is none. Rings of the cage's vertices need no
//! trust: they are on the surface.

use std::borrow::Cow;
use std::fmt;
use std::num::NonZero;
use std::ops::ControlFlow;
use std::str::FromStr;

use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use pliant_mesh::Topology;
use pliant_mesh::select::EdgeWalk;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::CageError;

/// Where the nearest cage vertices of [`Prune::Local`](crate::Prune::Local) and [`Prune::Smooth`](crate::Prune::Smooth) are
/// looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Support {
    /// Nearest in space, among those that are also near along the cage's surface: limbs that touch do not pull at each other,
    /// and neither do separate components. The default.
    #[default]
    Surface,
    /// Nearest in space, whatever lies between.
    Space,
    /// Nearest in space, among the vertex of the cage that the point belongs to and those within two edges of it, some 20. Nothing is
    /// searched, so this costs a fifth of [`Self::Surface`] and keeps limbs as well apart, but only rows of a few vertices (6 or so)
    /// change smoothly from point to point: for cages nearly as dense as the shape. A vertex with hundreds within two edges is treated
    /// as by [`Self::Space`].
    Rings,
}

impl fmt::Display for Support {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Surface => "surface",
            Self::Space => "space",
            Self::Rings => "rings",
        })
    }
}

impl FromStr for Support {
    type Err = CageError;

    fn from_str(text: &str) -> Result<Self, CageError> {
        match text {
            "surface" => Ok(Self::Surface),
            "space" => Ok(Self::Space),
            "rings" => Ok(Self::Rings),
            _ => Err(CageError::BadOption { what: "support (surface, space or rings)", found: text.to_owned() }),
        }
    }
}

/// A way along edges up to this many times the straight distance is as good as the straight one; from [`FAR_WAY`] times on the vertex
/// is left out. Graph distances overestimate by about a tenth, so a tube's far side is at 1.7 or so.
const NEAR_WAY: f64 = 2.0;

/// See [`NEAR_WAY`].
const FAR_WAY: f64 = 4.0;

/// Most cage vertices that one owner's points choose from together; beyond, each point asks the tree itself.
const MOST_SHARED: usize = 512;

/// Neighbours of neighbours, each as often as it is met, that are looked at for [`MOST_SHARED`] different ones.
const MOST_GATHERED: usize = 4096;

/// A cage vertex near a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Near {
    pub(crate) distance: f64,
    pub(crate) vertex: u32,
    /// 1 for a full member of the row, 0 (never listed) for one that is near in space only.
    pub(crate) trust: f64,
}

/// Cage vertices and the trust in them, below 1; increasing by vertex.
type Distrusted = Vec<(u32, f32)>;

/// The cage vertices as they lie to each other; shared by the threads.
pub(crate) struct Neighbourhoods<'a> {
    topology: &'a Topology,
    positions: Vec<DVec3>,
    /// Of each point, the cage vertex that stands for where on the surface it lies.
    owners: Vec<u32>,
    tree: Option<ImmutableKdTree<f64, 3>>,
    /// For each cage vertex, those that its points may follow, nearest first; none where they are too many to share.
    near: Vec<Vec<u32>>,
    /// For each cage vertex, those near in space but not along the surface.
    far: Vec<Distrusted>,
    /// The most that rows may have.
    most: usize,
}

/// Whose row is looked for.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Whose {
    /// One of the points, by number and position.
    Point(usize, DVec3),
    /// A cage vertex.
    CageVertex(u32),
}

/// A thread's memory: the candidates of the owner at hand.
#[derive(Default)]
pub(crate) struct Group {
    owner: Option<u32>,
    list: Vec<u32>,
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    /// The owner and the vertices round it, where one of them distrusts some vertex of the list; else empty.
    judges: Vec<u32>,
    /// Row by judge, column by entry of `list`.
    verdicts: Vec<f32>,
    keys: Vec<(u64, u32, u32)>,
}

impl<'a> Neighbourhoods<'a> {
    /// Prepares rows of up to `most` cage vertices for `points`, and for the cage vertices themselves.
    ///
    /// `positions` are the cage's, in the same frame as the points. `owners` says which cage vertex each point belongs to along
    /// the surface (none where the number is no vertex); without it, the nearest one in space.
    pub(crate) fn new(
        topology: &'a Topology,
        positions: &[DVec3],
        points: &[DVec3],
        owners: Option<&[u32]>,
        most: usize,
        support: Support,
    ) -> Self {
        let coordinates: Vec<[f64; 3]> = positions.iter().map(DVec3::to_array).collect();
        let mut made = Self {
            topology,
            tree: ImmutableKdTree::new_from_slice(&coordinates).ok(),
            owners: Vec::new(),
            near: Vec::new(),
            far: Vec::new(),
            positions: positions.to_vec(),
            most,
        };
        let known = |i: usize| owners.map(|owners| owners[i]).filter(|&o| (o as usize) < positions.len());
        made.owners = (0..points.len())
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| known(i).unwrap_or_else(|| made.nearest_vertex(points[i])))
            .collect();
        let mut reach = vec![0.0_f64; positions.len()];
        for (point, &owner) in points.iter().zip(&made.owners) {
            let reach = &mut reach[owner as usize];
            *reach = reach.max(2.0 * point.distance(positions[owner as usize]));
        }
        // Without rows there is nothing to list: the tree is all that is asked.
        if most > 0 {
            match support {
                Support::Rings => made.collect_rings(),
                Support::Surface | Support::Space => made.collect(&mut reach, support),
            }
        }
        made
    }

    /// Fills `near` with what is within two edges. A list that is too long to share is left out: its points ask the tree.
    fn collect_rings(&mut self) {
        let around = |g: u32| self.topology.neighbours(g as usize);
        let ring = |g: u32| {
            let mut list = vec![g];
            for &j in around(g) {
                if list.len() + 1 + around(j).len() > MOST_GATHERED {
                    return Vec::new();
                }
                list.push(j);
                list.extend_from_slice(around(j));
            }
            list.sort_unstable();
            list.dedup();
            list.truncate(if list.len() > MOST_SHARED { 0 } else { list.len() });
            list
        };
        self.near = (0..self.positions.len() as u32).into_par_iter().with_min_len(256).map(ring).collect();
        self.far = vec![Vec::new(); self.positions.len()];
    }

    /// Fills `near` and `far`. `reach` is twice the distance of each cage vertex to its farthest point.
    ///
    /// The distance to the k-th nearest vertex changes by no more than the point does, so all of a point's nearest ones lie
    /// within (k-th distance at the owner) + 2 (distance to the owner) of the owner.
    fn collect(&mut self, reach: &mut [f64], support: Support) {
        // Enough for nearly all, so that the tree is asked once a vertex.
        let guess = self.most.saturating_add(1).saturating_mul(4);
        let ask = |p: &DVec3| self.nearest_in_space(*p, guess.min(MOST_SHARED), f64::INFINITY);
        let around: Vec<Vec<(f64, u32)>> = self.positions.par_iter().map(ask).collect();
        for (reach, around) in reach.iter_mut().zip(&around) {
            let kth = around.get(self.most).or(around.last());
            *reach = (*reach + kth.map_or(0.0, |k| k.0)) * (1.0 + 1e-9);
        }
        let within = |g: u32, radius: f64| match around[g as usize].last() {
            Some(last) if last.0 > radius || around[g as usize].len() == self.positions.len() => {
                let list = &around[g as usize];
                Cow::Borrowed(&list[..list.partition_point(|n| n.0 <= radius)])
            }
            _ => Cow::Owned(self.nearest_in_space(self.positions[g as usize], MOST_SHARED + 1, radius)),
        };
        let made: Vec<(Vec<u32>, Distrusted)> = (0..self.positions.len() as u32)
            .into_par_iter()
            .map_init(
                || Paths::new(self.positions.len()),
                |paths, g| {
                    let list = within(g, reach[g as usize]);
                    let shared = list.len() <= MOST_SHARED && self.most <= MOST_SHARED;
                    let near = if shared { list.iter().map(|n| n.1).collect() } else { Vec::new() };
                    let far = match support {
                        Support::Surface => self.distrusted(g, &within(g, self.widest(g, reach)), paths),
                        Support::Space | Support::Rings => Vec::new(),
                    };
                    (near, far)
                },
            )
            .collect();
        (self.near, self.far) = made.into_iter().unzip();
    }

    /// Within this distance of `g` lies whatever its own points and those of the vertices round it may follow.
    fn widest(&self, g: u32, reach: &[f64]) -> f64 {
        let at = self.positions[g as usize];
        let of = |&o: &u32| reach[o as usize] + at.distance(self.positions[o as usize]);
        self.topology.neighbours(g as usize).iter().map(of).fold(reach[g as usize], f64::max)
    }

    /// The points in the order of their owners: neighbours in it share their candidates.
    pub(crate) fn order(&self) -> Vec<u32> {
        let mut start = vec![0u32; self.positions.len() + 1];
        for &owner in &self.owners {
            start[owner as usize + 1] += 1;
        }
        for o in 0..self.positions.len() {
            start[o + 1] += start[o];
        }
        let mut order = vec![0; self.owners.len()];
        for (i, &owner) in self.owners.iter().enumerate() {
            let at = &mut start[owner as usize];
            order[*at as usize] = i as u32;
            *at += 1;
        }
        order
    }

    /// The nearest cage vertex in space, the lowest number on a tie.
    fn nearest_vertex(&self, point: DVec3) -> u32 {
        self.nearest_in_space(point, 1, f64::INFINITY).first().map_or(0, |n| n.1)
    }

    /// Distance and vertex of the nearest cage vertices within `radius`, nearest first, by number on ties.
    pub(crate) fn nearest_in_space(&self, point: DVec3, most: usize, radius: f64) -> Vec<(f64, u32)> {
        let most = NonZero::new(most.min(self.positions.len()));
        let (Some(tree), Some(most)) = (&self.tree, most) else { return Vec::new() };
        let point = point.to_array();
        let query = tree.query(&point).nearest_n::<SquaredEuclidean<f64>>(most);
        let mut found: Vec<(f64, u32)> = if radius.is_finite() {
            query.within(radius * radius).execute().iter().map(|n| (n.distance.sqrt(), n.item)).collect()
        } else {
            query.execute().iter().map(|n| (n.distance.sqrt(), n.item)).collect()
        };
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found
    }

    /// Those of `targets` (straight distance and vertex, nearest first) that are not near `g` along the surface.
    fn distrusted(&self, g: u32, targets: &[(f64, u32)], paths: &mut Paths) -> Distrusted {
        let targets = &targets[..targets.len().min(MOST_SHARED)];
        paths.measure(self.topology, &self.positions, g, targets);
        let mut far: Distrusted = targets
            .iter()
            .filter_map(|&(straight, j)| {
                let way = paths.distance(j);
                let trust = ((FAR_WAY * straight - way) / ((FAR_WAY - NEAR_WAY) * straight)).clamp(0.0, 1.0);
                // Two vertices in one place are as near as can be if an edge of length 0 joins them, else strangers.
                let trust = if straight > 0.0 { trust } else { f64::from(u8::from(way == 0.0)) };
                (trust < 1.0).then_some((j, trust as f32))
            })
            .collect();
        far.sort_unstable_by_key(|f| f.0);
        far
    }

    /// Lists up to `neighbours` cage vertices that `whose` follows, in `near`, and returns the distance at which they fade to
    /// nothing: that of the first one left out.
    ///
    /// Those left out count by their trust: the list ends where the trusts before it add up to the number of neighbours.
    pub(crate) fn find(&self, whose: Whose, neighbours: usize, group: &mut Group, near: &mut Vec<Near>) -> f64 {
        debug_assert!(neighbours <= self.most);
        let (point, owner) = match whose {
            Whose::Point(i, point) => (point, self.owners[i]),
            Whose::CageVertex(j) => (self.positions[j as usize], j),
        };
        if group.owner != Some(owner) {
            self.enter(owner, group);
        }
        near.clear();
        group.keys.clear();
        if group.list.is_empty() {
            let found = self.nearest_in_space(point, neighbours.saturating_add(1).saturating_mul(4), f64::INFINITY);
            let far = &self.far[owner as usize];
            group.keys.extend(found.iter().map(|&(d, vertex)| ((d * d).to_bits(), vertex, u32::MAX)));
            group.keys.retain(|k| far.binary_search_by_key(&k.1, |f| f.0).is_err());
        }
        for (at, &vertex) in group.list.iter().enumerate() {
            let (x, y, z) = (group.x[at] - point.x, group.y[at] - point.y, group.z[at] - point.z);
            // Non-negative floats order like their bits.
            group.keys.push(((x * x + y * y + z * z).to_bits(), vertex, at as u32));
        }
        let entry = |key: &(u64, u32, u32)| Near { distance: f64::from_bits(key.0).sqrt(), vertex: key.1, trust: 1.0 };
        if group.judges.is_empty() {
            let keys = &mut group.keys[..];
            if keys.len() > neighbours {
                keys.select_nth_unstable(neighbours);
                near.extend(keys[..neighbours].iter().map(entry));
                return f64::from_bits(keys[neighbours].0).sqrt();
            }
            near.extend(keys.iter().map(entry));
            return past_all(near);
        }
        group.keys.sort_unstable();
        let shares = self.shares(point, group);
        let (mut sum, mut last) = (0.0, 0.0);
        for key in &group.keys {
            let judged = group.verdicts.chunks_exact(group.list.len()).zip(&shares);
            let trust = judged.map(|(row, share)| share * f64::from(row[key.2 as usize])).sum::<f64>();
            if trust <= 0.0 {
                continue;
            }
            let found = Near { trust, ..entry(key) };
            if sum + trust > neighbours as f64 {
                // In between, so that the end of the row moves without a jump while trusts change.
                let beyond = neighbours as f64 + 1.0 - sum;
                if beyond <= trust {
                    return last + (found.distance - last) * (beyond / trust);
                }
            }
            sum += trust;
            last = found.distance;
            near.push(found);
        }
        if near.is_empty() {
            // The owner trusts itself; this is a list without it.
            near.push(Near { distance: point.distance(self.positions[owner as usize]), vertex: owner, trust: 1.0 });
        }
        past_all(near)
    }

    /// How much each judge's verdict counts at a point: more for those closer by, so that verdicts change smoothly.
    fn shares(&self, point: DVec3, group: &Group) -> Vec<f64> {
        let distances: Vec<f64> = group.judges.iter().map(|&g| point.distance(self.positions[g as usize])).collect();
        let radius = 1.2 * distances.iter().copied().fold(0.0, f64::max);
        let shares: Vec<f64> =
            distances.iter().map(|d| if radius > 0.0 { (1.0 - d / radius).powi(2) } else { 1.0 }).collect();
        let total: f64 = shares.iter().sum();
        shares.into_iter().map(|s| s / total).collect()
    }

    /// Collects the candidates of an owner's points.
    fn enter(&self, owner: u32, group: &mut Group) {
        group.owner = Some(owner);
        group.list.clone_from(&self.near[owner as usize]);
        group.judges.clear();
        group.verdicts.clear();
        let at = |j: &u32| self.positions[*j as usize];
        (group.x, group.y, group.z) = (
            group.list.iter().map(|j| at(j).x).collect(),
            group.list.iter().map(|j| at(j).y).collect(),
            group.list.iter().map(|j| at(j).z).collect(),
        );
        let judges = || std::iter::once(owner).chain(self.topology.neighbours(owner as usize).iter().copied());
        let verdict = |g: u32, j: u32| {
            let far = &self.far[g as usize];
            far.binary_search_by_key(&j, |f| f.0).map_or(1.0, |at| far[at].1)
        };
        if judges().any(|g| group.list.iter().any(|&j| verdict(g, j) < 1.0)) {
            group.judges.extend(judges());
            for &g in &group.judges {
                group.verdicts.extend(group.list.iter().map(|&j| verdict(g, j)));
            }
        }
    }
}

/// The end of a row that takes all there are: as if the next one were a tenth farther than the last.
pub(crate) fn past_all(near: &[Near]) -> f64 {
    1.1 * near.iter().map(|n| n.distance).fold(0.0, f64::max)
}

/// Shortest ways along the cage's edges from one vertex, in memory kept from search to search.
struct Paths {
    walk: EdgeWalk,
    /// The search that last wanted a vertex.
    wanted: Vec<u32>,
    search: u32,
}

impl Paths {
    fn new(vertices: usize) -> Self {
        Self { walk: EdgeWalk::new(vertices), wanted: vec![0; vertices], search: 0 }
    }

    /// Measures the ways from `source` to `targets` (straight distance and vertex), those longer than [`FAR_WAY`] times the straight
    /// distance excepted.
    fn measure(&mut self, topology: &Topology, positions: &[DVec3], source: u32, targets: &[(f64, u32)]) {
        self.search += 1;
        for &(_, j) in targets {
            self.wanted[j as usize] = self.search;
        }
        // Nobody needs a way longer than this.
        let limit = FAR_WAY * targets.last().map_or(0.0, |t| t.0);
        let mut open = targets.len();
        self.walk.visit(
            topology,
            positions,
            [source],
            limit,
            |_| true,
            |v, _, _| {
                open -= usize::from(self.wanted[v as usize] == self.search);
                if open == 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            },
        );
    }

    /// Infinite where the last search did not come.
    fn distance(&self, vertex: u32) -> f64 {
        self.walk.distance(vertex)
    }
}
