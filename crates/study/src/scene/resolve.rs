//! From a scene to vertices and motions of one shape.

use glam::DVec3;
use pliant_deform::Goals;
use pliant_mesh::{Bounds, Motion, Similarity, TriMesh, VertexSet, select};

use super::{Scene, SceneError, SceneMotion, SceneRegion};

/// A scene on one shape: which vertices each handle holds and where they go, in units of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct ResolvedScene {
    /// The scene's name.
    pub name: String,
    /// The handles in the scene's order; no vertex belongs to two.
    pub handles: Vec<ResolvedHandle>,
}

/// A handle on one shape.
#[derive(Debug, Clone, PartialEq)]
pub struct ResolvedHandle {
    /// The handle's name.
    pub name: String,
    /// Its vertices on the shape; at least one.
    pub vertices: VertexSet,
    /// Where they go; `None` holds them where they are.
    pub motion: Option<Motion>,
}

impl ResolvedScene {
    /// Where each handle is when the share `t` of its motion is done, 0 at rest and 1 at the end.
    ///
    /// One transform per handle in order, the identity for a held one. Angles and translations grow linearly with `t`
    /// and scales geometrically ([`Motion::at`]), so half of a turn by 720 degrees is a full turn. Other `t` extrapolate.
    pub fn goals(&self, t: f64) -> Vec<Similarity> {
        self.handles.iter().map(|handle| handle.motion.map_or(Similarity::IDENTITY, |motion| motion.at(t))).collect()
    }

    /// [`Self::goals`] with the turns they are come by, for methods that tell a turn by 720 degrees from none.
    pub fn goals_with_turns(&self, t: f64) -> Goals {
        let turns = self.handles.iter().map(|handle| handle.motion.map_or(DVec3::ZERO, |motion| motion.turn_at(t)));
        Goals::with_turns(self.goals(t), turns.collect())
    }

    /// For each of the shape's `vertex_count` vertices, the position of its handle in [`Self::handles`], if it has one.
    ///
    /// # Panics
    /// If `vertex_count` is below that of the shape the scene was resolved on.
    pub fn handle_of_vertex(&self, vertex_count: usize) -> Vec<Option<usize>> {
        let mut owner = vec![None; vertex_count];
        for (k, handle) in self.handles.iter().enumerate() {
            handle.vertices.iter().for_each(|v| owner[v as usize] = Some(k));
        }
        owner
    }
}

impl Scene {
    /// Finds each handle's vertices and motion on a shape.
    ///
    /// A vertex in several regions belongs to the first handle. Costs a pass over the vertices per region.
    ///
    /// # Errors
    /// As [`Scene::check`]; the shape's bounding box has no extent; or a handle has no vertex on this shape.
    pub fn resolve(&self, shape: &TriMesh) -> Result<ResolvedScene, SceneError> {
        self.check()?;
        let on = Measure::new(shape);
        if !(on.diagonal > 0.0 && on.diagonal.is_finite()) {
            return Err(SceneError::NoExtent { scene: self.name.clone(), diagonal: on.diagonal });
        }
        let mut taken = vec![false; shape.vertex_count()];
        let mut handles = Vec::with_capacity(self.handles.len());
        for handle in &self.handles {
            // Vertices without faces belong to nobody.
            let on_surface = |v: &u32| !shape.topology().vertex_faces(*v as usize).is_empty();
            let region: VertexSet = on.vertices_in(&handle.region).iter().filter(on_surface).collect();
            let vertices: VertexSet = region.iter().filter(|&v| !taken[v as usize]).collect();
            if vertices.is_empty() {
                let reason = match region.is_empty() {
                    true => "its region holds no vertex of this shape",
                    false => "every vertex in its region already belongs to an earlier handle",
                };
                return Err(SceneError::EmptyHandle { scene: self.name.clone(), handle: handle.name.clone(), reason });
            }
            vertices.iter().for_each(|v| taken[v as usize] = true);
            let motion = handle.motion.map(|motion| on.motion(&motion, &vertices));
            if let Some(motion) = motion.filter(|motion| !motion.at(1.0).is_valid()) {
                return Err(SceneError::BadValue {
                    scene: self.name.clone(),
                    handle: Some(handle.name.clone()),
                    what: "motion".to_owned(),
                    expected: "finite in units of the model",
                    found: format!("{:?}", motion.at(1.0)),
                });
            }
            handles.push(ResolvedHandle { name: handle.name.clone(), vertices, motion });
        }
        Ok(ResolvedScene { name: self.name.clone(), handles })
    }
}

/// A shape with the box that its scene coordinates are measured by.
struct Measure<'a> {
    shape: &'a TriMesh,
    bounds: Bounds,
    diagonal: f64,
    /// Positions in box coordinates.
    in_box: Vec<DVec3>,
}

impl<'a> Measure<'a> {
    fn new(shape: &'a TriMesh) -> Self {
        let bounds = shape.bounds();
        let in_box = shape.positions.iter().map(|&p| bounds.to_box(p)).collect();
        Self { shape, bounds, diagonal: bounds.diagonal(), in_box }
    }

    fn vertices_in(&self, region: &SceneRegion) -> VertexSet {
        let positions = &self.shape.positions;
        match region {
            SceneRegion::Box { min, max } => {
                let corner = |side: &[Option<f64>; 3], free: f64| DVec3::from_array(side.map(|x| x.unwrap_or(free)));
                let limits = Bounds { min: corner(min, f64::NEG_INFINITY), max: corner(max, f64::INFINITY) };
                select::in_box(&self.in_box, &limits)
            }
            SceneRegion::Sphere { centre, radius } => {
                select::in_sphere(positions, self.bounds.from_box(*centre), radius * self.diagonal)
            }
            SceneRegion::HalfSpace { point, normal } => {
                select::in_half_space(positions, self.bounds.from_box(*point), unit(*normal))
            }
            SceneRegion::Geodesic { near, radius } => match self.nearest_on_surface(self.bounds.from_box(*near)) {
                Some(source) => select::geodesic_ball(self.shape.topology(), positions, source, radius * self.diagonal),
                None => VertexSet::default(),
            },
            SceneRegion::All(parts) => {
                let sets: Vec<VertexSet> = parts.iter().map(|part| self.vertices_in(part)).collect();
                VertexSet::where_true(positions.len(), |v| sets.iter().all(|set| set.contains(v)))
            }
            SceneRegion::Any(parts) => {
                parts.iter().flat_map(|part| self.vertices_in(part).iter().collect::<Vec<_>>()).collect()
            }
        }
    }

    /// The vertex with a face that is nearest to a point, the lowest number on a tie.
    fn nearest_on_surface(&self, point: DVec3) -> Option<u32> {
        let on_surface = VertexSet::where_true(self.shape.vertex_count(), |v| {
            !self.shape.topology().vertex_faces(v as usize).is_empty()
        });
        let positions: Vec<DVec3> = on_surface.iter().map(|v| self.shape.positions[v as usize]).collect();
        select::nearest_vertex(&positions, point).map(|k| on_surface.as_slice()[k as usize])
    }

    fn motion(&self, motion: &SceneMotion, vertices: &VertexSet) -> Motion {
        let own_centre = || {
            let held: Vec<DVec3> = vertices.iter().map(|v| self.shape.positions[v as usize]).collect();
            Bounds::of(&held).centre()
        };
        Motion {
            pivot: motion.about.map_or_else(own_centre, |about| self.bounds.from_box(about)),
            axis: motion.rotate.map_or(DVec3::X, |rotate| unit(rotate.axis)),
            angle: motion.rotate.map_or(0.0, |rotate| rotate.degrees.to_radians()),
            scale: motion.scale,
            translation: motion.translate * self.diagonal,
        }
    }
}

/// A direction of any length but 0 as a unit vector; scaled first, since its square may over- or underflow.
fn unit(direction: DVec3) -> DVec3 {
    (direction / direction.abs().max_element()).normalize()
}
