//! Small shapes for the tests.

#![allow(dead_code)]

pub(crate) mod dense;

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use pliant_deform::arap::{ArapEnergy, ArapOptions, EdgeWeightKind};
use pliant_mesh::{TriMesh, VertexSet};

/// A wavy sheet of `nx` by `ny` quads over `[0, 2] x [0, 1]`, with uneven spacing so that some angles are obtuse.
pub(crate) fn sheet(nx: usize, ny: usize) -> TriMesh {
    let mut positions = Vec::new();
    for j in 0..=ny {
        for i in 0..=nx {
            let (u, v) = (i as f64 / nx as f64, j as f64 / ny as f64);
            let skew = 0.3 * v * u * (1.0 - u);
            positions.push(DVec3::new(
                2.0 * u + skew,
                v * v * (1.5 - 0.5 * v),
                0.1 * (7.0 * u).sin() * (5.0 * v).cos(),
            ));
        }
    }
    TriMesh::new(positions, quads(nx, ny, |i, j| (j * (nx + 1) + i) as u32)).expect("valid")
}

/// A closed tube bent to a ring of radius 1, `nu` quads round the ring and `nv` round the tube, with bumps.
pub(crate) fn torus(nu: usize, nv: usize) -> TriMesh {
    let mut positions = Vec::new();
    for j in 0..nv {
        for i in 0..nu {
            let (u, v) = (TAU * i as f64 / nu as f64, TAU * j as f64 / nv as f64);
            let r = 0.35 + 0.05 * (5.0 * u + 3.0 * v).sin();
            let outwards = DVec3::new(u.cos(), u.sin(), 0.0);
            positions.push(outwards * (1.0 + r * v.cos()) + DVec3::Z * r * v.sin());
        }
    }
    TriMesh::new(positions, quads(nu, nv, |i, j| ((j % nv) * nu + i % nu) as u32)).expect("valid")
}

/// A closed square bar of length 4 along x, `n` quads across and `4 n` along, with capped ends.
pub(crate) fn bar(n: usize) -> TriMesh {
    let steps = [4 * n, n, n];
    let mut numbers = std::collections::BTreeMap::new();
    let mut positions = Vec::new();
    let mut number = |p: [usize; 3]| {
        *numbers.entry(p).or_insert_with(|| {
            positions.push(DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64) / n as f64);
            positions.len() as u32 - 1
        })
    };
    let mut triangles = Vec::new();
    for axis in 0..3 {
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in [0, steps[axis]] {
            let mut at = |i: usize, j: usize| {
                let mut p = [0; 3];
                (p[axis], p[a], p[b]) = (side, i, j);
                number(p)
            };
            for mut t in quads(steps[a], steps[b], &mut at) {
                if side == 0 {
                    t.swap(1, 2);
                }
                triangles.push(t);
            }
        }
    }
    TriMesh::new(positions, triangles).expect("valid")
}

/// The five vertices of a pyramid.
pub(crate) fn pyramid() -> TriMesh {
    let positions = vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.2, 0.0), DVec3::Y, DVec3::new(0.4, 0.5, 0.8)];
    let triangles = vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 2, 1], [0, 3, 2]];
    TriMesh::new(positions, triangles).expect("valid")
}

/// A sphere of octahedral symmetry drawn out and dented, without obtuse cotangent sums: nothing is clamped.
pub(crate) fn acute_ball() -> TriMesh {
    let (rings, around) = (6, 8);
    let mut positions = vec![DVec3::Z * 1.1];
    for j in 1..rings {
        for i in 0..around {
            let theta = PI * j as f64 / rings as f64;
            let phi = TAU * (i as f64 + 0.5 * j as f64) / around as f64;
            let r = 1.0 + 0.05 * (3.0 * phi + theta).sin();
            positions.push(r * DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()));
        }
    }
    positions.push(DVec3::Z * -1.1);
    let at = |j: usize, i: usize| (1 + (j - 1) * around + i % around) as u32;
    let last = positions.len() as u32 - 1;
    let mut triangles = Vec::new();
    for i in 0..around {
        triangles.extend([[0, at(1, i), at(1, i + 1)], [last, at(rings - 1, i + 1), at(rings - 1, i)]]);
        for j in 1..rings - 1 {
            triangles.extend([[at(j, i), at(j + 1, i), at(j, i + 1)], [at(j, i + 1), at(j + 1, i), at(j + 1, i + 1)]]);
        }
    }
    TriMesh::new(positions, triangles).expect("valid")
}

fn quads(nx: usize, ny: usize, mut at: impl FnMut(usize, usize) -> u32) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    for j in 0..ny {
        for i in 0..nx {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    triangles
}

/// The vertices whose box coordinate along x is in `range`.
pub(crate) fn along_x(mesh: &TriMesh, range: std::ops::RangeInclusive<f64>) -> VertexSet {
    let bounds = mesh.bounds();
    VertexSet::where_true(mesh.vertex_count(), |v| range.contains(&bounds.to_box(mesh.positions[v as usize]).x))
}

/// Largest distance between corresponding points.
pub(crate) fn distance(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(p, q)| (*p - *q).length()).fold(0.0, f64::max)
}

/// Every kind of weights with every energy.
pub(crate) fn variants() -> Vec<ArapOptions> {
    let mut all = Vec::new();
    for weights in [EdgeWeightKind::Uniform, EdgeWeightKind::Cotangent] {
        for energy in [ArapEnergy::Spokes, ArapEnergy::SpokesAndRims] {
            all.push(ArapOptions { weights, energy, ..ArapOptions::default() });
        }
    }
    all
}

/// The sum of the angles between consecutive cross-sections of a bar along x, each the best rotation about x between the two.
pub(crate) fn twist(rest: &TriMesh, pose: &[DVec3]) -> f64 {
    let mut stations: Vec<f64> = rest.positions.iter().map(|p| p.x).collect();
    stations.sort_unstable_by(f64::total_cmp);
    stations.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
    let centre = rest.bounds().centre();
    let angle = |x: f64| {
        // Of the best rotation in the plane: sum of cross products over that of scalar products.
        let section = rest.positions.iter().zip(pose).filter(|(p, _)| (p.x - x).abs() < 1e-6);
        let (cross, dot) = section.fold((0.0, 0.0), |(cross, dot), (p, q)| {
            let (p, q) = (*p - centre, *q - centre);
            (cross + p.y * q.z - p.z * q.y, dot + p.y * q.y + p.z * q.z)
        });
        cross.atan2(dot)
    };
    stations.windows(2).map(|pair| (angle(pair[1]) - angle(pair[0]) + 3.0 * PI).rem_euclid(TAU) - PI).sum()
}
