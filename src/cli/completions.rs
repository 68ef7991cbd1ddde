//! `tyndall completions SHELL`: what a shell needs to complete commands and options.

use super::log::Log;
use clap::Args;
use clap_complete::Shell;
use tyndall::error::Result;

/// Print a completion script
#[derive(Args)]
pub struct CompletionsArgs {
    shell: Shell,
}

impl CompletionsArgs {
    pub fn run(&self, log: &Log) -> Result<u8> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut super::command(), "tyndall", &mut script);
        log.result(String::from_utf8_lossy(&script).trim_end())?;
        Ok(0)
    }
}
