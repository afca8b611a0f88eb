//! Files that must not be written over.

use std::path::Path;

use anyhow::Result;
use pliant::Model;

use crate::exit::Misuse;

/// Refuses to write over the model's own file or the scene's, by whatever name.
pub(crate) fn check_outputs<'a>(
    model: &Model,
    outputs: impl IntoIterator<Item = &'a Path>,
    scene: Option<&str>,
) -> Result<()> {
    let inputs = [(model.path.as_deref(), "the model"), (scene.map(Path::new), "the scene")];
    for output in outputs {
        for (input, what) in inputs {
            if input.is_some_and(|input| is_same_file(input, output)) {
                let message = format!("{}: this is {what} itself; write to another file", output.display());
                return Err(Misuse(message).into());
            }
        }
    }
    Ok(())
}

/// Whether two paths lead to one file.
pub(crate) fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
