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

    /// Members of either set; linear in both.
    pub fn union(&self, other: &Self) -> Self {
        self.merged(other, |_, _| true)
    }

    /// Members of both sets; linear in both.
    pub fn intersection(&self, other: &Self) -> Self {
        self.merged(other, |here, there| here && there)
    }

    /// Members of this set that are not in the other; linear in both.
    pub fn difference(&self, other: &Self) -> Self {
        self.merged(other, |_, there| !there)
    }

    /// The vertices of a mesh that are not members.
    pub fn inverted(&self, vertex_count: usize) -> Self {
        Self::all(vertex_count).difference(self)
    }

    /// The members of either set for which `keep(in this, in the other)` holds.
    fn merged(&self, other: &Self, keep: impl Fn(bool, bool) -> bool) -> Self {
        let (a, b) = (&self.vertices, &other.vertices);
        let mut vertices = Vec::new();
        let (mut i, mut j) = (0, 0);
        while i < a.len() || j < b.len() {
            let here = i < a.len() && (j == b.len() || a[i] <= b[j]);
            let there = j < b.len() && (i == a.len() || b[j] <= a[i]);
            if keep(here, there) {
                vertices.push(if here { a[i] } else { b[j] });
            }
            i += usize::from(here);
            j += usize::from(there);
        }
        Self { vertices }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pair of subsets of five vertices, against membership asked vertex by vertex.
    #[test]
    fn algebra_agrees_with_membership() {
        let subset = |bits: u32| VertexSet::where_true(5, |v| bits >> v & 1 == 1);
        for (x, y) in (0..32).flat_map(|x| (0..32).map(move |y| (x, y))) {
            let (a, b) = (subset(x), subset(y));
            assert_eq!(a.union(&b), subset(x | y));
            assert_eq!(a.intersection(&b), subset(x & y));
            assert_eq!(a.difference(&b), subset(x & !y));
            assert_eq!(a.inverted(5), subset(!x));
        }
        assert_eq!(VertexSet::from_iter([1, 7]).inverted(3), VertexSet::from_iter([0, 2]));
    }
}
