use std::sync::Arc;

use glam::DVec3;

use crate::{Bounds, MeshError, Topology};

/// Positions and shared connectivity.
///
/// Positions may be moved freely; connectivity never changes, so a clone costs one position array and shares the rest.
#[derive(Debug, Clone)]
pub struct TriMesh {
    /// One position per vertex.
    pub positions: Vec<DVec3>,
    topology: Arc<Topology>,
}

impl TriMesh {
    /// A mesh of `positions` and `triangles` (vertex numbers from 0, counter-clockwise seen from outside).
    ///
    /// Any triangle soup with valid indices is accepted: open, non-manifold, with unused vertices. A method that
    /// needs more asks for it ([`Topology::require_manifold`], [`Topology::require_closed`]).
    /// Costs a few counting sorts of the edges, linear in the number of faces.
    ///
    /// # Errors
    /// Names the first face with an index out of range or a repeated vertex, or the first vertex that is not finite.
    pub fn new(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        check_finite(&positions)?;
        let topology = Arc::new(Topology::new(positions.len(), triangles)?);
        Ok(Self { positions, topology })
    }

    /// The same connectivity with other positions.
    ///
    /// # Errors
    /// The number of positions differs from the number of vertices, or one is not finite.
    pub fn with_positions(&self, positions: Vec<DVec3>) -> Result<Self, MeshError> {
        if positions.len() != self.vertex_count() {
            return Err(MeshError::PositionCount { expected: self.vertex_count(), found: positions.len() });
        }
        check_finite(&positions)?;
        Ok(Self { positions, topology: Arc::clone(&self.topology) })
    }

    /// The connectivity.
    pub fn topology(&self) -> &Topology {
        &self.topology
    }

    /// The connectivity, to be shared.
    pub fn shared_topology(&self) -> Arc<Topology> {
        Arc::clone(&self.topology)
    }

    /// Vertex numbers of each face.
    pub fn triangles(&self) -> &[[u32; 3]] {
        self.topology.triangles()
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.topology.vertex_count()
    }

    /// Number of faces.
    pub fn face_count(&self) -> usize {
        self.triangles().len()
    }

    /// Positions of the three corners of a face.
    pub fn corners(&self, face: usize) -> [DVec3; 3] {
        self.triangles()[face].map(|v| self.positions[v as usize])
    }

    /// Bounding box of the surface: of the vertices that faces use, or of all where there is no face.
    ///
    /// A stray vertex that no face uses thus changes no scale and no scene.
    pub fn bounds(&self) -> Bounds {
        let used = |v: &usize| !self.topology.vertex_faces(*v).is_empty();
        let Some(first) = (0..self.vertex_count()).find(used) else {
            return Bounds::of(&self.positions);
        };
        let start = Bounds { min: self.positions[first], max: self.positions[first] };
        (first..self.vertex_count()).filter(used).fold(start, |box_, v| Bounds {
            min: box_.min.min(self.positions[v]),
            max: box_.max.max(self.positions[v]),
        })
    }

    /// Signed volume: positive for a closed mesh whose faces are counter-clockwise seen from outside.
    ///
    /// For an open mesh, the volume between its faces and the centre of its bounding box.
    pub fn signed_volume(&self) -> f64 {
        let centre = self.bounds().centre();
        let six_fold: f64 = (0..self.face_count())
            .map(|f| {
                let [a, b, c] = self.corners(f).map(|p| p - centre);
                a.dot(b.cross(c))
            })
            .sum();
        six_fold / 6.0
    }
}

fn check_finite(positions: &[DVec3]) -> Result<(), MeshError> {
    match positions.iter().position(|p| !p.is_finite()) {
        Some(vertex) => Err(MeshError::NotFinite { vertex }),
        None => Ok(()),
    }
}
