use crate::{LinalgError, Triplet};

/// Which unknowns of a full system are free and which are fixed, with index maps both ways.
///
/// Both kinds are numbered from 0 in the order of the full system. With `x_c` given at the fixed unknowns, the free
/// ones solve `A_ff x_f = b_f - A_fc x_c`: [`Self::free_block`] is `A_ff`, [`Self::coupling`] is `A_fc`.
#[derive(Debug, Clone, PartialEq)]
pub struct Partition {
    free: Vec<u32>,
    fixed: Vec<u32>,
    /// Index among the unknowns of its kind, per unknown of the full system.
    index: Vec<u32>,
    is_free: Vec<bool>,
}

impl Partition {
    /// The partition of `unknowns` unknowns in which those with `is_free` are free.
    ///
    /// # Errors
    /// [`LinalgError::TooLarge`] if they cannot be numbered with 32 bits.
    pub fn new(unknowns: usize, is_free: impl FnMut(usize) -> bool) -> Result<Self, LinalgError> {
        if unknowns > u32::MAX as usize {
            return Err(LinalgError::TooLarge { unknowns, entries: 0 });
        }
        let is_free: Vec<bool> = (0..unknowns).map(is_free).collect();
        let (mut free, mut fixed) = (Vec::new(), Vec::new());
        let index = is_free
            .iter()
            .enumerate()
            .map(|(full, &is_free)| {
                let kind = if is_free { &mut free } else { &mut fixed };
                kind.push(full as u32);
                kind.len() as u32 - 1
            })
            .collect();
        Ok(Self { free, fixed, index, is_free })
    }

    /// Number of unknowns of the full system.
    pub fn unknowns(&self) -> usize {
        self.index.len()
    }

    /// Full index of each free unknown, increasing.
    pub fn free(&self) -> &[u32] {
        &self.free
    }

    /// Full index of each fixed unknown, increasing.
    pub fn fixed(&self) -> &[u32] {
        &self.fixed
    }

    /// Index among the free unknowns, if it is one.
    ///
    /// # Panics
    /// If there is no such unknown.
    pub fn free_index(&self, full: usize) -> Option<usize> {
        self.is_free[full].then(|| self.index[full] as usize)
    }

    /// Index among the fixed unknowns, if it is one.
    ///
    /// # Panics
    /// If there is no such unknown.
    pub fn fixed_index(&self, full: usize) -> Option<usize> {
        (!self.is_free[full]).then(|| self.index[full] as usize)
    }

    /// Entries between free unknowns, in their order in `triplets` and in the numbering of the free unknowns.
    ///
    /// The order depends on places alone, so new values for the same places fit the same
    /// [`SpdPattern`](crate::SpdPattern).
    ///
    /// # Errors
    /// [`LinalgError::IndexOutOfRange`] for the first entry outside the full matrix.
    pub fn free_block(&self, triplets: &[Triplet]) -> Result<Vec<Triplet>, LinalgError> {
        self.check(triplets)?;
        Ok(triplets
            .iter()
            .filter(|t| self.is_free[t.row as usize] && self.is_free[t.col as usize])
            .map(|t| Triplet::new(self.index[t.row as usize], self.index[t.col as usize], t.value))
            .collect())
    }

    /// Entries between a free and a fixed unknown, by rows of free unknowns; entries at one place keep their order.
    ///
    /// # Errors
    /// [`LinalgError::IndexOutOfRange`] for the first entry outside the full matrix.
    pub fn coupling(&self, triplets: &[Triplet]) -> Result<Coupling, LinalgError> {
        self.check(triplets)?;
        // (row among free, column among fixed, value), whichever way round the entry was given.
        let mixed = || {
            triplets.iter().filter_map(|t| {
                let (row, col) = (t.row as usize, t.col as usize);
                match (self.is_free[row], self.is_free[col]) {
                    (true, false) => Some((self.index[row] as usize, self.index[col], t.value)),
                    (false, true) => Some((self.index[col] as usize, self.index[row], t.value)),
                    _ => None,
                }
            })
        };
        let mut offsets = vec![0usize; self.free.len() + 1];
        for (row, ..) in mixed() {
            offsets[row + 1] += 1;
        }
        for row in 0..self.free.len() {
            offsets[row + 1] += offsets[row];
        }
        let mut cursor = offsets.clone();
        let mut entries = vec![(0, 0.0); offsets[self.free.len()]];
        for (row, col, value) in mixed() {
            entries[cursor[row]] = (col, value);
            cursor[row] += 1;
        }
        Ok(Coupling { offsets, entries, fixed: self.fixed.len() })
    }

    fn check(&self, triplets: &[Triplet]) -> Result<(), LinalgError> {
        let unknowns = self.unknowns();
        match triplets.iter().position(|t| t.row.max(t.col) as usize >= unknowns) {
            Some(entry) => {
                let Triplet { row, col, .. } = triplets[entry];
                Err(LinalgError::IndexOutOfRange { entry, row, col, unknowns })
            }
            None => Ok(()),
        }
    }
}

/// The block `A_fc` between free (rows) and fixed (columns) unknowns.
#[derive(Debug, Clone, PartialEq)]
pub struct Coupling {
    /// Row `i` is `entries[offsets[i]..offsets[i + 1]]`.
    offsets: Vec<usize>,
    /// Column and value.
    entries: Vec<(u32, f64)>,
    fixed: usize,
}

impl Coupling {
    /// Number of entries.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether no free unknown is coupled to a fixed one.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// `rhs -= A_fc x`, for three right-hand sides: one row of `rhs` per free, one of `x` per fixed unknown.
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`] if the slices are not of that size; then nothing is changed.
    pub fn subtract_from(&self, rhs: &mut [[f64; 3]], x: &[[f64; 3]]) -> Result<(), LinalgError> {
        let rows = self.offsets.len() - 1;
        for (what, expected, found) in
            [("right-hand side rows", rows, rhs.len()), ("fixed values", self.fixed, x.len())]
        {
            if expected != found {
                return Err(LinalgError::WrongCount { what, expected, found });
            }
        }
        for (row, range) in rhs.iter_mut().zip(self.offsets.windows(2)) {
            for &(col, value) in &self.entries[range[0]..range[1]] {
                for (b, x) in row.iter_mut().zip(x[col as usize]) {
                    *b -= value * x;
                }
            }
        }
        Ok(())
    }
}
