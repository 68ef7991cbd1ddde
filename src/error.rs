//! Errors and warnings, each with its place and its remedy.
//!
//! Every error carries the exit code of the command that meets it (`ExitCode`), so that `main` never guesses.

use std::fmt;
use std::path::PathBuf;

/// What a command returns to the shell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ExitCode {
    Done = 0,
    /// Failure at run time (I/O, native library, out of memory).
    Runtime = 1,
    /// Usage or scene error: nothing was rendered and no file was written.
    Scene = 2,
    /// A check failed, or the health limit was passed.
    Check = 3,
    /// Resume or merge mismatch, or the output exists.
    Mismatch = 4,
}

/// A place in a text file, 1-based. `line == 0` means "the file as a whole".
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Span {
    pub file: PathBuf,
    pub line: u32,
    pub column: u32,
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.line == 0 {
            write!(f, "{}", self.file.display())
        } else {
            write!(f, "{}:{}:{}", self.file.display(), self.line, self.column)
        }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene cannot be used as it stands. `remedy` says what to do.
    #[error("{span}: {what}\n  help: {remedy}")]
    Scene { span: Span, what: String, remedy: String },
    /// The command line cannot be used as it stands.
    #[error("{what}\n  help: {remedy}")]
    Usage { what: String, remedy: String },
    /// An output exists already, or parts do not belong together.
    #[error("{what}\n  help: {remedy}")]
    Mismatch { what: String, remedy: String },
    /// The numbers are not fit to be used (health limit, failed check).
    #[error("{what}\n  help: {remedy}")]
    Check { what: String, remedy: String },
    #[error("{what}: {source}")]
    Io { what: String, source: std::io::Error },
    #[error("{0}")]
    Runtime(String),
    /// A signal came before there was anything to write.
    #[error("stopped by a signal: nothing is written")]
    Interrupted,
}

pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub fn scene(span: &Span, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Error::Scene { span: span.clone(), what: what.into(), remedy: remedy.into() }
    }

    pub fn usage(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Error::Usage { what: what.into(), remedy: remedy.into() }
    }

    /// The same error, told to belong to something: a frame.
    pub fn within(self, place: &str) -> Self {
        let of = |what: String| format!("{place}: {what}");
        match self {
            Error::Scene { span, what, remedy } => Error::Scene { span, what: of(what), remedy },
            Error::Usage { what, remedy } => Error::Usage { what: of(what), remedy },
            Error::Mismatch { what, remedy } => Error::Mismatch { what: of(what), remedy },
            Error::Check { what, remedy } => Error::Check { what: of(what), remedy },
            Error::Io { what, source } => Error::Io { what: of(what), source },
            Error::Runtime(what) => Error::Runtime(of(what)),
            Error::Interrupted => Error::Interrupted,
        }
    }

    pub fn exit_code(&self) -> ExitCode {
        match self {
            Error::Scene { .. } | Error::Usage { .. } => ExitCode::Scene,
            Error::Mismatch { .. } => ExitCode::Mismatch,
            Error::Check { .. } => ExitCode::Check,
            Error::Io { .. } | Error::Runtime(_) | Error::Interrupted => ExitCode::Runtime,
        }
    }
}

/// Something that works but is probably not meant. Shown once, kept in the report.
#[derive(Clone, Debug, PartialEq)]
pub struct Warning {
    pub kind: WarningKind,
    pub span: Span,
    pub what: String,
    pub hint: String,
}

/// The kinds of warning, so that tests and reports can name them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum WarningKind {
    /// Only shapes that scatter or absorb bound a medium: `<bsdf type="null"/>` forgotten?
    MediumBehindOpaqueBoundary,
    /// The camera stands in a medium that the sensor does not name.
    CameraInUnnamedMedium,
    /// A medium's boundary mesh has holes, or is closed only after welding.
    LeakyBoundary,
    /// A mesh of glass has holes, or faces turned inside out; a disk that closes a tube is not one with it.
    OpenInterface,
    /// A number that is allowed, but hardly meant.
    UnlikelyValue,
    /// A zero-measure light stands in a medium that it does not name.
    LightInUnnamedMedium,
    /// A light without extent whose way through an interface is not followed.
    LightBehindGlass,
    /// Faces without area, non-manifold edges, normals of length 0.
    DegenerateMesh,
    /// Coordinates so large that single precision geometry is coarse.
    LargeCoordinates,
    /// Voxels that were repaired on request.
    RepairedVoxels,
    /// Something in the scene has no effect.
    NoEffect,
    /// A light lies on a camera ray: the picture diverges there.
    LightOnRay,
    /// The picture has a kink where a parameter stands: no derivative is both of its slopes.
    Kink,
    /// What rough glass sends on of light without extent jumps where its facets stand upright, and how that moves is not computed.
    EdgeOnFacets,
    /// `--terms` leaves out what the derivative needs.
    TermsLeftOut,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}\n  hint: {}", self.span, self.what, self.hint)
    }
}
