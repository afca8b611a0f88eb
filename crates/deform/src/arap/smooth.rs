//! Cells that also want the rotations of their neighbours.
//!
//! Levi, Gotsman. *Smooth Rotation Enhanced As-Rigid-As-Possible Mesh Animation.* IEEE TVCG 21(2), 2015. To the energy is added
//! `alpha A sum_i sum_j w_ij |R_i - R_j|^2` over the cells and the neighbours of each, with `A` the area of the rest shape, which makes
//! `alpha` a pure number. With its neighbours held, the best `R_i` is that of `S_i + 2 alpha A sum_j w_ij R_j`; the global step does
//! not change.
//!
//! The paper fits all cells at once, with the neighbours' rotations of the last iteration, which may raise the energy. Here cells are
//! fitted colour by colour: no two of a colour are neighbours, so that each fit lowers the energy, in whatever order those of one colour
//! are done.

use pliant_mesh::threads::{CHUNK, for_each_chunk};
use pliant_mesh::{LANES, RotationBatch};
use pulp::{Arch, Simd, WithSimd};

use super::cells::Cells;
use super::roles::Roles;
use super::steps::{Columns, Row, add, covariance, padded};

/// The fitted cells by colour, and room for their rotations.
pub(crate) struct Smoother {
    colours: Vec<Vec<u32>>,
    /// Of the cells of one colour.
    fits: Vec<Columns>,
    /// Rotations before the last sweep.
    before: Vec<Columns>,
}

impl Smoother {
    pub(crate) fn new(cells: &Cells, roles: &Roles) -> Self {
        let mut colours: Vec<Vec<u32>> = Vec::new();
        const NONE: usize = usize::MAX;
        let mut colour_of = vec![NONE; cells.cells];
        let mut taken = Vec::new();
        for &slot in roles.fitted.as_slice() {
            // The first colour that no neighbour has.
            taken.clear();
            taken.resize(colours.len(), false);
            for &other in cells.neighbours(slot as usize) {
                if let Some(taken) = colour_of.get(other as usize).and_then(|&colour| taken.get_mut(colour)) {
                    *taken = true;
                }
            }
            let colour = taken.iter().position(|taken| !taken).unwrap_or(colours.len());
            colour_of[slot as usize] = colour;
            if colour == colours.len() {
                colours.push(Vec::new());
            }
            colours[colour].push(slot);
        }
        let most = colours.iter().map(Vec::len).max().unwrap_or(0);
        Self { colours, fits: vec![Columns::default(); most], before: vec![Columns::default(); cells.cells] }
    }

    #[cfg(test)]
    pub(crate) fn colours(&self) -> &[Vec<u32>] {
        &self.colours
    }

    /// Fits every cell once, to `pose` and to its neighbours.
    pub(crate) fn sweep(&mut self, cells: &Cells, roles: &Roles, pose: &[Row], rotations: &mut [Columns]) {
        self.before.copy_from_slice(rotations);
        for slots in &self.colours {
            let fits = &mut self.fits[..slots.len()];
            let now = &*rotations;
            for_each_chunk(fits, |chunk, fits| {
                let slots = &slots[chunk * CHUNK..][..fits.len()];
                Arch::new().dispatch(FitSmoothed { cells, roles, slots, pose, rotations: now, fits });
            });
            for (&slot, &fit) in slots.iter().zip(&*fits) {
                rotations[slot as usize] = fit;
            }
        }
    }

    /// Takes back the last sweep.
    pub(crate) fn undo(&self, rotations: &mut [Columns]) {
        rotations.copy_from_slice(&self.before);
    }

    /// What the differences of rotations add to the energy.
    pub(crate) fn energy(&self, cells: &Cells, roles: &Roles, rotations: &[Columns]) -> f64 {
        let of_cell = |&slot: &u32| -> f64 {
            let own = rotations[slot as usize];
            let square = |other: &Columns| -> f64 {
                own.iter().flatten().zip(other.iter().flatten()).map(|(p, q)| (p - q) * (p - q)).sum()
            };
            let pairs = smooth_neighbours(cells, roles, slot as usize);
            // Each pair has one weight for both of its ends.
            pairs.map(|(other, weight)| 0.5 * weight * square(&rotations[other])).sum()
        };
        roles.fitted.as_slice().iter().map(of_cell).sum()
    }
}

/// The neighbours of a cell that have a rotation, and `2 alpha A w`.
#[inline(always)]
fn smooth_neighbours<'a>(cells: &'a Cells, roles: &'a Roles, slot: usize) -> impl Iterator<Item = (usize, f64)> + 'a {
    let pairs = cells.neighbours(slot).iter().zip(cells.smoothing(slot));
    // Those of the outermost cells need not be cells.
    let is_fitted = |slot: usize| slot < cells.cells && roles.fitted.contains(slot);
    pairs.map(|(&other, &weight)| (other as usize, weight)).filter(move |&(other, _)| is_fitted(other))
}

/// Fits the cells of `slots`, the others held.
struct FitSmoothed<'a> {
    cells: &'a Cells,
    roles: &'a Roles,
    slots: &'a [u32],
    pose: &'a [Row],
    rotations: &'a [Columns],
    fits: &'a mut [Columns],
}

impl WithSimd for FitSmoothed<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { cells, roles, slots, pose, rotations, fits } = self;
        let mut batch = RotationBatch::default();
        for (slots, fits) in slots.chunks(LANES).zip(fits.chunks_mut(LANES)) {
            for (lane, &slot) in slots.iter().enumerate() {
                let mut s = covariance(cells, slot as usize, pose);
                for (other, weight) in smooth_neighbours(cells, roles, slot as usize) {
                    for (column, &of_other) in s.iter_mut().zip(&rotations[other]) {
                        add(column, of_other, weight);
                    }
                }
                batch.set(lane, &s.map(|[x, y, z, _]| [x, y, z]));
            }
            batch.fit(slots.len());
            for (lane, fit) in fits.iter_mut().enumerate() {
                *fit = padded(batch.get(lane));
            }
        }
    }
}
