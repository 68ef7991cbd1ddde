//! SIGINT and SIGTERM stop a run between tiles, without the open batch; a second one ends the program at once.

use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use tyndall::error::{Error, Result};

/// The last signal that came, for the exit code of a run that has nothing to write.
static LAST: AtomicUsize = AtomicUsize::new(0);

/// 128 + the signal that stopped the run.
pub fn last_exit_code() -> u8 {
    128 + LAST.load(Ordering::SeqCst) as u8
}

/// Clones know of the same signals.
#[derive(Clone)]
pub struct Stop {
    flag: Arc<AtomicBool>,
    signal: Arc<AtomicUsize>,
}

impl Stop {
    /// Once a process: frames of a sequence share it.
    pub fn install() -> Result<Self> {
        static INSTALLED: Mutex<Option<Stop>> = Mutex::new(None);
        let mut installed = INSTALLED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(stop) = &*installed {
            return Ok(stop.clone());
        }
        let stop = Stop { flag: Arc::default(), signal: Arc::default() };
        let fail = |source| Error::Io { what: "cannot install signal handlers".into(), source };
        for signal in [SIGINT, SIGTERM] {
            // The order counts: the second signal finds the flag raised by the first.
            signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, stop.flag.clone()).map_err(fail)?;
            signal_hook::flag::register_usize(signal, stop.signal.clone(), signal as usize).map_err(fail)?;
            signal_hook::flag::register(signal, stop.flag.clone()).map_err(fail)?;
        }
        // Snapshots do not exist yet; without a handler this signal would end the run.
        signal_hook::flag::register(SIGUSR1, Arc::default()).map_err(fail)?;
        *installed = Some(stop.clone());
        Ok(stop)
    }

    pub fn flag(&self) -> &AtomicBool {
        &self.flag
    }

    /// After a signal, an error: there is nothing to write.
    pub fn check(&self) -> Result<()> {
        self.exit_code().map_or(Ok(()), |_| Err(Error::Interrupted))
    }

    /// 128 + the signal that came.
    pub fn exit_code(&self) -> Option<u8> {
        match self.signal.load(Ordering::SeqCst) {
            0 => None,
            n => {
                LAST.store(n, Ordering::SeqCst);
                Some(128 + n as u8)
            }
        }
    }
}
