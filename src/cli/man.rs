//! `tyndall man [COMMAND]`: the manual page in roff.

use super::log::Log;
use clap::Args;
use tyndall::error::{Error, Result};
use tyndall::scene::desc::suggest;

/// Print the manual page of the program or of one command
#[derive(Args)]
pub struct ManArgs {
    command: Option<String>,
}

impl ManArgs {
    pub fn run(&self, log: &Log) -> Result<u8> {
        let mut tree = super::command();
        // Subcommands get their full names and inherited settings.
        tree.build();
        let page = match &self.command {
            None => tree,
            Some(name) => match tree.find_subcommand(name) {
                Some(c) => c.clone(),
                None => {
                    let remedy = suggest(name, tree.get_subcommands().map(clap::Command::get_name));
                    return Err(Error::usage(format!("no command `{name}`"), remedy));
                }
            },
        };
        let mut text = Vec::new();
        // The version of `--version` has a line for every library: too many for a title.
        clap_mangen::Man::new(page.version(env!("TYNDALL_VERSION")))
            .source(concat!("tyndall ", env!("TYNDALL_VERSION")))
            .render(&mut text)
            .map_err(|source| Error::Io { what: "cannot write the manual page".into(), source })?;
        log.result(String::from_utf8_lossy(&text).trim_end())?;
        Ok(0)
    }
}
