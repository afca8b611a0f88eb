//! How a call ends, as a number that scripts can rely on.

use std::collections::HashSet;
use std::error::Error;
use std::fmt;
use std::process::ExitCode;

use pliant::{
    CageError, DeformError, Failure, FailureKind, FileError, FormatError, GateError, IoError, MeshError, ModelError,
    PictureError, ReportError, SceneError, SessionError, StudyError, SweepError, SweepReport, SweepRow,
};

/// Ends of a call, with their exit codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Ending {
    Done = 0,
    Regression = 1,
    Misuse = 2,
    BadInput = 3,
    Numeric = 4,
    System = 5,
    Internal = 70,
}

/// What `--help` says of them.
pub(crate) const TABLE: &str = "\
Exit codes:
   0  done; a check passes
   1  a check found a regression
   2  wrong use: arguments that make no sense
   3  bad input data: a model, scene, plan, document or baseline cannot be read or used; a sweep does its other models, and
      writes the report
   4  a computation failed numerically; where there are many, the others are done and the report is written
   5  the system failed: a result could not be written, a thread not started
  70  internal error: please report it";

impl From<Ending> for ExitCode {
    fn from(ending: Ending) -> Self {
        Self::from(ending as u8)
    }
}

/// Wrong use that only the command itself can see.
#[derive(Debug)]
pub(crate) struct Misuse(pub(crate) String);

impl fmt::Display for Misuse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl Error for Misuse {}

impl Ending {
    /// What an error ends in: the first of its causes that says.
    pub(crate) fn of(error: &anyhow::Error) -> Self {
        error.chain().find_map(of_cause).unwrap_or(Self::System)
    }

    /// What rows without figures end in. Rows that cannot be made of what was given, such as cages too small for a scene, belong to a sweep
    /// unless a model has no others.
    pub(crate) fn of_rows<'r>(rows: impl Iterator<Item = &'r SweepRow> + Clone) -> Self {
        let ending = |row: &SweepRow| row.failure.as_ref().map_or(Self::Done, Self::of_failure);
        let made: HashSet<&str> =
            rows.clone().filter(|row| row.failure.is_none()).map(|row| row.model.as_str()).collect();
        let counts = |row: &&SweepRow| ending(row) != Self::BadInput || !made.contains(row.model.as_str());
        let nothing = rows.clone().next().is_none();
        rows.filter(counts).map(ending).max().unwrap_or(if nothing { Self::BadInput } else { Self::Done })
    }

    /// What a report ends in: as its rows do, or in bad input if a model was refused.
    pub(crate) fn of_report(report: &SweepReport) -> Self {
        let refused = if report.refused.is_empty() { Self::Done } else { Self::BadInput };
        Self::of_rows(report.rows.iter()).max(refused)
    }

    fn of_failure(failure: &Failure) -> Self {
        match failure.kind {
            FailureKind::Input => Self::BadInput,
            FailureKind::Numeric => Self::Numeric,
            FailureKind::Internal => Self::Internal,
        }
    }
}

fn of_cause(cause: &(dyn Error + 'static)) -> Option<Ending> {
    let cause = Cause(cause);
    if cause.0.is::<Misuse>() {
        return Some(Ending::Misuse);
    }
    cause
        .when(of_sweep)
        .or_else(|| cause.when(of_gate))
        .or_else(|| cause.when(of_model))
        .or_else(|| cause.when(of_study))
        .or_else(|| cause.when(of_session))
        .or_else(|| cause.when(of_scene))
        .or_else(|| cause.when(of_deform))
        .or_else(|| cause.when(of_cage))
        .or_else(|| cause.when(of_mesh))
        .or_else(|| cause.when(of_io))
        .or_else(|| cause.when(of_file))
        .or_else(|| cause.when(|_: &FormatError| Ending::Misuse))
        .or_else(|| cause.when(|_: &PictureError| Ending::BadInput))
        .or_else(|| cause.when(|_: &ReportError| Ending::BadInput))
}

struct Cause<'a>(&'a (dyn Error + 'static));

impl Cause<'_> {
    fn when<E: Error + 'static>(&self, ending: impl FnOnce(&E) -> Ending) -> Option<Ending> {
        self.0.downcast_ref().map(ending)
    }
}

fn of_file(error: &FileError) -> Ending {
    if error.is_writing() { Ending::System } else { Ending::BadInput }
}

fn of_io(error: &IoError) -> Ending {
    match error {
        IoError::File(error) => of_file(error),
        // The name of a result has the wrong ending.
        IoError::Extension { action: "write", .. } => Ending::Misuse,
        _ => Ending::BadInput,
    }
}

fn of_mesh(error: &MeshError) -> Ending {
    match error {
        // Of a generated shape.
        MeshError::BadParameter { .. } => Ending::Misuse,
        _ => Ending::BadInput,
    }
}

fn of_cage(error: &CageError) -> Ending {
    match error {
        CageError::BadOption { .. } | CageError::BadPrune { .. } => Ending::Misuse,
        CageError::Mesh(error) => of_mesh(error),
        _ => Ending::BadInput,
    }
}

fn of_deform(error: &DeformError) -> Ending {
    match error {
        DeformError::BadOption { .. } => Ending::Misuse,
        _ if error.is_numeric() => Ending::Numeric,
        _ => Ending::BadInput,
    }
}

fn of_scene(error: &SceneError) -> Ending {
    match error {
        SceneError::UnknownName { .. } => Ending::Misuse,
        _ => Ending::BadInput,
    }
}

fn of_study(error: &StudyError) -> Ending {
    match error {
        StudyError::Scene(error) => of_scene(error),
        StudyError::Cage(error) => of_cage(error),
        StudyError::Deform(error) => of_deform(error),
        StudyError::Internal { .. } => Ending::Internal,
        StudyError::BadSize { .. }
        | StudyError::BadRange { .. }
        | StudyError::BadStart { .. }
        | StudyError::BadIterations { .. } => Ending::Misuse,
        _ => Ending::BadInput,
    }
}

fn of_session(error: &SessionError) -> Ending {
    match error {
        SessionError::Cage(error) => of_cage(error),
        SessionError::Deform(error) => of_deform(error),
        SessionError::File(error) => of_file(error),
        SessionError::Step { source, .. } => of_session(source),
        _ => Ending::BadInput,
    }
}

fn of_model(error: &ModelError) -> Ending {
    match error {
        ModelError::BadCount { .. } => Ending::Misuse,
        ModelError::Io(error) => of_io(error),
        ModelError::Mesh(error) => of_mesh(error),
        _ => Ending::BadInput,
    }
}

fn of_sweep(error: &SweepError) -> Ending {
    match error {
        SweepError::File(error) => of_file(error),
        SweepError::Scene(error) => of_scene(error),
        SweepError::Model(error) => of_model(error),
        SweepError::NoModels | SweepError::NoSuchJob { .. } | SweepError::NoArray { .. } => Ending::Misuse,
        // Other values that are typed are read before they come to a plan.
        SweepError::Value { what: "shard", .. } => Ending::Misuse,
        _ => Ending::BadInput,
    }
}

fn of_gate(error: &GateError) -> Ending {
    match error {
        GateError::BadTolerance { .. } | GateError::NoSuchFigure { .. } => Ending::Misuse,
        GateError::Read(error) => of_file(error),
        GateError::Model(error) => of_model(error),
        _ => Ending::BadInput,
    }
}
