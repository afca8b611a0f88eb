//! What a sweep over many models is asked to be, as people write it: flags, or a plan file.

use std::fmt;
use std::str::FromStr;

use pliant_files::read_regular;
use serde::{Deserialize, Deserializer, Serialize};

use super::{SweepError, SweepPlan};
use crate::settings::SweepSize;

/// A sweep in the words of flags and plan files (TOML or JSON, the same names). Every list that is empty, and every value that is not
/// there, has its default; every combination of what is listed becomes a row.
///
/// ```
/// let plan = pliant_study::SweepSpec::parse(
///     "models = [\"bunny.obj\", \"creature:20000\"]\nsizes = [\"1%..50%\", \"none\"]\nprune = [\"smooth:16\", \"magnitude:0.03\"]\nrepeats = 5\n",
///     "plan.toml",
/// )?;
/// assert_eq!(plan.models.len(), 2);
/// # Ok::<(), pliant_study::SweepError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SweepSpec {
    /// Files, relative to the current folder, or generated shapes (`creature:20000`).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub models: Vec<String>,
    /// Scenes of all these models: names or files. Default: each model's own.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub scenes: Vec<String>,
    /// Further models with scenes of their own.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cases: Vec<SweepCase>,
    /// `paper`: Table 1 of Hybrid Mesh Editing (Borosan et al. 2010) sets all that follows, up to `steps` and `start`, and the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<Preset>,
    /// Cage sizes: `2000`, `5%`, `error:0.002`, `none`, `decimated:3000`, `equal-time:5%`, and ranges of equal ratios: `1%..50%`,
    /// `100..5000:6`. Default: 1 %, 2 %, 5 %, 10 % and none.
    #[serde(skip_serializing_if = "Vec::is_empty", deserialize_with = "words")]
    pub sizes: Vec<String>,
    /// Beside each cage also a decimated mesh, deformed directly in as much time (`equal-time:SIZE`). Default: no.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub equal_time: Option<bool>,
    /// Methods. Default: the scene's own, else `arap`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub methods: Vec<String>,
    /// Ways to propagate. Default: `frames`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub propagation: Vec<String>,
    /// Which weights a binding keeps: `smooth:16`, `magnitude:0.03`, ... Default: `smooth:16`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub prune: Vec<String>,
    /// Iterations in each step: numbers, or `converged`. Default: 2.
    #[serde(skip_serializing_if = "Vec::is_empty", deserialize_with = "words")]
    pub iterations: Vec<String>,
    /// Equal steps in which the handles travel to their goals. Default: 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps: Option<usize>,
    /// What each solve on a cage starts from: `levels` or `pose`. Default: `levels`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<String>,
    /// Whether distances to converged as-rigid-as-possible deformation without a cage are measured, which is found first. Default: yes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<bool>,
    /// Steps of refinement at full resolution after each drag on a cage. Default: 10; 0 for none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refine: Option<usize>,
    /// How often each stage is run to time it. Default: 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repeats: Option<usize>,
    /// Where pictures are seen from: `front`, `left`, `top`, `iso`, ..., or a direction `x,y,z`. Default: as suits the shape.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<String>,
    /// Whether each row has a picture. Default: yes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pictures: Option<bool>,
}

/// A model with scenes of its own.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweepCase {
    /// As in [`SweepSpec::models`].
    pub model: String,
    /// As in [`SweepSpec::scenes`].
    #[serde(default)]
    pub scenes: Vec<String>,
}

/// Settings under one name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// Table 1 of Hybrid Mesh Editing (Borosan et al. 2010): [`SweepPlan::paper`].
    Paper,
}

impl fmt::Display for Preset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("paper")
    }
}

impl FromStr for Preset {
    type Err = SweepError;

    fn from_str(text: &str) -> Result<Self, SweepError> {
        match text {
            "paper" => Ok(Self::Paper),
            _ => Err(SweepError::value("preset", text, &"the only one is paper")),
        }
    }
}

/// No plan needs more; a device or a huge file is refused instead of read to its end.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// More steps, and more repeats, than anyone would wait for.
pub(crate) const MOST: usize = 10_000;

/// Where no sizes are asked for.
const DEFAULT_SIZES: [&str; 5] = ["1%", "2%", "5%", "10%", "none"];

/// Steps of refinement where none are asked for: enough to see where it leads.
const REFINE_STEPS: usize = 10;

impl SweepSpec {
    /// Reads a plan; JSON where `file` ends in `.json`, else TOML. `file` names the text's origin in errors.
    ///
    /// # Errors
    /// Names file, line and what is not understood.
    pub fn parse(text: &str, file: &str) -> Result<Self, SweepError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let bad = |message: String| SweepError::Plan { file: file.to_owned(), message };
        if file.to_ascii_lowercase().ends_with(".json") {
            serde_json::from_str(text).map_err(|error| bad(error.to_string()))
        } else {
            toml::from_str(text).map_err(|error| bad(error.to_string().trim_end().to_owned()))
        }
    }

    /// Reads a plan file of at most 1 MiB.
    ///
    /// # Errors
    /// As [`Self::parse`]; the file cannot be read or is too large.
    pub fn read(path: &std::path::Path) -> Result<Self, SweepError> {
        let file = path.display().to_string();
        let bytes = read_regular(path, MAX_FILE_BYTES)?;
        let text = String::from_utf8(bytes)
            .map_err(|_| SweepError::Plan { file: file.clone(), message: "not UTF-8 text".to_owned() })?;
        Self::parse(&text, &file)
    }

    /// Models with their scenes; `None` for a model's own.
    pub(super) fn all_cases(&self) -> Vec<(&str, Vec<Option<&str>>)> {
        let own = self.models.iter().map(|model| (model, &self.scenes));
        let others = self.cases.iter().map(|case| (&case.model, &case.scenes));
        let scenes = |scenes: &'_ [String]| match scenes {
            [] => vec![None],
            _ => (0..scenes.len()).map(Some).collect::<Vec<_>>(),
        };
        own.chain(others)
            .map(|(model, named)| {
                let scenes = scenes(named).into_iter().map(|k| k.map(|k| named[k].as_str()));
                (model.as_str(), scenes.collect())
            })
            .collect()
    }

    /// The rows for one model and scene. `vertices` is asked for by the preset alone; `scene_method` is what the scene names.
    ///
    /// # Errors
    /// The first value that cannot be read.
    pub(super) fn plan(
        &self,
        scene_method: Option<pliant_deform::Method>,
        vertices: impl FnOnce() -> Result<usize, SweepError>,
    ) -> Result<SweepPlan, SweepError> {
        let mut plan = match self.preset {
            Some(Preset::Paper) => SweepPlan::paper(vertices()?),
            None => {
                let sizes = self.sizes.iter().map(|text| SweepSize::parse_range(text));
                let sizes = sizes.collect::<Result<Vec<_>, _>>()?.concat();
                let default = || DEFAULT_SIZES.iter().map(|text| text.parse()).collect::<Result<Vec<_>, _>>();
                let mut plan = SweepPlan {
                    sizes: if sizes.is_empty() { default()? } else { sizes },
                    methods: vec![scene_method.unwrap_or_default()],
                    ..SweepPlan::default()
                };
                fill(&mut plan.propagations, "propagation", &self.propagation)?;
                fill(&mut plan.bindings, "prune", &self.prune)?;
                fill(&mut plan.iterations, "iterations", &self.iterations)?;
                plan.steps = within("steps", self.steps, plan.steps, 1..=MOST)?;
                if let Some(start) = &self.start {
                    plan.start = start.parse()?;
                }
                plan
            }
        };
        // Methods that are named replace the paper's.
        fill(&mut plan.methods, "methods", &self.methods)?;
        if self.equal_time.unwrap_or(false) {
            plan.sizes = with_equal_time(&plan.sizes);
        }
        plan.reference = self.reference.unwrap_or(true);
        plan.refine_steps = within("refine", self.refine, REFINE_STEPS, 0..=MOST)?;
        plan.repeats = within("repeats", self.repeats, 1, 1..=MOST)?;
        Ok(plan)
    }
}

/// Each cage followed by its partner, once.
fn with_equal_time(sizes: &[SweepSize]) -> Vec<SweepSize> {
    let mut all: Vec<SweepSize> = Vec::new();
    for &size in sizes {
        let partner = match size {
            SweepSize::Cage(size) => Some(SweepSize::EqualTime(size)),
            _ => None,
        };
        for size in [Some(size), partner].into_iter().flatten() {
            if !all.contains(&size) {
                all.push(size);
            }
        }
    }
    all
}

/// Replaces a list by what is written, if anything is.
fn fill<T: FromStr<Err: fmt::Display>>(
    list: &mut Vec<T>,
    what: &'static str,
    texts: &[String],
) -> Result<(), SweepError> {
    if !texts.is_empty() {
        let read = |text: &String| text.parse().map_err(|error: T::Err| SweepError::value(what, text, &error));
        *list = texts.iter().map(read).collect::<Result<_, _>>()?;
    }
    Ok(())
}

fn within(
    what: &'static str,
    asked: Option<usize>,
    default: usize,
    range: std::ops::RangeInclusive<usize>,
) -> Result<usize, SweepError> {
    let n = asked.unwrap_or(default);
    let limits = || format!("use {} to {}", range.start(), range.end());
    if range.contains(&n) { Ok(n) } else { Err(SweepError::value(what, &n.to_string(), &limits())) }
}

/// A list of texts in which whole numbers may stand without quotes.
fn words<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<String>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Word {
        Number(u64),
        Text(String),
    }
    let words = Vec::<Word>::deserialize(from)?;
    Ok(words
        .into_iter()
        .map(|word| match word {
            Word::Number(n) => n.to_string(),
            Word::Text(text) => text,
        })
        .collect())
}
