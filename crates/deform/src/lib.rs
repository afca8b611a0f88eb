//! Surface deformation: from handles and goals to positions.
//!
//! # Words
//! - **region of interest (ROI)**: the vertices an edit may move. All others are fixed.
//! - **handle**: vertices of the region that are led together to a goal, hard (exactly) or soft (by least squares).
//! - **row**: a point between vertices, as weights that sum to 1, held as a handle's vertices are ([`PointRows`]). Vertices stay free.
//! - **free**: vertices of the region in no handle; they are solved for.
//! - **fixed**: vertices outside the region; they stay where the pose has them, bit for bit.
//! - **anchor**: a handle whose goal is the identity.
//! - **goal**: the similarity transform that takes a handle's rest positions to where they should be.
//! - **rest**: the undeformed shape, whose details a method tries to keep.
//!
//! # Use
//! A [`Region`] says who is free, a [`Method`] is prepared for it once, and the [`Deformer`] solves for goals as often
//! as they change. The matrix depends on the rest shape and on who is free, the right-hand side only on where handles
//! go; every method is cut there. `positions` is the only state, so the last pose is the warm start.
//!
//! ```
//! use glam::DVec3;
//! use pliant_deform::{Goals, Handle, Method, Region};
//! use pliant_mesh::{Similarity, TriMesh, VertexSet};
//!
//! // A strip of six triangles along x.
//! let positions: Vec<DVec3> = (0..8).map(|i| DVec3::new(f64::from(i / 2), f64::from(i % 2), 0.0)).collect();
//! let triangles = (0..6).map(|i| if i % 2 == 0 { [i, i + 2, i + 1] } else { [i, i + 1, i + 2] }).collect();
//! let rest = TriMesh::new(positions, triangles)?;
//! // Its left end is an anchor, its right end is turned by a quarter.
//! let ends = [[0, 1], [6, 7]].map(|end| Handle::hard(VertexSet::from_iter(end)));
//! let region = Region::new(8, &VertexSet::all(8), &ends)?;
//! let mut deformer = Method::default().prepare(&rest, &region)?;
//!
//! let mut pose = rest.positions.clone();
//! let turn = Similarity::about(rest.positions[6], DVec3::Z, std::f64::consts::FRAC_PI_2, 1.0);
//! deformer.solve(&Goals::new(vec![Similarity::IDENTITY, turn]), &mut pose)?;
//! assert_eq!(pose[0], rest.positions[0]);
//! assert_eq!(pose[7], turn.apply(rest.positions[7]));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod arap;
pub mod dual;
mod error;
mod fit;
mod frame;
mod goals;
pub mod implicit;
pub mod laplacian;
mod method;
mod operators;
mod patch;
mod points;
pub mod refine;
mod region;
pub mod rotation_invariant;
mod text;

pub use arap::{Acceleration, ArapEnergy, ArapOptions, EdgeWeightKind, Start};
pub use dual::{DualHeights, DualLaplacianOptions, LinearSolver};
pub use error::{DeformError, HandleFault};
pub use goals::Goals;
pub use implicit::{FeatureSize, ImplicitConstraints, ImplicitOptions, ImplicitReport, ImplicitStage};
pub use laplacian::{Details, LaplacianOptions};
pub use method::{Deformer, Method, PrepareReport, SolveReport, StepTimes};
pub use points::PointRows;
pub use refine::{GlobalSolver, RefineOptions, RefineStep, Refiner, StepKind};
pub use region::{Constraint, Handle, Region, Role};
pub use rotation_invariant::RotationInvariantOptions;
