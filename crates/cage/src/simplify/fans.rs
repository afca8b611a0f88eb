use pliant_mesh::Topology;

/// The faces round each vertex of a mesh in which vertices are merged.
///
/// A row of wedges per vertex, all in one array; a row that outgrows its place moves to the end with room to spare. That a
/// wedge names the other corners of its face saves a detour through an array of faces.
pub(super) struct Fans {
    wedges: Vec<Wedge>,
    spans: Vec<Span>,
    /// The last stamp given.
    stamp: u32,
}

/// A vertex's corner of a face.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Wedge {
    /// Four times the face's next vertex, plus the turn: how many corners after this one the face's list begins (0, 1 or 2).
    /// The order of corners decides how the face's area is rounded.
    next_and_turn: u32,
    /// The face's vertex after the next.
    pub(super) last: u32,
}

impl Wedge {
    /// The corner of `face` at `place`.
    pub(super) fn new(face: [u32; 3], place: usize) -> Self {
        Self { next_and_turn: face[(place + 1) % 3] << 2 | ((3 - place) % 3) as u32, last: face[(place + 2) % 3] }
    }

    /// The face's vertex after this one.
    pub(super) fn next(self) -> u32 {
        self.next_and_turn >> 2
    }

    pub(super) fn has(self, vertex: u32) -> bool {
        self.next() == vertex || self.last == vertex
    }

    /// The third corner, if the face has `vertex` too.
    pub(super) fn opposite(self, vertex: u32) -> Option<u32> {
        if self.next() == vertex {
            Some(self.last)
        } else if self.last == vertex {
            Some(self.next())
        } else {
            None
        }
    }

    /// The face in its own order of corners, with `vertex` at this one.
    pub(super) fn face(self, vertex: u32) -> [u32; 3] {
        let twice = [vertex, self.next(), self.last, vertex, self.next(), self.last];
        let turn = (self.next_and_turn & 3) as usize;
        [twice[turn], twice[turn + 1], twice[turn + 2]]
    }
}

#[derive(Debug, Clone, Copy)]
struct Span {
    start: usize,
    length: u32,
    room: u32,
    /// The last stamp the vertex was given.
    mark: u32,
}

impl Span {
    fn range(self) -> std::ops::Range<usize> {
        self.start..self.start + self.length as usize
    }
}

/// What became of the faces of a vertex next to a merged one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Renamed {
    /// A face is gone: the vertex was next to both.
    pub(super) lost: bool,
    /// In a face that stayed, the merged vertex came next.
    pub(super) followed: bool,
}

/// Room for this many faces is left at each vertex: few that are merged once outgrow it.
const ROOM: u32 = 8;

impl Fans {
    /// The fans of a mesh.
    pub(super) fn new(topology: &Topology) -> Self {
        let n = topology.vertex_count();
        let mut wedges = Vec::with_capacity(ROOM as usize * n);
        let mut spans = Vec::with_capacity(n);
        for v in 0..n {
            let (start, faces) = (wedges.len(), topology.vertex_faces(v));
            for &f in faces {
                let face = topology.triangles()[f as usize];
                let place = if face[0] as usize == v { 0 } else { 1 + usize::from(face[2] as usize == v) };
                wedges.push(Wedge::new(face, place));
            }
            let length = faces.len() as u32;
            let room = if length > 0 { length.max(ROOM) } else { 0 };
            wedges.resize(start + room as usize, Wedge::default());
            spans.push(Span { start, length, room, mark: 0 });
        }
        Self { wedges, spans, stamp: 0 }
    }

    pub(super) fn row(&self, vertex: u32) -> &[Wedge] {
        &self.wedges[self.spans[vertex as usize].range()]
    }

    /// Reads both ends of a vertex's row (see `Simplifier::read_ahead`).
    #[inline]
    pub(super) fn touch(&self, vertex: u32) -> u64 {
        match self.row(vertex) {
            [first, .., last] => u64::from(first.last ^ last.last),
            _ => 0,
        }
    }

    /// Number of faces at a vertex.
    pub(super) fn face_count(&self, vertex: u32) -> usize {
        self.spans[vertex as usize].length as usize
    }

    /// Collects the neighbours of a vertex without repeats.
    pub(super) fn ring(&mut self, vertex: u32, ring: &mut Vec<u32>) {
        ring.clear();
        let seen = self.fresh_stamps(1);
        for wedge in &self.wedges[self.spans[vertex as usize].range()] {
            for w in [wedge.next(), wedge.last] {
                let mark = &mut self.spans[w as usize].mark;
                if *mark != seen {
                    *mark = seen;
                    ring.push(w);
                }
            }
        }
    }

    /// How many vertices are next to both `u` and `v`, themselves neighbours.
    pub(super) fn common_neighbours(&mut self, u: u32, v: u32) -> usize {
        let of_u = self.fresh_stamps(2);
        let counted = of_u + 1;
        for wedge in &self.wedges[self.spans[u as usize].range()] {
            self.spans[wedge.next() as usize].mark = of_u;
            self.spans[wedge.last as usize].mark = of_u;
        }
        let mut common = 0;
        for wedge in &self.wedges[self.spans[v as usize].range()] {
            for w in [wedge.next(), wedge.last] {
                let mark = &mut self.spans[w as usize].mark;
                common += usize::from(*mark == of_u);
                *mark = counted;
            }
        }
        common
    }

    /// The first of `count` stamps that no vertex has.
    fn fresh_stamps(&mut self, count: u32) -> u32 {
        if self.stamp > u32::MAX - count {
            self.spans.iter_mut().for_each(|span| span.mark = 0);
            self.stamp = 0;
        }
        self.stamp += count;
        self.stamp - count + 1
    }

    /// In the faces of `vertex`, puts `to` in the place of `from`; those with both go.
    pub(super) fn rename(&mut self, vertex: u32, from: u32, to: u32) -> Renamed {
        let span = &mut self.spans[vertex as usize];
        let row = &mut self.wedges[span.range()];
        let mut outcome = Renamed { lost: false, followed: false };
        let (mut i, mut end) = (0, row.len());
        while i < end {
            let wedge = &mut row[i];
            let (is_next, is_last) = (wedge.next() == from, wedge.last == from);
            if is_next || is_last {
                if wedge.has(to) {
                    end -= 1;
                    row[i] = row[end];
                    outcome.lost = true;
                    continue;
                }
                if is_next {
                    wedge.next_and_turn = to << 2 | wedge.next_and_turn & 3;
                    outcome.followed = true;
                } else {
                    wedge.last = to;
                }
            }
            i += 1;
        }
        span.length = end as u32;
        outcome
    }

    /// Hands the faces of `u` to `v`; those with both go.
    pub(super) fn merge(&mut self, u: u32, v: u32) {
        self.drop_faces(u, v);
        self.drop_faces(v, u);
        let (from, mut to) = (self.spans[u as usize], self.spans[v as usize]);
        let length = from.length + to.length;
        if length > to.room {
            let start = self.wedges.len();
            let room = length + length / 2;
            self.wedges.extend_from_within(to.range());
            self.wedges.resize(start + room as usize, Wedge::default());
            to = Span { start, room, ..to };
        }
        self.wedges.copy_within(from.range(), to.range().end);
        self.spans[v as usize] = Span { length, ..to };
        self.spans[u as usize].length = 0;
    }

    /// Drops the faces of `vertex` that have `other`.
    fn drop_faces(&mut self, vertex: u32, other: u32) {
        let span = &mut self.spans[vertex as usize];
        let row = &mut self.wedges[span.range()];
        let (mut i, mut end) = (0, row.len());
        while i < end {
            if row[i].has(other) {
                end -= 1;
                row[i] = row[end];
            } else {
                i += 1;
            }
        }
        span.length = end as u32;
    }
}
