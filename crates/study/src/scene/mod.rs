//! Scenes: edit scripts that name handle regions by geometry.
//!
//! A scene says where the handles are and where they go in coordinates of the shape's bounding box, so one scene fits
//! every resolution of a shape and every cage of it. As JSON:
//!
//! ```json
//! { "name": "nod", "description": "The head turns.", "handles": [
//!   { "name": "feet", "region": { "box": { "max": [null, 0.12, null] } } },
//!   { "name": "head", "region": { "sphere": { "centre": [0.5, 0.9, 0.7], "radius": 0.1 } },
//!     "motion": { "rotate": { "axis": [0, 1, 0], "degrees": 35 }, "about": [0.5, 0.8, 0.4] } } ] }
//! ```
//!
//! On a shape it becomes vertices and transforms:
//!
//! ```
//! use glam::DVec3;
//! use pliant_mesh::TriMesh;
//! use pliant_study::Scene;
//!
//! let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Z, 2.0 * DVec3::Y];
//! let shape = TriMesh::new(corners, vec![[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])?;
//! let scene = Scene::auto(&shape.bounds()).resolve(&shape)?;
//! assert_eq!(scene.handles[0].vertices.as_slice(), [0, 1, 2]); // The low end of the longest axis is held,
//! assert_eq!(scene.handles[1].vertices.as_slice(), [3]); // and the high end turned.
//! assert_eq!(scene.goals(0.5)[0].apply(DVec3::X), DVec3::X);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod auto;
mod check;
mod error;
mod method_text;
mod resolve;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use glam::DVec3;
use pliant_deform::Method;
use pliant_mesh::Bounds;
use serde::{Deserialize, Serialize};

pub use error::SceneError;
pub use resolve::{ResolvedHandle, ResolvedScene};

/// No scene needs more; a device or a huge file is refused instead of read to its end.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// The scenes that come with the library; the file's stem is the scene's name.
const BUILTIN: [(&str, &str); 10] = [
    ("armadillo-0", include_str!("../../../../data/scenes/armadillo-0.json")),
    ("armadillo-2", include_str!("../../../../data/scenes/armadillo-2.json")),
    ("bar-twist-135", include_str!("../../../../data/scenes/bar-twist-135.json")),
    ("bar-twist-270", include_str!("../../../../data/scenes/bar-twist-270.json")),
    ("bar-twist-720", include_str!("../../../../data/scenes/bar-twist-720.json")),
    ("cactus-bend-70", include_str!("../../../../data/scenes/cactus-bend-70.json")),
    ("creature", include_str!("../../../../data/scenes/creature.json")),
    ("creature-tail", include_str!("../../../../data/scenes/creature-tail.json")),
    ("cylinder-bend-120", include_str!("../../../../data/scenes/cylinder-bend-120.json")),
    ("plane-lift", include_str!("../../../../data/scenes/plane-lift.json")),
];

/// Those among them that papers on deformation show, each made for a generated shape.
const CLASSIC: [&str; 7] = [
    "bar-twist-135",
    "bar-twist-270",
    "bar-twist-720",
    "cylinder-bend-120",
    "plane-lift",
    "cactus-bend-70",
    "creature-tail",
];

/// An edit script for a shape in a known pose, at any resolution.
///
/// *Box coordinates* run from 0 to 1 along each axis of the shape's bounding box; lengths are fractions of its diagonal;
/// directions are in model space.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// What reports and errors call it.
    pub name: String,
    /// For people.
    #[serde(default)]
    pub description: String,
    /// The generated shape that the scene is made for, by its name in [`shapes::NAMES`](pliant_mesh::shapes::NAMES); none for a scene of a
    /// model in a file. It fits others too, as far as their handles have vertices there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<String>,
    /// The method that deforms, as text (`"arap:uniform+spokes"`), where none is asked for; none for the default.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "method_text")]
    pub method: Option<Method>,
    /// The handles, each under its own name. A vertex in several regions belongs to the first.
    pub handles: Vec<SceneHandle>,
}

/// A region that is held or moved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneHandle {
    /// Unique in its scene.
    pub name: String,
    /// Which vertices it takes.
    pub region: SceneRegion,
    /// Where they go; without it they are held where they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<SceneMotion>,
}

/// A set of vertices described by geometry.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SceneRegion {
    /// Vertices whose box coordinates are between `min` and `max`, the limits included.
    ///
    /// A component that is `null` (`None`), or a side left out, sets no limit.
    Box {
        /// Smallest box coordinates.
        #[serde(default, skip_serializing_if = "is_unlimited")]
        min: [Option<f64>; 3],
        /// Largest box coordinates.
        #[serde(default, skip_serializing_if = "is_unlimited")]
        max: [Option<f64>; 3],
    },
    /// Vertices at most `radius` from a point: a true ball in space, however long the bounding box is.
    Sphere {
        /// In box coordinates.
        #[serde(alias = "center")]
        centre: DVec3,
        /// Fraction of the diagonal, not negative.
        radius: f64,
    },
    /// Vertices on the side of a plane that the normal points to, the plane included.
    HalfSpace {
        /// A point of the plane, in box coordinates.
        point: DVec3,
        /// A direction in model space, of any length but 0.
        normal: DVec3,
    },
    /// Vertices at most `radius`, measured along edges, from the vertex nearest to a point.
    ///
    /// Does not leak to a limb that is near in space but far along the surface. Vertices without faces are never nearest.
    Geodesic {
        /// In box coordinates.
        near: DVec3,
        /// Fraction of the diagonal, not negative; 0 takes the nearest vertex alone.
        radius: f64,
    },
    /// Vertices in every one of these.
    All(Vec<SceneRegion>),
    /// Vertices in at least one of these.
    Any(Vec<SceneRegion>),
}

/// Turn and scale about a pivot, then move.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneMotion {
    /// The turn, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotate: Option<SceneRotation>,
    /// Pivot of turn and scale in box coordinates of the shape. Default: the centre of the bounding box of the handle's vertices.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub about: Option<DVec3>,
    /// Along the axes of model space, in fractions of the diagonal. Default: nowhere.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub translate: DVec3,
    /// Positive. Default: 1.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub scale: f64,
}

/// A turn about an axis by the right-hand rule.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneRotation {
    /// A direction in model space, of any length but 0.
    pub axis: DVec3,
    /// May exceed a full turn: 720 goes round twice.
    pub degrees: f64,
}

impl Default for SceneMotion {
    /// Stays in place.
    fn default() -> Self {
        Self { rotate: None, about: None, translate: DVec3::ZERO, scale: 1.0 }
    }
}

impl Scene {
    /// Reads a scene from JSON text; `file` names its origin in errors.
    ///
    /// # Errors
    /// Names file, line and column of what is not JSON, missing, unknown or of the wrong kind, else as [`Scene::check`].
    pub fn parse(json: &[u8], file: &str) -> Result<Self, SceneError> {
        // Some editors put a byte-order mark first, which JSON does not know.
        let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
        let scene: Self = serde_json::from_slice(json).map_err(|error| {
            let text = error.to_string();
            // serde_json ends its message with the place, which stands before the message here.
            let place = format!(" at line {} column {}", error.line(), error.column());
            let message = text.strip_suffix(&place).unwrap_or(&text).to_owned();
            SceneError::Syntax { file: file.to_owned(), line: error.line(), column: error.column(), message }
        })?;
        scene.check().map_err(|error| SceneError::InFile { file: file.to_owned(), error: Box::new(error) })?;
        Ok(scene)
    }

    /// Reads a scene file.
    ///
    /// # Errors
    /// The file cannot be read or has more than 1 MiB; else as [`Scene::parse`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self, SceneError> {
        let file = path.as_ref().display().to_string();
        let read = || {
            let mut bytes = Vec::new();
            File::open(path.as_ref())?.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes)?;
            if bytes.len() as u64 > MAX_FILE_BYTES {
                return Err(std::io::Error::other(format!(
                    "a scene has at most {MAX_FILE_BYTES} bytes, this has more"
                )));
            }
            Ok(bytes)
        };
        match read() {
            Ok(bytes) => Self::parse(&bytes, &file),
            Err(error) => Err(SceneError::Read { file, error }),
        }
    }

    /// The scene as indented JSON, ending with a line break; [`Scene::parse`] reads it back as it was.
    ///
    /// # Errors
    /// As [`Scene::check`]: JSON could not hold a number that is not finite.
    pub fn to_json(&self) -> Result<String, SceneError> {
        self.check()?;
        Ok(serde_json::to_string_pretty(self).expect("every key is a string and every number is finite") + "\n")
    }

    /// A scene that comes with the library.
    ///
    /// # Errors
    /// There is none of that name; the error lists the names.
    pub fn builtin(name: &str) -> Result<Self, SceneError> {
        match BUILTIN.iter().find(|(known, _)| *known == name) {
            Some((_, json)) => Self::parse(json.as_bytes(), &format!("data/scenes/{name}.json")),
            None => {
                let known = std::iter::once("auto").chain(Self::builtin_names()).collect::<Vec<_>>().join(", ");
                Err(SceneError::UnknownName { name: name.to_owned(), known })
            }
        }
    }

    /// Names that [`Scene::builtin`] takes.
    pub fn builtin_names() -> impl Iterator<Item = &'static str> {
        BUILTIN.iter().map(|(name, _)| *name)
    }

    /// Names of the built-in scenes that papers on deformation show; each has a [`Scene::shape`].
    pub fn classic_names() -> impl Iterator<Item = &'static str> {
        CLASSIC.into_iter()
    }

    /// The scene a user named: `auto`, else a built-in scene's name, else a file.
    ///
    /// `bounds` is the shape's bounding box, which `auto` is made for. Write `./auto` for a file of that name.
    ///
    /// # Errors
    /// As [`Scene::read`]; a name without a dot or a separator is reported as an unknown built-in scene if no such file exists.
    pub fn find(name: &str, bounds: &Bounds) -> Result<Self, SceneError> {
        if name == "auto" {
            return Ok(Self::auto(bounds));
        }
        match Self::builtin(name) {
            Err(SceneError::UnknownName { .. }) if Path::new(name).exists() || name.contains(['.', '/', '\\']) => {
                Self::read(name)
            }
            found => found,
        }
    }
}

fn is_unlimited(side: &[Option<f64>; 3]) -> bool {
    side.iter().all(Option::is_none)
}

fn is_zero(v: &DVec3) -> bool {
    *v == DVec3::ZERO
}

fn one() -> f64 {
    1.0
}

fn is_one(scale: &f64) -> bool {
    *scale == 1.0
}
