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
    let inputs = [(model.path.as_deref(), "the model itself"), (scene.map(Path::new), "the scene itself")];
    let inputs = || inputs.into_iter().filter_map(|(input, what)| Some((input?, what)));
    outputs.into_iter().try_for_each(|output| check_not_read(output, inputs()))
}

/// Refuses an output that is one of some inputs, by whatever name; each comes with what it is.
pub(crate) fn check_not_read<'a>(
    output: &Path,
    inputs: impl IntoIterator<Item = (&'a Path, &'static str)>,
) -> Result<()> {
    match inputs.into_iter().find(|(input, _)| is_same_file(input, output)) {
        Some((_, what)) => Err(Misuse(format!("{}: this is {what}; write to another file", output.display())).into()),
        None => Ok(()),
    }
}

/// Whether two paths lead to one file.
fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
