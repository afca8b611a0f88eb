use glam::DVec3;
use pliant_mesh::Bounds;

use super::{Scene, SceneHandle, SceneMotion, SceneRegion, SceneRotation};

/// Share of the longest axis that each end takes.
const END: f64 = 0.1;

/// How far the moving end goes sideways, in fractions of the diagonal.
const SHIFT: f64 = 0.1;

/// How far the moving end turns.
const DEGREES: f64 = 30.0;

impl Scene {
    /// The scene `auto`, a bend that fits any shape with the given bounding box.
    ///
    /// The lowest tenth along the box's longest axis is held. The highest tenth turns by 30 degrees about the shortest
    /// axis (pivot: the centre of the bounding box of the vertices it holds) and moves by a tenth of the diagonal
    /// along the remaining axis, to the side the turn tips it to, as the end of a bent bar does. Among axes of equal
    /// extent the first counts as the longest and the last as the shortest.
    pub fn auto(bounds: &Bounds) -> Self {
        let size = bounds.size();
        let mut order = [0, 1, 2];
        // A stable sort, so that ties keep the order x, y, z.
        order.sort_by(|&a, &b| size[b].total_cmp(&size[a]));
        let (long, turn) = (order[0], DVec3::AXES[order[2]]);
        // A right-handed turn about `turn` moves the tip of the long axis towards `turn x long`.
        let sideways = turn.cross(DVec3::AXES[long]);
        let (mut low, mut high) = ([None; 3], [None; 3]);
        low[long] = Some(END);
        high[long] = Some(1.0 - END);
        Self {
            name: "auto".to_owned(),
            description:
                "The lowest tenth along the longest axis is held; the highest tenth turns by 30 degrees about \
                          the shortest axis and moves sideways by a tenth of the diagonal."
                    .to_owned(),
            shape: None,
            method: None,
            handles: vec![
                SceneHandle {
                    name: "low end".to_owned(),
                    region: SceneRegion::Box { min: [None; 3], max: low },
                    motion: None,
                },
                SceneHandle {
                    name: "high end".to_owned(),
                    region: SceneRegion::Box { min: high, max: [None; 3] },
                    motion: Some(SceneMotion {
                        rotate: Some(SceneRotation { axis: turn, degrees: DEGREES }),
                        translate: SHIFT * sideways,
                        ..SceneMotion::default()
                    }),
                },
            ],
        }
    }
}
