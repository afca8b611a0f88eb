use std::collections::BTreeMap;

use glam::DVec3;

/// What a reader gathers from a file: vertices and triangles as they stand there, and counts of all it left out.
#[derive(Debug, Default)]
pub(crate) struct Soup {
    pub(crate) positions: Vec<DVec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Faces in the file, of any number of corners.
    pub(crate) faces: usize,
    /// Those with more than three corners.
    pub(crate) triangulated: usize,
    /// What stood in the file and is not in the mesh, with how often.
    pub(crate) dropped: BTreeMap<String, usize>,
}

impl Soup {
    /// Adds a vertex; its number must fit 32 bits.
    pub(crate) fn vertex(&mut self, point: DVec3) -> Result<(), String> {
        if !point.is_finite() {
            return Err(format!("vertex {} has a coordinate that is not a finite number", self.positions.len()));
        }
        if self.positions.len() >= u32::MAX as usize {
            return Err("there are more vertices than 32-bit numbers can name".to_owned());
        }
        self.positions.push(point);
        Ok(())
    }

    /// Adds a polygon as a fan round its first corner, which is right for convex polygons and may fold over in others.
    pub(crate) fn polygon(&mut self, corners: &[u32]) {
        self.faces += 1;
        if corners.len() < 3 {
            self.drop("faces with fewer than three corners", 1);
            return;
        }
        self.triangulated += usize::from(corners.len() > 3);
        self.triangles.extend(corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]]));
    }

    /// Adds a triangle strip, whose every second triangle is turned round.
    pub(crate) fn strip(&mut self, corners: &[u32]) {
        self.faces += corners.len().saturating_sub(2);
        self.triangles.extend(corners.windows(3).enumerate().map(|(i, t)| match i % 2 {
            0 => [t[0], t[1], t[2]],
            _ => [t[1], t[0], t[2]],
        }));
    }

    /// Notes that `count` of something are left out.
    pub(crate) fn drop(&mut self, what: &str, count: usize) {
        if count == 0 {
            return;
        }
        match self.dropped.get_mut(what) {
            Some(n) => *n += count,
            None => {
                self.dropped.insert(what.to_owned(), count);
            }
        }
    }
}
