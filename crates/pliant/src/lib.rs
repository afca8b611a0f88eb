#![doc = include_str!("../../../README.md")]

pub use pliant_cage::{
    BindOptions, BindReport, Binding, CageError, CageSize, MeanValue, Propagation, Propagator, Prune, Simplified,
    SimplifyOptions, SimplifyReport, Support, UNSAFE_MAGNITUDE, simplify,
};
pub use pliant_deform::{
    Acceleration, ArapEnergy, ArapOptions, Constraint, DeformError, Deformer, Details, DualHeights,
    DualLaplacianOptions, EdgeWeightKind, FeatureSize, GlobalSolver, Goals, Handle, HandleFault, ImplicitConstraints,
    ImplicitOptions, ImplicitStage, LaplacianOptions, LinearSolver, Method, PrepareReport, RefineOptions, RefineStep,
    Refiner, Region, Role, RotationInvariantOptions, SolveReport, Start, StepKind, StepTimes, rotation_invariant,
};
pub use pliant_io::picture::{
    Picture, PictureError, PictureOptions, Values, View, colour_map, render, render_values, strip, trim_alike,
    write_png,
};
pub use pliant_io::{
    Asset, Format, IoError, ReadReport, can_write, can_write_mesh, read, read_bytes, write, write_atomic, write_bytes,
};
pub use pliant_linalg as linalg;
pub use pliant_mesh::metrics::{
    EdgeErrors, SurfaceDistance, distances_to_surface, edge_errors, largest_free_stretch, surface_distance,
};
pub use pliant_mesh::shapes::creature;
pub use pliant_mesh::{
    Bounds, Cancellable, CleanReport, Cleaned, EdgeWeights, FrameFit, Frames, MeshError, Motion, NormalBuffer,
    Progress, Silent, Similarity, Topology, TriMesh, VertexSet, best_rotation, clean_soup, mixed_voronoi_areas, select,
    shapes, vertex_normals,
};
pub use pliant_session::{Carried, CoarseStart, Levels, NoRoom, carry_region};
pub use pliant_study::{
    Bound, Caged, Detail, Dragged, Iterations, ModelInfo, PAPER_SCENE, ReportError, ResolvedScene, Scene, SceneError,
    Schedule, Stages, StartFrom, Study, StudyError, SweepPlan, SweepReport, SweepRow, SweepSize, Timing, TimingPlan,
    count, paper_sizes, sweep, time_stages, timed,
};

/// The vector types of positions and transforms.
pub use glam;
