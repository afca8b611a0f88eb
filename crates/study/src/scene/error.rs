use thiserror::Error;

/// What is wrong with a scene, naming the file and line, or the scene and handle.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The file could not be read.
    #[error("{file}: {error}")]
    Read {
        /// The file.
        file: String,
        /// What the system said.
        error: std::io::Error,
    },
    /// The text is not a scene.
    #[error("{file}:{line}:{column}: {message}")]
    Syntax {
        /// The file, or what else the text was taken from.
        file: String,
        /// Line, numbered from 1.
        line: usize,
        /// Column in bytes, numbered from 1; 0 at a line's start.
        column: usize,
        /// What is wrong there.
        message: String,
    },
    /// A value is outside its range.
    #[error("scene {scene}{}: {what} must be {expected}, not {found}", of_handle(.handle.as_deref()))]
    BadValue {
        /// The scene's name.
        scene: String,
        /// The handle, unless the fault is the scene's own.
        handle: Option<String>,
        /// Path of the value, as `region.all[1].sphere.radius`.
        what: String,
        /// The values it takes.
        expected: &'static str,
        /// The value given.
        found: String,
    },
    /// A handle has no vertex on this shape.
    #[error("scene {scene}, handle '{handle}': {reason}")]
    EmptyHandle {
        /// The scene's name.
        scene: String,
        /// The handle.
        handle: String,
        /// Whether the region is empty or earlier handles hold all of it.
        reason: &'static str,
    },
    /// The shape has no size that regions could be measured by.
    #[error("scene {scene}: the shape's bounding box has a diagonal of {diagonal}, so regions mean nothing on it")]
    NoExtent {
        /// The scene's name.
        scene: String,
        /// Length of the diagonal, in units of the model.
        diagonal: f64,
    },
    /// No scene of that name is built in.
    #[error("there is no built-in scene '{name}'; there are {known}")]
    UnknownName {
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// A scene read from a file is at fault.
    #[error("{file}: {error}")]
    InFile {
        /// The file.
        file: String,
        /// The fault.
        error: Box<SceneError>,
    },
}

fn of_handle(handle: Option<&str>) -> String {
    handle.map_or_else(String::new, |handle| format!(", handle '{handle}'"))
}
