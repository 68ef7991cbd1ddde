//! What the program says: results to stdout, the log to stderr (and `--log-file`).

use super::options::LogOptions;
use indicatif::ProgressBar;
use std::fmt::Display;
use std::fs::File;
use std::io::{self, Write};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use tyndall::error::{Error, Result, Warning};

pub struct Log {
    quiet: bool,
    verbose: bool,
    pub json: bool,
    file: Option<Mutex<File>>,
    /// A bar that must step aside for a line.
    bar: Mutex<Option<ProgressBar>>,
    start: Instant,
}

impl Log {
    pub fn new(options: &LogOptions) -> Result<Self> {
        let open = |path: &std::path::PathBuf| {
            super::files::check_place(path, true)?;
            File::create(path)
                .map(Mutex::new)
                .map_err(|source| Error::Io { what: format!("cannot write the log {}", path.display()), source })
        };
        Ok(Log {
            quiet: options.quiet,
            verbose: options.verbose,
            json: options.json,
            file: options.log_file.as_ref().map(open).transpose()?,
            bar: Mutex::new(None),
            start: Instant::now(),
        })
    }

    pub fn quiet(&self) -> bool {
        self.quiet
    }

    /// While a bar is drawn, lines go above it.
    pub fn set_bar(&self, bar: Option<ProgressBar>) {
        *self.bar.lock().unwrap_or_else(PoisonError::into_inner) = bar;
    }

    fn say(&self, show: bool, text: &str) {
        if let Some(file) = &self.file {
            let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
            // A full disk must not stop a render; the outputs will tell.
            let _ = writeln!(file, "[{:10.3} s] {text}", self.start.elapsed().as_secs_f64());
        }
        if show {
            match &*self.bar.lock().unwrap_or_else(PoisonError::into_inner) {
                Some(bar) => bar.suspend(|| line(text)),
                None => line(text),
            }
        }
    }

    pub fn error(&self, e: &Error) {
        self.say(true, &format!("error: {e}"));
    }

    pub fn warn(&self, text: impl Display) {
        self.say(!self.quiet, &format!("warning: {text}"));
    }

    pub fn warnings(&self, all: &[Warning]) {
        all.iter().for_each(|w| self.warn(w));
    }

    pub fn info(&self, text: impl Display) {
        self.say(!self.quiet, &text.to_string());
    }

    /// Shown with `-v`, always in the log file.
    pub fn detail(&self, text: impl Display) {
        self.say(self.verbose, &text.to_string());
    }

    /// The result for people: neither with `--json` nor with `-q`.
    pub fn summary(&self, text: impl Display) -> Result<()> {
        if self.json || self.quiet { Ok(()) } else { self.result(text) }
    }

    /// The result, on stdout.
    pub fn result(&self, text: impl Display) -> Result<()> {
        let mut out = io::stdout().lock();
        let written = writeln!(out, "{text}").and_then(|()| out.flush());
        match written {
            // The reader (`| head`) has seen enough.
            Err(e) if e.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            written => written.map_err(|source| Error::Io { what: "cannot write to standard output".into(), source }),
        }
    }
}

/// A line on stderr; a closed stderr is nobody's loss.
fn line(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}
