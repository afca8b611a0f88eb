//! The published errors and times that sweeps are compared with.
//!
//! Borosan, Howard, Zhang, Nealen. *Hybrid Mesh Editing.* Eurographics 2010 short papers, Table 1: relative root mean
//! squared edge-length error of an edit of the Armadillo, and its running time, for cages of several sizes and for the
//! shape deformed directly. The paper does not say which of the two definitions of that error it means, nor gives the edit.

/// A row of Table 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PublishedRow {
    /// Vertices of the shape.
    pub vertices: usize,
    /// Vertices of the cage; `None` where the shape was deformed directly.
    pub cage: Option<usize>,
    /// RMS relative edge-length error, as a fraction.
    pub rms: f64,
    /// Time of the edit in milliseconds, on the paper's machine.
    pub ms: f64,
}

const fn row(vertices: usize, cage: Option<usize>, rms: f64, ms: f64) -> PublishedRow {
    PublishedRow { vertices, cage, rms, ms }
}

/// Table 1, in the paper's order.
pub const TABLE_1: [PublishedRow; 9] = [
    row(21_622, Some(1000), 0.0739, 60.0),
    row(21_622, Some(1500), 0.0517, 81.0),
    row(21_622, Some(2000), 0.0451, 91.0),
    row(21_622, Some(4000), 0.0366, 154.0),
    row(21_622, None, 0.0192, 792.0),
    row(43_244, Some(1500), 0.0669, 92.0),
    row(43_244, Some(2000), 0.0543, 116.0),
    row(43_244, Some(5000), 0.0387, 213.0),
    row(43_244, None, 0.0172, 1669.0),
];

/// A shape whose vertex count is this close to a published model's (as a fraction of it) is taken for that model.
const SAME_MODEL: f64 = 0.01;

/// A cage has at least the vertices of a tetrahedron.
const SMALLEST_CAGE: usize = 4;

/// The cage sizes of Table 1 for a shape of some size.
#[derive(Debug, Clone, PartialEq)]
pub struct PaperSizes {
    /// Vertices of the published model they are taken from: the nearer one by ratio.
    pub model_vertices: usize,
    /// Whether the sizes are scaled by the ratio of vertex counts, because the shape is not that model.
    pub scaled: bool,
    /// Each cage size (`None`: no cage) with the published row. Scaled sizes have no published row: it is not theirs.
    pub sizes: Vec<(Option<usize>, Option<PublishedRow>)>,
}

/// The cage sizes of Table 1 for a shape of `vertices` vertices.
///
/// Within 1 % of a published model's vertex count the sizes are the published ones, with their rows; otherwise they are
/// the same fractions of `vertices`, rounded, without rows. Sizes below 4, repeated, or not below `vertices` are left
/// out. "No cage" is always last.
pub fn paper_sizes(vertices: usize) -> PaperSizes {
    // How many times the one is as large as the other, whichever is larger.
    let ratio = |model: usize| {
        let (a, b) = (vertices.max(1) as f64, model as f64);
        (a / b).max(b / a)
    };
    let model_vertices = TABLE_1
        .iter()
        .map(|row| row.vertices)
        .min_by(|&a, &b| ratio(a).total_cmp(&ratio(b)))
        .expect("the table is not empty");
    let scaled = vertices.abs_diff(model_vertices) as f64 > SAME_MODEL * model_vertices as f64;
    let mut sizes: Vec<(Option<usize>, Option<PublishedRow>)> = Vec::new();
    for row in TABLE_1.iter().filter(|row| row.vertices == model_vertices) {
        let fit = |cage: usize| match scaled {
            true => (cage as f64 / model_vertices as f64 * vertices as f64).round() as usize,
            false => cage,
        };
        let cage = row.cage.map(fit);
        let possible = cage.is_none_or(|size| size >= SMALLEST_CAGE && size < vertices);
        if possible && sizes.iter().all(|(other, _)| *other != cage) {
            sizes.push((cage, (!scaled).then_some(*row)));
        }
    }
    PaperSizes { model_vertices, scaled, sizes }
}

impl PaperSizes {
    /// What a reader of a report must know about scaled sizes; `None` when they are the published ones.
    pub fn note(&self) -> Option<String> {
        self.scaled.then(|| {
            format!(
                "Cage sizes are those of Table 1 of Hybrid Mesh Editing (Borosan et al. 2010) for {} vertices, scaled to \
                 this model by fraction; the published errors belong to another mesh and are not shown.",
                self.model_vertices
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cages(sizes: &PaperSizes) -> Vec<Option<usize>> {
        sizes.sizes.iter().map(|(cage, _)| *cage).collect()
    }

    #[test]
    fn published_models_get_the_published_sizes_and_rows() {
        let small = paper_sizes(21_622);
        assert_eq!(cages(&small), [Some(1000), Some(1500), Some(2000), Some(4000), None]);
        let rows: Vec<PublishedRow> = small.sizes.iter().filter_map(|(_, row)| *row).collect();
        assert_eq!(rows, TABLE_1[..5]);
        assert_eq!((small.scaled, small.note()), (false, None));
        // The model that can be had has one vertex less than the published count.
        for vertices in [43_243, 43_244, 43_244 + 432, 43_244 - 432] {
            let large = paper_sizes(vertices);
            assert_eq!(cages(&large), [Some(1500), Some(2000), Some(5000), None], "{vertices}");
            assert!(!large.scaled && large.sizes.iter().all(|(cage, row)| row.is_some_and(|row| row.cage == *cage)));
        }
        assert!(paper_sizes(43_244 + 433).scaled && paper_sizes(43_244 - 433).scaled);
    }

    #[test]
    fn other_models_get_the_nearer_models_sizes_by_fraction_and_no_rows() {
        let sizes = paper_sizes(100_000);
        assert_eq!(sizes.model_vertices, 43_244);
        assert_eq!(cages(&sizes), [Some(3469), Some(4625), Some(11562), None]);
        assert!(sizes.scaled && sizes.sizes.iter().all(|(_, row)| row.is_none()) && sizes.note().is_some());
        // The border between the two models is their geometric mean, 30,578.1.
        assert_eq!((paper_sizes(30_578).model_vertices, paper_sizes(30_579).model_vertices), (21_622, 43_244));
    }

    #[test]
    fn tiny_shapes_get_no_impossible_sizes() {
        for vertices in 0..200 {
            let sizes = paper_sizes(vertices);
            assert_eq!(sizes.sizes.last(), Some(&(None, None)));
            let cages: Vec<usize> = cages(&sizes).into_iter().flatten().collect();
            assert!(cages.iter().all(|&cage| cage >= 4 && cage < vertices), "{vertices}: {cages:?}");
            assert!(cages.windows(2).all(|pair| pair[0] < pair[1]), "{vertices}: {cages:?}");
        }
    }
}
