//! Output files: their names, whether they may be written, and what an EXR holds.

use std::path::{Path, PathBuf};
use tyndall::error::{Error, Result};
use tyndall::image::exr::{Attribute, ExrImage};
use tyndall::render::driver::Outcome;
use tyndall::render::film::Film;

/// The files that a run will write.
pub struct Outputs {
    pub main: PathBuf,
    /// The report; the same as `main` where the result is JSON itself.
    pub report: PathBuf,
    pub preview: Option<PathBuf>,
}

impl Outputs {
    /// Names, before any work: extensions, folders, and whether a file exists that must not be replaced.
    pub fn new(main: PathBuf, extension: &str, preview: Option<PathBuf>, overwrite: bool) -> Result<Self> {
        need_extension("--output", &main, extension)?;
        let report = main.with_extension("json");
        if let Some(p) = &preview {
            need_extension("--preview", p, "png")?;
        }
        let outputs = Outputs { main, report, preview };
        for path in outputs.all() {
            check_place(path, overwrite)?;
        }
        Ok(outputs)
    }

    pub fn all(&self) -> Vec<&Path> {
        let mut v = vec![self.main.as_path()];
        if self.report != self.main {
            v.push(&self.report);
        }
        v.extend(self.preview.as_deref());
        v
    }
}

/// `fog.xml` and `.grad.exr` -> `fog.grad.exr`, in the current folder.
pub fn default_name(scene: &Path, ending: &str) -> PathBuf {
    let stem = scene.file_stem().map_or("out".into(), |s| s.to_string_lossy().into_owned());
    PathBuf::from(stem + ending)
}

pub fn need_extension(option: &str, path: &Path, extension: &str) -> Result<()> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension)) {
        return Ok(());
    }
    Err(Error::usage(
        format!("`{option} {}` does not end in .{extension}", path.display()),
        format!("name it {}", path.with_extension(extension).display()),
    ))
}

pub fn check_place(path: &Path, overwrite: bool) -> Result<()> {
    if path.is_dir() {
        let what = format!("{} is a folder", path.display());
        return Err(Error::usage(what, "give the name of a file"));
    }
    if !overwrite && path.exists() {
        return Err(Error::Mismatch {
            what: format!("{} exists", path.display()),
            remedy: "pass --overwrite to replace it, or give another name".into(),
        });
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
    match folder {
        Some(f) if !f.is_dir() => Err(Error::usage(format!("there is no folder {}", f.display()), "create it first")),
        _ => Ok(()),
    }
}

/// Whether a folder may be written into: refused where it holds something that must not be replaced.
pub fn check_folder(path: &Path, overwrite: bool) -> Result<()> {
    if path.exists() && !path.is_dir() {
        return Err(Error::usage(format!("{} is a file", path.display()), "give the name of a folder"));
    }
    if !overwrite && std::fs::read_dir(path).is_ok_and(|mut d| d.next().is_some()) {
        return Err(Error::Mismatch {
            what: format!("the folder {} exists and is not empty", path.display()),
            remedy: "pass --overwrite to replace files in it, or -o for another name".into(),
        });
    }
    Ok(())
}

pub fn make_folder(path: &Path) -> Result<()> {
    let fail = |source| Error::Io { what: format!("cannot make the folder {}", path.display()), source };
    std::fs::create_dir_all(path).map_err(fail)
}

/// Layers of a film as EXR channels; also how many values leave the range of single precision.
///
pub fn image(o: &Outcome, crop: [usize; 4], full: [usize; 2]) -> (ExrImage, usize) {
    let film = &o.film;
    let mut channels = Vec::new();
    let mut beyond = 0;
    for (layer, name) in film.spec().layers.iter().enumerate() {
        let mean = planes(film, |p| Some(film.mean(layer, p).0), &mut beyond);
        let variance = planes(film, |p| film.variance_of_mean(layer, p).map(|v| v.0), &mut beyond);
        let mut push = |name: &str, planes: &Option<[Vec<f32>; 3]>| {
            for (letter, plane) in ["R", "G", "B"].iter().zip(planes.iter().flatten()) {
                let name = if name.is_empty() { letter.to_string() } else { format!("{name}.{letter}") };
                channels.push((name, plane.clone()));
            }
        };
        match name.strip_prefix("d_") {
            None => {
                push("", &mean);
                push("var", &variance);
            }
            Some(param) => {
                push(name, &mean);
                push(&format!("var_{param}"), &variance);
            }
        }
    }
    let image = ExrImage {
        width: crop[2] - crop[0],
        height: crop[3] - crop[1],
        origin: [crop[0] as i32, crop[1] as i32],
        full_size: full,
        channels,
        attributes: Vec::new(),
    };
    (image, beyond)
}

/// Three planes of one layer; `None` where a pixel has no value.
fn planes(film: &Film, pixel: impl Fn(usize) -> Option<[f64; 3]>, beyond: &mut usize) -> Option<[Vec<f32>; 3]> {
    let mut out: [Vec<f32>; 3] = Default::default();
    for p in 0..film.spec().pixels() {
        for (plane, x) in out.iter_mut().zip(pixel(p)?) {
            let y = x as f32;
            *beyond += usize::from(x.is_finite() && !y.is_finite() || x != 0.0 && y == 0.0);
            plane.push(y);
        }
    }
    Some(out)
}

/// A whole number as an attribute; as text where EXR's 32 bits do not hold it.
pub fn integer(n: u64) -> Attribute {
    if n <= i32::MAX as u64 { Attribute::Integer(n as i64) } else { Attribute::Text(n.to_string()) }
}
