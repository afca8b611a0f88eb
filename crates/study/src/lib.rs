//! Scenes, sweeps and reports.

pub mod scene;
