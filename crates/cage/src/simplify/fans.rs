/// The faces round each vertex of a mesh in which vertices are merged.
///
/// A row of wedges per vertex, all in one array; a row that outgrows its place moves to the end with room to spare. That a
/// wedge names the other corners of its face saves a detour through an array of faces.
pub(super) struct Fans {
    wedges: Vec<Wedge>,
    spans: Vec<Span>,
}

/// A vertex's corner of a face.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Wedge {
    /// Four times the face's next vertex, plus the place of the corner in the face (0, 1 or 2): the order of corners
    /// decides how the face's area is rounded.
    next_and_place: u32,
    /// The face's vertex after the next.
    pub(super) last: u32,
}

impl Wedge {
    /// The corner of `face` at `place`.
    pub(super) fn new(face: [u32; 3], place: usize) -> Self {
        Self { next_and_place: face[(place + 1) % 3] << 2 | place as u32, last: face[(place + 2) % 3] }
    }

    /// The face's vertex after this one.
    pub(super) fn next(self) -> u32 {
        self.next_and_place >> 2
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
        const FROM: [[usize; 3]; 3] = [[0, 1, 2], [2, 0, 1], [1, 2, 0]];
        let corners = [vertex, self.next(), self.last];
        FROM[(self.next_and_place & 3).min(2) as usize].map(|k| corners[k])
    }

    fn renamed(self, from: u32, to: u32) -> Self {
        let next = if self.next() == from { to } else { self.next() };
        let last = if self.last == from { to } else { self.last };
        Self { next_and_place: next << 2 | self.next_and_place & 3, last }
    }
}

#[derive(Debug, Clone, Copy)]
struct Span {
    start: usize,
    length: u32,
    room: u32,
}

/// How a vertex next to a merged one stood to the vertex that takes its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Renamed {
    /// Shared a face with it before.
    pub(super) was_adjacent: bool,
    /// Is followed by it in a face that had the merged vertex.
    pub(super) is_followed: bool,
}

impl Fans {
    pub(super) fn new(lengths: impl Iterator<Item = usize>, wedges: Vec<Wedge>) -> Self {
        let mut start = 0;
        let spans = lengths.map(|length| {
            start += length;
            Span { start: start - length, length: length as u32, room: length as u32 }
        });
        Self { spans: spans.collect(), wedges }
    }

    pub(super) fn row(&self, vertex: u32) -> &[Wedge] {
        let span = self.spans[vertex as usize];
        &self.wedges[span.start..span.start + span.length as usize]
    }

    /// Number of faces at a vertex.
    pub(super) fn face_count(&self, vertex: u32) -> usize {
        self.spans[vertex as usize].length as usize
    }

    /// Puts `to` in the place of `from` in the row of `vertex`, which has neither's; faces with both go.
    pub(super) fn rename(&mut self, vertex: u32, from: u32, to: u32) -> Renamed {
        let span = &mut self.spans[vertex as usize];
        let row = &mut self.wedges[span.start..span.start + span.length as usize];
        let mut outcome = Renamed { was_adjacent: false, is_followed: false };
        let mut kept = 0;
        for i in 0..row.len() {
            let wedge = row[i];
            let (has_from, has_to) = (wedge.has(from), wedge.has(to));
            outcome.was_adjacent |= has_to;
            outcome.is_followed |= has_from && !has_to && wedge.next() == from;
            row[kept] = wedge.renamed(from, to);
            kept += usize::from(!(has_from && has_to));
        }
        span.length = kept as u32;
        outcome
    }

    /// Hands the faces of `u` to `v`; those with both go.
    pub(super) fn merge(&mut self, u: u32, v: u32) {
        let (mut from, mut to) = (self.spans[u as usize], self.spans[v as usize]);
        for (span, other) in [(&mut from, v), (&mut to, u)] {
            let row = &mut self.wedges[span.start..span.start + span.length as usize];
            let mut kept = 0;
            for i in 0..row.len() {
                row[kept] = row[i];
                kept += usize::from(!row[i].has(other));
            }
            span.length = kept as u32;
        }
        let length = from.length + to.length;
        if length > to.room {
            let start = self.wedges.len();
            let room = length + length / 2;
            self.wedges.extend_from_within(to.start..to.start + to.length as usize);
            self.wedges.resize(start + room as usize, Wedge::default());
            to = Span { start, room, ..to };
        }
        let moved = from.start..from.start + from.length as usize;
        self.wedges.copy_within(moved, to.start + to.length as usize);
        self.spans[v as usize] = Span { length, ..to };
        self.spans[u as usize].length = 0;
    }
}
