//! Whether two triangles meet, decided exactly: by the signs of determinants alone, which the crate `robust` gets right for any positions
//! (Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997).
//!
//! Triangles are closed sets with an area; those without one ([`flat_axis`]) are not for these functions.

use glam::DVec3;
use robust::{Coord, Coord3D, orient2d, orient3d};

pub(super) type Triangle = [DVec3; 3];

/// On which side of the plane through `a`, `b` and `c` the point `d` is: 1, 0 or -1. Even permutations of the four change nothing.
fn side(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> i8 {
    let [a, b, c, d] = [a, b, c, d].map(|p| Coord3D { x: p.x, y: p.y, z: p.z });
    sign(orient3d(a, b, c, d))
}

/// Which way the path from `a` over `b` to `c` turns, seen along an axis: 1, 0 or -1.
fn turn(axis: usize, a: DVec3, b: DVec3, c: DVec3) -> i8 {
    let (x, y) = ((axis + 1) % 3, (axis + 2) % 3);
    let [a, b, c] = [a, b, c].map(|p| Coord { x: p[x], y: p[y] });
    sign(orient2d(a, b, c))
}

fn sign(of: f64) -> i8 {
    i8::from(of > 0.0) - i8::from(of < 0.0)
}

/// An axis along which the triangle is seen to have an area, the one that it is about widest along; `None` if it has none.
pub(super) fn flat_axis([a, b, c]: Triangle) -> Option<usize> {
    let widest = (b - a).cross(c - a).abs().max_position();
    (0..3).map(|k| (widest + k) % 3).find(|&axis| turn(axis, a, b, c) != 0)
}

/// Whether two triangles have a point in common. `axis` is one along which `s` is seen to have an area.
///
/// By the intervals in which they meet the line that their planes share (Guigue and Devillers, "Fast and Robust Triangle-Triangle Overlap
/// Test Using Orientation Predicates", 2003), at the cost of at most eight determinants.
pub(super) fn meet(mut s: Triangle, mut t: Triangle, axis: usize) -> bool {
    let above = s.map(|p| side(t[0], t[1], t[2], p));
    if are_apart(above) {
        return false;
    }
    let across = t.map(|p| side(s[0], s[1], s[2], p));
    if are_apart(across) {
        return false;
    }
    let (Some((i, s_is_above)), Some((j, t_is_above))) = (lone(above), lone(across)) else {
        return meet_in_plane(s, t, axis);
    };
    s.rotate_left(i);
    t.rotate_left(j);
    // Both planes are turned so that the corner that is alone is above the other's.
    if !s_is_above {
        t.swap(1, 2);
    }
    if !t_is_above {
        s.swap(1, 2);
    }
    side(s[0], s[1], t[0], t[1]) <= 0 && side(s[0], s[2], t[0], t[2]) >= 0
}

/// Whether three points lie strictly on the same side.
fn are_apart([a, b, c]: [i8; 3]) -> bool {
    a == b && b == c && a != 0
}

/// The corner that the plane parts from both others (which may lie in it, or the corner alone), and whether it is the one above; `None`
/// if all lie in the plane.
fn lone(above: [i8; 3]) -> Option<(usize, bool)> {
    (0..3).find_map(|k| {
        let [own, next, last] = [0, 1, 2].map(|i| above[(k + i) % 3]);
        let is_alone = |sign: i8| next * sign <= 0 && last * sign <= 0;
        match own {
            0 => (next == last && next != 0).then_some((k, next < 0)),
            _ => is_alone(own).then_some((k, own > 0)),
        }
    })
}

/// [`meet`] for triangles of one plane: they do unless all of one is beyond an edge of the other.
fn meet_in_plane(s: Triangle, t: Triangle, axis: usize) -> bool {
    let has_edge_between = |s: Triangle, t: Triangle| {
        let inner = turn(axis, s[0], s[1], s[2]);
        (0..3).any(|k| t.iter().all(|p| turn(axis, s[k], s[(k + 1) % 3], *p) == -inner))
    };
    !has_edge_between(s, t) && !has_edge_between(t, s)
}

/// Whether triangles with the first corner in common have another point in common. `axis` is one along which `s` is seen to have an area.
///
/// If so, the edge opposite to that corner in one of them meets the other.
pub(super) fn meet_beyond_corner(s: Triangle, t: Triangle, axis: usize) -> bool {
    let ([v, q, r], [_, b, c]) = (s, t);
    let [above_q, above_r] = [q, r].map(|p| side(v, b, c, p));
    if above_q == above_r && above_q != 0 {
        return false;
    }
    let [above_b, above_c] = [b, c].map(|p| side(v, q, r, p));
    if above_b == above_c {
        // Where both are in the plane of `s`, the angles at the corner decide.
        return above_b == 0 && angles_meet(s, t, axis);
    }
    // The line through `q` and `r` passes the edges of `t` on the sides `above_b`, `across` and `-above_c`; likewise that through `b` and `c`.
    let across = side(q, r, b, c);
    let passes = |sides: [i8; 3]| sides.iter().all(|s| *s >= 0) || sides.iter().all(|s| *s <= 0);
    passes([above_b, across, -above_c]) || passes([above_q, across, -above_r])
}

/// Whether triangles of one plane with the first corner in common have a direction from there in common: the first or last of one of them.
fn angles_meet(s: Triangle, t: Triangle, axis: usize) -> bool {
    let holds = |[v, q, r]: Triangle, p: DVec3| {
        let inner = turn(axis, v, q, r);
        turn(axis, v, q, p) * inner >= 0 && turn(axis, v, p, r) * inner >= 0
    };
    holds(s, t[1]) || holds(s, t[2]) || holds(t, s[1]) || holds(t, s[2])
}

/// Whether triangles with the first two corners in common have a point beyond that edge in common: whether the third corners `a` and `b` lie
/// in one plane with it, and on the same side. `axis` is one along which the triangle of `a` is seen to have an area.
pub(super) fn are_folded([u, v]: [DVec3; 2], a: DVec3, b: DVec3, axis: usize) -> bool {
    // The cheaper sign first: it tells nearly all faces of flat parts.
    turn(axis, u, v, a) == turn(axis, u, v, b) && side(u, v, a, b) == 0
}
