//! `--frames`: a sequence as one run after the other. Each is what the same command line does with the frame's number in its names.

use super::files;
use super::log::Log;
use clap::Args;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use tyndall::error::{Error, Result};
use tyndall::scene::frame;

/// Frames of a sequence, at most.
const MOST: usize = 100_000;

#[derive(Args, Clone, Debug)]
pub struct FrameOptions {
    /// Frames to render, one after the other: A, A-B, A-BxS (every S-th), or a list of these. In file names of the command line and of the scene's objects, `####` stands for the
    /// frame's number with as many digits at least, `{frame}` and `{frame:04}` alike. Times are those of a frame; of a frame that fails the others go on, and the exit code is that of the first
    #[arg(long, value_name = "A-BxS,...", value_parser = frames)]
    frames: Option<Frames>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Frames(Vec<u32>);

fn frames(text: &str) -> std::result::Result<Frames, String> {
    let form = "write A, A-B or A-BxS (every S-th), or a list of these, for example 1-10x2,15";
    let number = |s: &str| s.trim().parse::<u32>().map_err(|_| form.to_string());
    let mut all = Vec::new();
    for part in text.split(',') {
        let (range, step) = part.split_once('x').unwrap_or((part, "1"));
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        let (first, last, step) = (number(first)?, number(last)?, number(step)? as usize);
        if first > last || step == 0 {
            return Err(format!("`{part}` has no frame: {form}"));
        }
        all.extend((first..=last).step_by(step).take(MOST + 1));
        if all.len() > MOST {
            return Err(format!("more than {MOST} frames"));
        }
    }
    let mut seen = HashSet::new();
    match all.iter().find(|n| !seen.insert(**n)) {
        Some(twice) => Err(format!("frame {twice} is named twice")),
        None => Ok(Frames(all)),
    }
}

/// One run among those of a command.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    pub number: Option<u32>,
    several: bool,
}

impl Frame {
    /// The name of a file in this frame. Errors: a pattern, but no frame.
    pub fn input(&self, option: &str, path: &Path) -> Result<PathBuf> {
        let text = path.to_string_lossy();
        match self.number {
            Some(n) => Ok(frame::numbered(&text, n).map_or(path.into(), PathBuf::from)),
            // A file of that name is a file.
            None if frame::has_pattern(&text) && !path.exists() => Err(Error::usage(
                format!("`{option} {text}` has a place for a frame's number, and there is no frame"),
                "give --frames, for example --frames 1-10; or a name without `#` and `{frame}`",
            )),
            None => Ok(path.into()),
        }
    }

    /// The same of a file that is written. Errors: several frames, but no pattern.
    pub fn output(&self, option: &str, path: &Path) -> Result<PathBuf> {
        let text = path.to_string_lossy();
        if self.several && !frame::has_pattern(&text) {
            let extension = path.extension().map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
            let numbered = path.with_extension(format!("####{extension}"));
            return Err(Error::usage(
                format!("`{option} {text}` is one file for several frames"),
                format!("put `####` or `{{frame:04}}` where the frame's number belongs: {}", numbered.display()),
            ));
        }
        self.input(option, path)
    }

    /// The default name of a file that a scene gives, with a place for the frame's number.
    pub fn default_name(&self, scene: &Path, ending: &str) -> PathBuf {
        let placed = scene.file_stem().is_some_and(|s| frame::has_pattern(&s.to_string_lossy()));
        let place = if self.number.is_some() && !placed { "_####" } else { "" };
        files::default_name(scene, &format!("{place}{ending}"))
    }
}

impl FrameOptions {
    /// Prepare all runs, then do them. What `prepare` finds stops everything before anything is rendered; a run that fails is reported, and the others go on.
    pub fn each<P>(
        &self,
        log: &Log,
        prepare: impl Fn(Frame) -> Result<P>,
        run: impl Fn(P) -> Result<u8>,
    ) -> Result<u8> {
        let Some(Frames(list)) = &self.frames else { return run(prepare(Frame { number: None, several: false })?) };
        let several = list.len() > 1;
        let of = |n: u32, e: Error| e.within(&format!("frame {n}"));
        let frame = |n: u32| prepare(Frame { number: Some(n), several }).map_err(|e| of(n, e));
        let ready = list.iter().map(|&n| frame(n)).collect::<Result<Vec<P>>>()?;
        let mut first = 0;
        for (&n, ready) in list.iter().zip(ready) {
            log.detail(format!("frame {n}"));
            let code = match run(ready) {
                Ok(code) => code,
                Err(Error::Interrupted) => return Err(Error::Interrupted),
                Err(e) => {
                    let code = e.exit_code() as u8;
                    log.error(&of(n, e));
                    code
                }
            };
            // After a signal.
            if code >= 128 {
                return Ok(code);
            }
            first = if first == 0 { code } else { first };
        }
        Ok(first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_one_place_for_a_number() {
        let frame = Frame { number: Some(3), several: true };
        let name = |scene: &str| frame.default_name(Path::new(scene), ".exr").display().to_string();
        assert_eq!((name("a/smoke.xml"), name("a/smoke_##.xml")), ("smoke_####.exr".into(), "smoke_##.exr".into()));
        let remedy = |path: &str| frame.output("-o", Path::new(path)).unwrap_err().to_string();
        assert!(remedy("out.exr").contains("belongs: out.####.exr"), "{}", remedy("out.exr"));
        assert!(remedy("out").ends_with("belongs: out.####"), "{}", remedy("out"));
    }

    #[test]
    fn frames_are_ranges_and_lists() {
        let of = |text: &str| frames(text).map(|f| f.0);
        assert_eq!(of("7"), Ok(vec![7]));
        assert_eq!(of("1-10x2"), Ok(vec![1, 3, 5, 7, 9]));
        assert_eq!(of("9, 0-2,20-22x2"), Ok(vec![9, 0, 1, 2, 20, 22]));
        for bad in ["", "-1", "1-", "3-1", "1-5x0", "1,,2", "1-3,2", "a", "1..3", "1-5x", "0-4000000000"] {
            assert!(of(bad).is_err(), "{bad}");
        }
    }
}
