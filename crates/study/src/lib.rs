//! Scenes, sweeps and reports: the same edit at many cage sizes, and tables of what it cost and how far it was off.
//!
//! This crate judges results; it knows neither how a cage is made nor how a method solves.

pub mod paper;
pub mod report;
pub mod scene;

pub use paper::{PaperSizes, PublishedRow, paper_sizes};
pub use report::{Detail, ModelInfo, ReportError, SweepReport, SweepRow};
pub use scene::{ResolvedHandle, ResolvedScene, Scene, SceneError};
