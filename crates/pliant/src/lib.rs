#![doc = include_str!("../../../README.md")]

pub use pliant_cage::{
    BindOptions, BindReport, Binding, BindingFault, BindingFileError, CageError, CageSize, Fingerprint, MeanValue,
    Propagation, Propagator, Prune, RowFault, SavedCage, Simplified, SimplifyOptions, SimplifyReport, Support,
    UNSAFE_MAGNITUDE, simplify,
};
pub use pliant_deform::{
    Acceleration, ArapEnergy, ArapOptions, Constraint, DeformError, Deformer, Details, DualHeights,
    DualLaplacianOptions, EdgeWeightKind, FeatureSize, GlobalSolver, Goals, Handle, HandleFault, ImplicitConstraints,
    ImplicitOptions, ImplicitReport, ImplicitStage, LaplacianOptions, LinearSolver, Method, PointRows, PrepareReport,
    RefineOptions, RefineStep, Refiner, Region, Role, RotationInvariantOptions, SolveReport, Start, StepKind,
    StepTimes, rotation_invariant,
};
pub use pliant_io::picture::{
    Picture, PictureError, PictureOptions, SheetCell, SheetRow, Values, View, colour_map, contact_sheet, render,
    render_values, strip, trim_alike, write_png,
};
pub use pliant_io::{
    Asset, FileError, Format, IoError, ReadReport, can_write, can_write_mesh, read, read_bytes, write, write_atomic,
    write_bytes,
};
pub use pliant_linalg as linalg;
pub use pliant_mesh::metrics::{
    EdgeErrors, HausdorffDistance, HausdorffOptions, IntersectionOptions, OneSidedDistance, SelfIntersections,
    SurfaceDistance, area_change, distances_to_surface, edge_errors, edge_errors_at_vertices, flipped_faces, hausdorff,
    largest_free_stretch, rms_distance, self_intersections, signed_volume, surface_distance, volume_change,
};
pub use pliant_mesh::shapes::creature;
pub use pliant_mesh::{
    Bounds, Cancellable, CleanReport, Cleaned, EdgeWeights, FrameFit, Frames, MeshError, Motion, NormalBuffer,
    Progress, Silent, Similarity, Topology, TriMesh, VertexSet, best_rotation, clean_soup, mixed_voronoi_areas, select,
    shapes, vertex_normals,
};
pub use pliant_session::{
    Autosave, Carried, CoarseStart, Document, DocumentHandle, DocumentStep, Editor, EditorHandle, EditorOptions, Frame,
    Grip, Levels, NoRoom, Ranges, RefineReport, Refinement, SessionError, SurfacePoint, Update, carry_region,
};
pub use pliant_study::{
    Bound, Caged, Calibration, Change, ChangeKind, Checked, ComparePlan, Compared, Comparison, DEFAULT_METHODS, Detail,
    Dragged, Failure, FailureKind, FormatError, GateError, GateReport, ImplicitRow, Iterations, JobEntry, JobFolder,
    JobList, JobResult, Knee, KneeSize, KneeTarget, Machine, Made, Model, ModelError, ModelInfo, NO_CAGE, PAPER_SCENE,
    PICTURE_WORST, Places, Preset, Refusal, ReportError, ReportFormat, Rerun, RerunOptions, ResolvedScene, RowDone,
    RowKey, RowMaker, RowTimes, SUMMARY_BYTES, Scene, SceneError, Schedule, Setting, Spread, Stages, StartFrom, Study,
    StudyError, SweepCase, SweepError, SweepJob, SweepJobs, SweepPlan, SweepReport, SweepRow, SweepSize, SweepSpec,
    Timing, TimingPlan, Tolerance, Tolerances, Unit, Verdict, calibrate, coloured, compare, compare_reports, count,
    draw_pose, equal_time_vertices, merge_jobs, paper_sizes, read_report, sweep, time_stages, timed, usual_view,
};

/// The vector types of positions and transforms.
pub use glam;
