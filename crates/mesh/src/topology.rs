use crate::MeshError;

/// Connectivity of a triangle mesh: which vertices, edges and faces touch.
///
/// Holds any triangle soup with valid indices. Edges are undirected, numbered in lexicographic order of their
/// `[smaller, larger]` ends; every list is sorted, so all results are the same on every run.
#[derive(Debug, Clone)]
pub struct Topology {
    vertex_count: usize,
    triangles: Vec<[u32; 3]>,
    /// `[smaller, larger]` ends of each edge.
    edges: Vec<[u32; 2]>,
    /// Edge opposite to each corner of each face.
    face_edges: Vec<[u32; 3]>,
    edge_faces: Csr,
    vertex_faces: Csr,
    neighbours: Csr,
    /// Edge to each entry of `neighbours`.
    neighbour_edges: Vec<u32>,
}

/// Lists of numbers, one list per row, stored end to end.
#[derive(Debug, Clone)]
struct Csr {
    /// Row `i` is `items[offsets[i]..offsets[i + 1]]`.
    offsets: Vec<u32>,
    items: Vec<u32>,
}

impl Csr {
    /// Offsets from row lengths; items are left at 0, `cursor` marks where each row is to be filled.
    fn with_lengths(lengths: impl Iterator<Item = u32>) -> (Self, Vec<u32>) {
        let mut offsets = vec![0];
        let mut end = 0;
        offsets.extend(lengths.map(|n| {
            end += n;
            end
        }));
        let cursor = offsets[..offsets.len() - 1].to_vec();
        (Self { offsets, items: vec![0; end as usize] }, cursor)
    }

    fn row(&self, i: usize) -> &[u32] {
        &self.items[self.range(i)]
    }

    fn range(&self, i: usize) -> std::ops::Range<usize> {
        self.offsets[i] as usize..self.offsets[i + 1] as usize
    }
}

/// Largest number of vertices or faces: edges and corners must fit 32 bits too.
const MAX_COUNT: usize = (u32::MAX / 4) as usize;

impl Topology {
    /// Builds the connectivity of `triangles` over `vertex_count` vertices, in linear time but for tiny sorts.
    ///
    /// # Errors
    /// Names the first face with an index out of range or with the same vertex at two corners.
    pub fn new(vertex_count: usize, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        for (what, count) in [("vertices", vertex_count), ("faces", triangles.len())] {
            if count > MAX_COUNT {
                return Err(MeshError::TooMany { what, count });
            }
        }
        for (face, &[a, b, c]) in triangles.iter().enumerate() {
            if let Some(vertex) = [a, b, c].into_iter().find(|&v| v as usize >= vertex_count) {
                return Err(MeshError::IndexOutOfRange { face, vertex, vertices: vertex_count });
            }
            if a == b || b == c || c == a {
                return Err(MeshError::RepeatedVertex { face, vertex: if a == b { a } else { c } });
            }
        }
        let vertex_faces = vertex_faces(vertex_count, &triangles);
        let (edges, face_edges, edge_faces) = edges(vertex_count, &triangles);
        let (neighbours, neighbour_edges) = neighbours(vertex_count, &edges);
        Ok(Self { vertex_count, triangles, edges, face_edges, edge_faces, vertex_faces, neighbours, neighbour_edges })
    }

    /// Number of vertices, unused ones included.
    pub fn vertex_count(&self) -> usize {
        self.vertex_count
    }

    /// Vertex numbers of each face.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// `[smaller, larger]` ends of each edge, in lexicographic order.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// Edges of a face; entry `k` is the one opposite to corner `k`.
    pub fn face_edges(&self, face: usize) -> [u32; 3] {
        self.face_edges[face]
    }

    /// The sum of each edge's values over its faces; value `k` of a face is that of the edge opposite to its corner `k`.
    ///
    /// # Panics
    /// If there are more faces of values than faces.
    pub fn edge_sums(&self, of_faces: &[[f64; 3]]) -> Vec<f64> {
        let mut sums = vec![0.0; self.edges.len()];
        for (face, values) in of_faces.iter().enumerate() {
            for (edge, value) in self.face_edges(face).into_iter().zip(values) {
                sums[edge as usize] += value;
            }
        }
        sums
    }

    /// Faces at an edge, increasing.
    pub fn edge_faces(&self, edge: usize) -> &[u32] {
        self.edge_faces.row(edge)
    }

    /// Faces at a vertex, increasing.
    pub fn vertex_faces(&self, vertex: usize) -> &[u32] {
        self.vertex_faces.row(vertex)
    }

    /// Vertices that share an edge with `vertex`, increasing.
    pub fn neighbours(&self, vertex: usize) -> &[u32] {
        self.neighbours.row(vertex)
    }

    /// The edge to each entry of [`Self::neighbours`].
    pub fn neighbour_edges(&self, vertex: usize) -> &[u32] {
        &self.neighbour_edges[self.neighbours.range(vertex)]
    }

    /// Whether an edge has exactly one face.
    pub fn is_boundary_edge(&self, edge: usize) -> bool {
        self.edge_faces(edge).len() == 1
    }

    /// For each vertex, whether it lies on an edge with exactly one face.
    pub fn boundary_vertices(&self) -> Vec<bool> {
        let mut boundary = vec![false; self.vertex_count];
        for (e, ends) in self.edges.iter().enumerate() {
            if self.is_boundary_edge(e) {
                for &v in ends {
                    boundary[v as usize] = true;
                }
            }
        }
        boundary
    }

    /// The boundary as closed loops of vertices, each running with its faces on the left.
    ///
    /// A vertex where several loops touch appears once in each. On an inconsistently oriented mesh a loop that
    /// cannot be closed is returned as far as it could be followed.
    pub fn boundary_loops(&self) -> Vec<Vec<u32>> {
        // Directed boundary half-edges by start vertex.
        let mut next: Vec<[u32; 2]> = Vec::new();
        for (e, &[a, b]) in self.edges.iter().enumerate() {
            if let [face] = *self.edge_faces(e) {
                let forward = self.runs_forward(face, a, b);
                next.push(if forward { [a, b] } else { [b, a] });
            }
        }
        next.sort_unstable();
        let mut used = vec![false; next.len()];
        // Where each vertex stands in the path being followed.
        const NOWHERE: usize = usize::MAX;
        let mut place = vec![NOWHERE; self.vertex_count];
        let mut loops = Vec::new();
        for start in 0..next.len() {
            let mut path: Vec<u32> = Vec::new();
            let mut at = Some(start).filter(|&h| !used[h]);
            while let Some(h) = at {
                used[h] = true;
                let [tail, head] = next[h];
                place[tail as usize] = path.len();
                path.push(tail);
                if place[head as usize] != NOWHERE {
                    // Back at a vertex of the path: what lies between is a loop, even where another one touches it.
                    let closed = path.split_off(place[head as usize]);
                    for &v in &closed {
                        place[v as usize] = NOWHERE;
                    }
                    loops.push(closed);
                    if path.is_empty() {
                        break;
                    }
                }
                let first = next.partition_point(|h| h[0] < head);
                at = (first..next.len()).take_while(|&h| next[h][0] == head).find(|&h| !used[h]);
            }
            if !path.is_empty() {
                for &v in &path {
                    place[v as usize] = NOWHERE;
                }
                loops.push(path);
            }
        }
        loops
    }

    /// Connected component of each vertex, numbered by their lowest vertex, and how many there are.
    ///
    /// A vertex without faces is a component of its own.
    pub fn components(&self) -> (Vec<u32>, usize) {
        const NONE: u32 = u32::MAX;
        let mut component = vec![NONE; self.vertex_count];
        let mut count = 0;
        let mut stack = Vec::new();
        for seed in 0..self.vertex_count {
            if component[seed] != NONE {
                continue;
            }
            component[seed] = count;
            stack.push(seed as u32);
            while let Some(v) = stack.pop() {
                for &w in self.neighbours(v as usize) {
                    if component[w as usize] == NONE {
                        component[w as usize] = count;
                        stack.push(w);
                    }
                }
            }
            count += 1;
        }
        (component, count as usize)
    }

    /// Vertices in use minus edges plus faces: 2 per closed component of genus 0.
    pub fn euler_characteristic(&self) -> i64 {
        let used = (0..self.vertex_count).filter(|&v| !self.vertex_faces(v).is_empty()).count();
        used as i64 - self.edges.len() as i64 + self.triangles.len() as i64
    }

    /// Number of edges with exactly one face.
    pub fn boundary_edge_count(&self) -> usize {
        (0..self.edges.len()).filter(|&e| self.is_boundary_edge(e)).count()
    }

    /// Whether every edge has one or two faces and the faces of every vertex form one fan.
    pub fn is_manifold(&self) -> bool {
        self.require_manifold().is_ok()
    }

    /// Whether every edge has two faces or more.
    pub fn is_closed(&self) -> bool {
        self.require_closed().is_ok()
    }

    /// Whether faces run through every edge equally often in both directions, so that the mesh has no boundary even where more than two
    /// faces meet at an edge, and encloses a volume.
    pub fn is_cycle(&self) -> bool {
        self.edges.iter().enumerate().all(|(e, &[a, b])| {
            let faces = self.edge_faces(e);
            2 * faces.iter().filter(|f| self.runs_forward(**f, a, b)).count() == faces.len()
        })
    }

    /// Number of edges with more than two faces.
    pub fn non_manifold_edge_count(&self) -> usize {
        (0..self.edges.len()).filter(|&e| self.edge_faces(e).len() > 2).count()
    }

    /// Refuses a mesh that is not manifold.
    ///
    /// # Errors
    /// The first edge with more than two faces, else the first vertex whose faces form more than one fan.
    pub fn require_manifold(&self) -> Result<(), MeshError> {
        for (e, &[a, b]) in self.edges.iter().enumerate() {
            let faces = self.edge_faces(e).len();
            if faces > 2 {
                return Err(MeshError::NonManifoldEdge { a, b, faces });
            }
        }
        for v in 0..self.vertex_count {
            let fans = self.fan_count(v);
            if fans > 1 {
                return Err(MeshError::NonManifoldVertex { vertex: v as u32, fans });
            }
        }
        Ok(())
    }

    /// Refuses a mesh with a boundary.
    ///
    /// # Errors
    /// The first edge with one face.
    pub fn require_closed(&self) -> Result<(), MeshError> {
        match (0..self.edges.len()).find(|&e| self.is_boundary_edge(e)) {
            Some(e) => {
                let [a, b] = self.edges[e];
                Err(MeshError::OpenEdge { a, b, open: self.boundary_edge_count() })
            }
            None => Ok(()),
        }
    }

    /// Refuses a mesh in which two faces run through a shared edge in the same direction.
    ///
    /// # Errors
    /// The first such edge and its faces; edges with more than two faces are not looked at.
    pub fn require_oriented(&self) -> Result<(), MeshError> {
        for (e, &[a, b]) in self.edges.iter().enumerate() {
            if let [f, g] = *self.edge_faces(e)
                && self.runs_forward(f, a, b) == self.runs_forward(g, a, b)
            {
                return Err(MeshError::InconsistentOrientation { a, b, faces: [f, g] });
            }
        }
        Ok(())
    }

    /// Number of fans (runs of faces joined by shared edges) around a vertex: 0 if unused, 1 on a manifold.
    pub fn fan_count(&self, vertex: usize) -> usize {
        const FEW: usize = 16;
        let faces = self.vertex_faces(vertex);
        if faces.len() > FEW {
            return self.fan_count_of_many(vertex);
        }
        // Each face by its two other corners. Fans are gathered at the front, one after the other.
        let mut sides = [[0; 2]; FEW];
        let sides = &mut sides[..faces.len()];
        for (side, &f) in sides.iter_mut().zip(faces) {
            let [a, b, c] = self.triangles[f as usize];
            *side = if a as usize == vertex { [b, c] } else { [a, if b as usize == vertex { c } else { b }] };
        }
        let (mut fans, mut gathered) = (0, 0);
        for i in 0..sides.len() {
            if i == gathered {
                (fans, gathered) = (fans + 1, gathered + 1);
            }
            for j in i + 1..sides.len() {
                let joins = sides[j].contains(&sides[i][0]) || sides[j].contains(&sides[i][1]);
                if j >= gathered && joins {
                    sides.swap(gathered, j);
                    gathered += 1;
                }
            }
        }
        fans
    }

    fn fan_count_of_many(&self, vertex: usize) -> usize {
        let faces = self.vertex_faces(vertex);
        // Union-find over the faces, joined by the edges they share; each fan keeps its lowest face as root.
        let mut fan: Vec<usize> = (0..faces.len()).collect();
        let find = |fan: &[usize], mut i: usize| {
            while fan[i] != i {
                i = fan[i];
            }
            i
        };
        for &edge in self.neighbour_edges(vertex) {
            let mut around = self.edge_faces(edge as usize).iter().filter_map(|f| faces.binary_search(f).ok());
            if let Some(first) = around.next() {
                for other in around {
                    let (i, j) = (find(&fan, first), find(&fan, other));
                    fan[i.max(j)] = i.min(j);
                }
            }
        }
        (0..fan.len()).filter(|&i| fan[i] == i).count()
    }

    /// Whether `face` has the directed edge `a` to `b`.
    fn runs_forward(&self, face: u32, a: u32, b: u32) -> bool {
        let t = self.triangles[face as usize];
        (0..3).any(|k| t[k] == a && t[(k + 1) % 3] == b)
    }
}

fn vertex_faces(vertex_count: usize, triangles: &[[u32; 3]]) -> Csr {
    let mut degree = vec![0u32; vertex_count];
    for v in triangles.iter().flatten() {
        degree[*v as usize] += 1;
    }
    let (mut csr, mut cursor) = Csr::with_lengths(degree.into_iter());
    for (f, triangle) in triangles.iter().enumerate() {
        for &v in triangle {
            csr.items[cursor[v as usize] as usize] = f as u32;
            cursor[v as usize] += 1;
        }
    }
    csr
}

/// Edges in lexicographic order, the edges of each face, and the faces of each edge.
fn edges(vertex_count: usize, triangles: &[[u32; 3]]) -> (Vec<[u32; 2]>, Vec<[u32; 3]>, Csr) {
    // Half-edges sorted by their smaller end (counting sort), then each small bucket by (larger end, corner).
    let ends = |t: &[u32; 3], k: usize| {
        let (a, b) = (t[(k + 1) % 3], t[(k + 2) % 3]);
        (a.min(b), a.max(b))
    };
    let mut counts = vec![0u32; vertex_count];
    for t in triangles {
        for k in 0..3 {
            counts[ends(t, k).0 as usize] += 1;
        }
    }
    let (buckets, mut cursor) = Csr::with_lengths(counts.into_iter());
    let mut half_edges = vec![(0u32, 0u32); 3 * triangles.len()];
    for (f, t) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (low, high) = ends(t, k);
            half_edges[cursor[low as usize] as usize] = (high, (3 * f + k) as u32);
            cursor[low as usize] += 1;
        }
    }
    let mut edges: Vec<[u32; 2]> = Vec::with_capacity(half_edges.len() / 2 + 1);
    let mut face_edges = vec![[0; 3]; triangles.len()];
    let mut faces = Csr { offsets: vec![0], items: Vec::with_capacity(half_edges.len()) };
    for low in 0..vertex_count {
        let bucket = &mut half_edges[buckets.range(low)];
        bucket.sort_unstable();
        for (i, &(high, corner)) in bucket.iter().enumerate() {
            if i == 0 || bucket[i - 1].0 != high {
                edges.push([low as u32, high]);
                faces.offsets.push(faces.items.len() as u32);
            }
            faces.items.push(corner / 3);
            *faces.offsets.last_mut().expect("starts with one entry") = faces.items.len() as u32;
            face_edges[(corner / 3) as usize][(corner % 3) as usize] = edges.len() as u32 - 1;
        }
    }
    (edges, face_edges, faces)
}

/// Neighbours of each vertex and the edge to each; both increase because edges are in lexicographic order.
fn neighbours(vertex_count: usize, edges: &[[u32; 2]]) -> (Csr, Vec<u32>) {
    let mut degree = vec![0u32; vertex_count];
    for v in edges.iter().flatten() {
        degree[*v as usize] += 1;
    }
    let (mut csr, mut cursor) = Csr::with_lengths(degree.into_iter());
    let mut edge_of = vec![0; csr.items.len()];
    for (e, &[a, b]) in edges.iter().enumerate() {
        for (from, to) in [(a, b), (b, a)] {
            let at = cursor[from as usize] as usize;
            csr.items[at] = to;
            edge_of[at] = e as u32;
            cursor[from as usize] += 1;
        }
    }
    (csr, edge_of)
}

#[cfg(test)]
mod tests;
