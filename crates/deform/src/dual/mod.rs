//! Deformation by the Laplacian of the dual mesh.
//!
//! - Luo, Liu, Ma, Zhang. *Mesh Editing in ROI with Dual Laplacian.* 2007. The method, within a region of interest.
//! - Au, Tai, Liu, Fu. *Dual Laplacian Editing for Meshes.* IEEE TVCG 12(3), 2006. Where it comes from.
//!
//! A dual vertex is the barycentre of a face, `V~ = D V`, and has three dual neighbours. It is `q + h n`: a point `q` in their plane
//! with barycentric coordinates `w`, and a height along the outward unit normal `n` of that plane. Both `w` and `h` are numbers that
//! no rigid motion changes, and are what is kept: positions minimise `sum_i |v~_i - sum_j w_ij v~_ij - h_i n_i|^2`, after which `n`
//! is taken anew from the dual neighbours, and so on. The matrix `A = (I - W) D` never changes. (Luo et al. have it with the other
//! sign, `l~ = -h n`, Eq. 4.)
//!
//! # Where the papers are silent
//! - **Faces with fewer than three dual neighbours** (at borders and at edges of more than two faces) have no row. Their vertices have
//!   one instead: `v_i - mean_j v_j` over the neighbours is kept, turned by the rotation that best takes the edges at `v_i` from rest
//!   to the last positions.
//! - **`A` need not have the rank** that Luo et al. give it, as `D` need not be of full rank: where the vertices can be coloured with
//!   three colours so that no face has one twice (regular grids, octahedra), moving them by three vectors of sum 0, one a colour, moves no
//!   barycentre, and waves of such patterns cost next to nothing. So the other vertices have such a row too, with the small weight
//!   [`DualLaplacianOptions::primal_weight`], which makes every system positive definite that holds each piece somewhere.
//! - **Dual neighbours that lie nearly on a line** have no plane: the whole vector from their centre to the barycentre is kept, and
//!   turns with the face's surroundings.
//!
//! Rest, and a rigid motion of all that is held, meet all these rows exactly.

mod deformer;
mod equations;
mod options;
mod stencil;

pub use deformer::DualLaplacian;
pub use options::{DualHeights, DualLaplacianOptions, LinearSolver};
