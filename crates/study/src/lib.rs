//! Scenes, sweeps and reports: the same edit at many cage sizes, and tables of what it cost and how far it was off.
//!
//! [`Study`] takes a shape and a scene through cage, binding, drag and propagation; [`sweep()`] does it for many settings;
//! [`SweepReport`] tells of it. This crate judges results; it knows neither how a cage is made nor how a method solves.

mod calibrate;
mod compare;
mod error;
pub mod gate;
mod machine;
mod measure;
mod model;
pub mod paper;
mod pictures;
mod pipeline;
mod refined;
pub mod report;
pub mod scene;
mod settings;
mod stages;
mod sweep;
mod timing;

pub use calibrate::calibrate;
pub use compare::{ComparePlan, Compared, DEFAULT_METHODS, compare};
pub use error::StudyError;
pub use gate::{
    Change, ChangeKind, Checked, GateError, GateReport, Places, Rerun, RerunOptions, Tolerance, Tolerances, Unit,
    Verdict, compare_reports, read_report,
};
pub use model::{Model, ModelError};
pub use paper::{PaperSizes, PublishedRow, paper_sizes};
pub use pictures::{coloured, draw_pose, usual_view};
pub use pipeline::{Bound, Caged, Dragged, Study, count};
pub use refined::CONVERGED_STEPS;
pub use report::{
    Calibration, Comparison, Detail, Failure, FailureKind, FormatError, ImplicitRow, Knee, KneeSize, KneeTarget,
    Machine, ModelInfo, NO_CAGE, PICTURE_WORST, Refusal, ReportError, ReportFormat, RowKey, RowTimes, SUMMARY_BYTES,
    Spread, SweepReport, SweepRow,
};
pub use scene::{ResolvedHandle, ResolvedScene, Scene, SceneError};
pub use settings::{CONVERGED, Iterations, Schedule, Setting, StartFrom, SweepSize, equal_time_vertices};
pub use stages::{Stages, timed};
pub use sweep::{
    JobEntry, JobFolder, JobList, JobResult, Made, PAPER_SCENE, Preset, RowDone, RowMaker, SweepCase, SweepError,
    SweepJob, SweepJobs, SweepPlan, SweepSpec, merge_jobs, sweep,
};
pub use timing::{Timing, TimingPlan, time_stages};
