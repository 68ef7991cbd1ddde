//! `tyndall info FILE`: what a file holds, and what this program makes of it.
use super::log::Log;
use super::options::LogOptions;
use clap::Args;
use std::path::PathBuf;
use tyndall::error::Result;

/// What a file holds: .vdb, .vol, .exr, .ply, .obj, or a scene
#[derive(Args)]
pub struct InfoArgs {
    file: PathBuf,
    #[command(flatten)]
    pub log: LogOptions,
}

impl InfoArgs {
    pub fn run(&self, _log: &Log) -> Result<u8> {
        Ok(0)
    }
}
