use pliant_cage::{BindOptions, CageSize};
use pliant_deform::Method;
use serde::{Deserialize, Serialize};

/// How an editor works.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EditorOptions {
    /// Size of the cage. Default: 5 % of the vertices.
    pub cage: CageSize,
    /// How the shape is bound to it.
    pub bind: BindOptions,
    /// What moves the cage.
    pub method: Method,
    /// Solves of a release after the first, each from the pose of the last, until the cage stands still. Default: 20.
    pub release_solves: u32,
    /// From so many free vertices on, a refinement goes through coarser levels of the shape first, each of a quarter of the vertices, down
    /// to the size of the cage ([`Editor::refine`](super::Editor::refine)); `None` for never. Default: 100,000.
    pub levels_from: Option<usize>,
    /// Steps of a refinement in the motions of the cage (`W^T L W` factored once), before the full ones on the shape. Default: 0, as they
    /// cost more than they save (`cargo bench --bench refine`).
    pub subspace_steps: u32,
    /// Memory for steps that can be undone, in bytes; the oldest are dropped beyond it. Default: 512 MiB.
    pub history_bytes: usize,
}

impl Default for EditorOptions {
    fn default() -> Self {
        Self {
            cage: CageSize::Fraction(0.05),
            bind: BindOptions::default(),
            method: Method::default(),
            release_solves: 20,
            levels_from: Some(100_000),
            subspace_steps: 0,
            history_bytes: 512 << 20,
        }
    }
}
