//! Where a camera stands, and how people write it.

use std::fmt;
use std::str::FromStr;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::PictureError;

/// Where the camera stands and which way is up.
///
/// As text, in JSON too: `front`, `back`, `left`, `right`, `top`, `bottom` or `iso`; a direction `x,y,z`, with y up; or a direction
/// and what is up, `x,y,z,ux,uy,uz`. The shape is taken to stand on the plane y = 0 and to face +z; left and right are those of the
/// picture seen from the front, at -x and +x.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct View {
    /// Direction from the mesh to the camera; any length but 0.
    pub from: DVec3,
    /// Direction that points up in the picture; another one is taken if it is along `from`.
    pub up: DVec3,
}

impl Default for View {
    /// From the front (+z), somewhat from the right (+x) and from above, with y up.
    fn default() -> Self {
        Self { from: DVec3::new(0.55, 0.28, 1.0), up: DVec3::Y }
    }
}

/// Seen from above, the front is at the bottom of the picture; from below, at its top.
const NAMED: [(&str, View); 7] = [
    ("front", View { from: DVec3::Z, up: DVec3::Y }),
    ("back", View { from: DVec3::NEG_Z, up: DVec3::Y }),
    ("left", View { from: DVec3::NEG_X, up: DVec3::Y }),
    ("right", View { from: DVec3::X, up: DVec3::Y }),
    ("top", View { from: DVec3::Y, up: DVec3::NEG_Z }),
    ("bottom", View { from: DVec3::NEG_Y, up: DVec3::Z }),
    ("iso", View { from: DVec3::ONE, up: DVec3::Y }),
];

/// The name if it has one, else the numbers; what is up only if that is not y.
impl fmt::Display for View {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((name, _)) = NAMED.iter().find(|(_, view)| view == self) {
            return f.write_str(name);
        }
        let Self { from, up } = self;
        write!(f, "{},{},{}", from.x, from.y, from.z)?;
        if *up == DVec3::Y { Ok(()) } else { write!(f, ",{},{},{}", up.x, up.y, up.z) }
    }
}

impl FromStr for View {
    type Err = PictureError;

    fn from_str(text: &str) -> Result<Self, PictureError> {
        let named = NAMED.iter().find(|(name, _)| *name == text.trim()).map(|(_, view)| *view);
        named.or_else(|| from_numbers(text)).ok_or_else(|| {
            let names: Vec<&str> = NAMED.iter().map(|(name, _)| *name).collect();
            let expected = format!(
                "{}, or a direction x,y,z that is not 0, if you like with the direction that is up: x,y,z,ux,uy,uz",
                names.join(", ")
            );
            PictureError::bad("view", expected, format!("`{text}`"))
        })
    }
}

/// Three numbers, or six.
fn from_numbers(text: &str) -> Option<View> {
    let numbers: Vec<f64> = text.split(',').map(|part| part.trim().parse().ok()).collect::<Option<_>>()?;
    // Of a length that can be divided by, which NaN and infinity have not.
    let direction = |part: &[f64]| Some(DVec3::from_slice(part)).filter(|v| v.try_normalize().is_some());
    match numbers.len() {
        3 => Some(View { from: direction(&numbers)?, up: DVec3::Y }),
        6 => Some(View { from: direction(&numbers[..3])?, up: direction(&numbers[3..])? }),
        _ => None,
    }
}

impl TryFrom<String> for View {
    type Error = PictureError;

    fn try_from(text: String) -> Result<Self, PictureError> {
        text.parse()
    }
}

impl From<View> for String {
    fn from(view: View) -> Self {
        view.to_string()
    }
}
