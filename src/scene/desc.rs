//! The description of a scene: its parameters, its tree of objects, its warnings.
//!
//! A `$parameter` stays symbolic in every real-valued place, so that the same description is evaluated with plain
//! numbers ([`SceneDesc::values`]) or with one parameter as the dual variable ([`SceneDesc::dual`]).

use crate::error::{Error, Result, Span, Warning};
use crate::math::{Dual, Real};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

pub use super::node::Node;

/// A scene file, its includes and the `-D` overrides, read and checked but not compiled.
#[derive(Debug)]
pub struct SceneDesc {
    pub path: PathBuf,
    pub params: Vec<Param>,
    /// The `<scene>` element.
    pub root: Node,
    pub warnings: Vec<Warning>,
    /// FNV-1a of the text, the included texts and the overrides: equal on every machine.
    pub hash: u64,
}

/// One `$parameter`.
#[derive(Clone, Debug)]
pub struct Param {
    pub name: String,
    /// NaN where the text is no number.
    pub value: f64,
    pub text: String,
    /// Its `<default>`, or its first use where only `-D` defines it.
    pub span: Span,
    pub hint: DiffHint,
    /// Uses as a whole token where a real number stands: these carry the derivative.
    pub real_uses: usize,
    /// Uses as text: integers, booleans, strings, file names, `type`, lists of numbers.
    pub other_uses: usize,
    /// Uses as `-$x`: text too.
    pub minus_uses: usize,
    /// The first use that cannot be differentiated, and what stands there.
    pub other_place: Option<(Span, String)>,
}

/// What `<?diff param="x" min max step?>` says about a parameter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DiffHint {
    pub min: Option<f64>,
    pub max: Option<f64>,
    pub step: Option<f64>,
}

/// The values of all parameters, in the order of [`SceneDesc::params`].
#[derive(Clone, Debug, Default)]
pub struct Env<R> {
    pub values: Vec<R>,
}

impl SceneDesc {
    /// Read a scene file.
    pub fn load(path: &Path, overrides: &[(String, String)]) -> Result<Self> {
        super::xml::load(path, overrides)
    }

    /// Read a scene from text; `path` names it in messages and is where relative file names start.
    pub fn parse(text: &str, path: &Path, overrides: &[(String, String)]) -> Result<Self> {
        super::xml::parse(text, path, overrides)
    }

    /// All parameters as constants.
    pub fn values<R: Real>(&self) -> Env<R> {
        Env { values: self.params.iter().map(|p| R::from(p.value)).collect() }
    }

    /// All parameters as constants, but `param` as the variable.
    pub fn dual(&self, param: usize) -> Env<Dual<1>> {
        let mut env = self.values::<Dual<1>>();
        if let Some(v) = env.values.get_mut(param) {
            v.d = [1.0];
        }
        env
    }

    /// The index of a parameter that can be differentiated.
    ///
    /// Errors: unknown name; `-$x`; a use as text (integer, boolean, string, file name, ...); never used.
    pub fn wrt(&self, name: &str) -> Result<usize> {
        let names: Vec<&str> = self.params.iter().map(|p| p.name.as_str()).collect();
        let bare = name.strip_prefix('$').unwrap_or(name);
        let Some(index) = names.iter().position(|n| *n == bare) else {
            let what = format!("`--wrt {name}`: the scene has no parameter `{bare}`");
            let remedy = match names.is_empty() {
                true => format!(
                    "add `<default name=\"{bare}\" value=\"...\"/>` to the scene and write `${bare}` where it acts"
                ),
                false => suggest(bare, names),
            };
            return Err(Error::usage(what, remedy));
        };
        let p = &self.params[index];
        if let Some((span, place)) = &p.other_place {
            let what = format!("`--wrt {bare}`: `${bare}` is used as {place}, which has no derivative");
            let remedy = if place.starts_with("`-$") {
                format!("write a whole token: negate the `<default>` and put `${bare}` here, or use a `<scale>` by -1")
            } else {
                format!("use a second parameter here, and `${bare}` only as a whole token where a real number stands")
            };
            return Err(Error::scene(span, what, remedy));
        }
        if p.real_uses == 0 {
            let what = format!("`--wrt {bare}`: parameter `{bare}` is never used");
            let remedy =
                format!("write `${bare}` where it should act, for example `<float name=\"...\" value=\"${bare}\"/>`");
            return Err(Error::scene(&p.span, what, remedy));
        }
        Ok(index)
    }

    /// Call after compilation: every property and object that nobody has read is an error.
    pub fn finish(&self) -> Result<()> {
        self.root.check_read(true, &mut HashSet::new())
    }
}

/// The candidate most like `name`, if any is like it.
pub fn nearest<'a>(name: &str, valid: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let plain = |s: &str| s.to_lowercase().replace(['_', '-'], "");
    let wanted = plain(name);
    valid
        .into_iter()
        .map(|v| (strsim::damerau_levenshtein(&plain(v), &wanted), v))
        .filter(|(d, v)| *d <= (v.len().max(wanted.len()) / 3).max(1) && *d < wanted.len())
        .min_by_key(|(d, _)| *d)
        .map(|(_, v)| v)
}

/// A remedy for an unknown name: the nearest valid one, and the valid ones.
pub fn suggest<'a>(name: &str, valid: impl IntoIterator<Item = &'a str>) -> String {
    const SHOWN: usize = 24;
    let valid: Vec<&str> = valid.into_iter().filter(|v| *v != name).collect();
    let mut list = valid.iter().take(SHOWN).map(|v| format!("`{v}`")).collect::<Vec<_>>().join(", ");
    if valid.len() > SHOWN {
        list += ", ...";
    }
    match nearest(name, valid.iter().copied()) {
        // A long list would hide the answer.
        Some(best) if valid.len() == 1 || valid.len() > 12 => format!("did you mean `{best}`?"),
        Some(best) => format!("did you mean `{best}`? Valid here: {list}"),
        None if valid.is_empty() => "remove it: nothing of the kind is read here".into(),
        None => format!("valid here: {list}"),
    }
}
