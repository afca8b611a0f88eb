use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::CageError;

/// Which weights of a row are kept.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Prune {
    /// All mean value coordinates: every cage vertex moves every shape vertex.
    None,
    /// Mean value coordinates less the smallest, as long as the dropped magnitudes sum to at most this share
    /// of the row's; the rest is scaled to sum 1. 0.03 is the rule of Borosan et al. 2010, Section 3.
    ///
    /// Faithful to the paper, but where a tight cage folds over thin parts rows grow huge
    /// and far-reaching weights; [`BindReport::unsafe_rows`](crate::BindReport::unsafe_rows) counts them.
    Magnitude(f64),
    /// The positive part of the mean value coordinates of the nearest cage vertices, fading out towards the first one left out,
    /// `max(c_j, 0) * (1 - d_j / d_(k+1))` with `d` the distances in space, in equal parts with the weights of
    /// [`Prune::Smooth`]; these take more where coordinates lie beyond the nearest vertices, and all at a cage vertex, so that
    /// surfaces stay smooth across it. 24 neighbours are usual.
    Local {
        /// Cage vertices per row, at least 1; a few more where some count in part only ([`Support::Surface`](crate::Support::Surface)).
        neighbours: usize,
    },
    /// `(1 - d_j / d_(k+1))^2` over the nearest cage vertices, without coordinates: never unsafe, and made in half the
    /// time. The default, with 16 neighbours.
    Smooth {
        /// Cage vertices per row, at least 1; see [`Prune::Local`].
        neighbours: usize,
    },
}

impl Default for Prune {
    fn default() -> Self {
        Self::Smooth { neighbours: 16 }
    }
}

impl Prune {
    /// The paper's rule: 3 % of each row's magnitude dropped.
    pub const PAPER: Self = Self::Magnitude(0.03);

    pub(crate) fn check(self) -> Result<(), CageError> {
        let bad = |what, found: String| Err(CageError::BadOption { what, found });
        match self {
            Self::Magnitude(share) if !(0.0..1.0).contains(&share) => {
                bad("the share of magnitude to drop (0 to below 1)", share.to_string())
            }
            Self::Local { neighbours: 0 } | Self::Smooth { neighbours: 0 } => {
                bad("the number of neighbours (1 or more)", "0".to_owned())
            }
            _ => Ok(()),
        }
    }
}

impl fmt::Display for Prune {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => write!(f, "none"),
            Self::Magnitude(share) => write!(f, "magnitude:{share}"),
            Self::Local { neighbours } => write!(f, "local:{neighbours}"),
            Self::Smooth { neighbours } => write!(f, "smooth:{neighbours}"),
        }
    }
}

/// Reads `none`, `magnitude:0.03`, `magnitude:3%`, `local:24` or `smooth:16`; a rule without a number takes the one named here.
impl FromStr for Prune {
    type Err = CageError;

    fn from_str(text: &str) -> Result<Self, CageError> {
        let bad = || CageError::BadPrune { found: text.to_owned() };
        let (rule, number) = match text.split_once(':') {
            Some((rule, number)) => (rule, Some(number)),
            None => (text, None),
        };
        let neighbours = |usual| number.map_or(Ok(usual), |n| n.parse().map_err(|_| bad()));
        let prune = match rule {
            "none" if number.is_none() => Self::None,
            "magnitude" => Self::Magnitude(match number {
                None => 0.03,
                Some(n) => match n.strip_suffix('%') {
                    Some(percent) => percent.parse::<f64>().map_err(|_| bad())? / 100.0,
                    None => n.parse().map_err(|_| bad())?,
                },
            }),
            "local" => Self::Local { neighbours: neighbours(24)? },
            "smooth" => Self::Smooth { neighbours: neighbours(16)? },
            _ => return Err(bad()),
        };
        prune.check()?;
        Ok(prune)
    }
}

/// Drops the smallest magnitudes of a row while their sum stays within `share` of the row's, in linear time.
///
/// `entries` are (vertex, weight); on equal magnitudes the higher vertex goes first. The order of what is kept is unspecified
/// but the same on every run.
pub(crate) fn drop_smallest(entries: &mut Vec<(u32, f64)>, share: f64) {
    let budget = share * magnitude(entries);
    drop_within(entries, budget);
}

/// Sum of the weights' magnitudes.
pub(crate) fn magnitude(entries: &[(u32, f64)]) -> f64 {
    entries.iter().map(|e| e.1.abs()).sum()
}

/// Drops the smallest magnitudes while their sum stays within `budget`, as [`drop_smallest`] does; returns what is left of
/// the budget.
pub(crate) fn drop_within(entries: &mut Vec<(u32, f64)>, mut budget: f64) -> f64 {
    entries.retain(|e| e.1 != 0.0);
    let ascending = |a: &(u32, f64), b: &(u32, f64)| a.1.abs().total_cmp(&b.1.abs()).then(b.0.cmp(&a.0));
    // Weighted selection: everything before `start` is dropped, everything from `end` on is kept.
    let (mut start, mut end) = (0, entries.len());
    while start < end {
        let half = (end - start) / 2;
        let open = &mut entries[start..end];
        open.select_nth_unstable_by(half, ascending);
        // The lower half and the pivot.
        let lower = magnitude(&open[..=half]);
        if lower <= budget {
            budget -= lower;
            start += half + 1;
        } else if half == 0 {
            break;
        } else {
            end = start + half;
        }
    }
    entries.drain(..start);
    budget
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the definition: sort, then drop from the small end while the sum stays within the budget.
    #[test]
    fn drops_what_sorting_would_drop() {
        for n in 0..60u32 {
            for share in [0.0, 0.03, 0.3, 0.9] {
                let row: Vec<(u32, f64)> = (0..n)
                    .map(|i| (i, (f64::from(i) * 1.7 + f64::from(n)).sin() * 0.1_f64.powi((i % 5) as i32)))
                    .collect();
                let mut sorted = row.clone();
                sorted.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
                let mut budget = share * row.iter().map(|e| e.1.abs()).sum::<f64>();
                while let Some(&(_, w)) = sorted.last().filter(|e| e.1.abs() <= budget) {
                    budget -= w.abs();
                    sorted.pop();
                }
                let mut kept = row;
                drop_smallest(&mut kept, share);
                kept.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
                assert_eq!(kept, sorted, "{n} entries, share {share}");
            }
        }
    }

    #[test]
    fn rules_read_as_they_are_written() {
        for rule in [Prune::None, Prune::PAPER, Prune::Local { neighbours: 12 }, Prune::Smooth { neighbours: 8 }] {
            assert_eq!(rule.to_string().parse(), Ok(rule));
        }
        assert_eq!("magnitude:3%".parse(), Ok(Prune::PAPER));
        assert_eq!("local".parse(), Ok(Prune::Local { neighbours: 24 }));
        assert_eq!("smooth".parse(), Ok(Prune::default()));
        for wrong in ["", "local:0", "local:-1", "magnitude:1", "magnitude:nan", "none:3", "nearest:4"] {
            assert!(wrong.parse::<Prune>().is_err(), "{wrong}");
        }
    }
}
