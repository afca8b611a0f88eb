/// A set of vertices of one mesh, kept sorted and without repeats.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct VertexSet {
    vertices: Vec<u32>,
}

impl VertexSet {
    /// The vertices for which `predicate` holds.
    pub fn where_true(vertex_count: usize, predicate: impl FnMut(u32) -> bool) -> Self {
        // Meshes never have more than u32::MAX vertices (`Topology::new`).
        Self {
            vertices: (0..vertex_count as u32)
                .filter({
                    let mut p = predicate;
                    move |&v| p(v)
                })
                .collect(),
        }
    }

    /// Every vertex of a mesh.
    pub fn all(vertex_count: usize) -> Self {
        Self::where_true(vertex_count, |_| true)
    }

    /// The members in increasing order.
    pub fn as_slice(&self) -> &[u32] {
        &self.vertices
    }

    /// The members in increasing order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = u32> + '_ {
        self.vertices.iter().copied()
    }

    /// Number of members.
    pub fn len(&self) -> usize {
        self.vertices.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.vertices.is_empty()
    }

    /// Whether `vertex` is a member; costs a binary search.
    pub fn contains(&self, vertex: u32) -> bool {
        self.vertices.binary_search(&vertex).is_ok()
    }
}

impl FromIterator<u32> for VertexSet {
    fn from_iter<I: IntoIterator<Item = u32>>(vertices: I) -> Self {
        let mut vertices: Vec<u32> = vertices.into_iter().collect();
        vertices.sort_unstable();
        vertices.dedup();
        Self { vertices }
    }
}
