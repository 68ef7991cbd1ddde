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
    /// FNV-1a of the text, the included texts, the overrides and the frame: equal on every machine.
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
        super::xml::load(path, overrides, None)
    }

    /// The same in a frame of a sequence: its number stands in the names of files where there is a place for it ([`super::frame`]).
    pub fn load_frame(path: &Path, overrides: &[(String, String)], frame: Option<u32>) -> Result<Self> {
        super::xml::load(path, overrides, frame)
    }

    /// Read a scene from text; `path` names it in messages and is where relative file names start.
    pub fn parse(text: &str, path: &Path, overrides: &[(String, String)]) -> Result<Self> {
        super::xml::parse(text, path, overrides, None)
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

    /// An error about a property, with the parameters that stand there and their values.
    pub(super) fn name_parameters(&self, e: Error) -> Error {
        let Error::Scene { span, what, remedy } = e else { return e };
        let params = self.root.parameters_at(&span).unwrap_or_default();
        let named: Vec<String> = params
            .iter()
            .filter_map(|&i| self.params.get(i))
            .map(|p| format!("`${}` = {}", p.name, p.text.trim()))
            .collect();
        let what = if named.is_empty() { what } else { format!("{what} ({})", named.join(", ")) };
        Error::Scene { span, what, remedy }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(body: &str, given: &[(&str, &str)]) -> Result<SceneDesc> {
        let given: Vec<_> = given.iter().map(|(n, v)| (n.to_string(), v.to_string())).collect();
        SceneDesc::parse(&format!("<scene version=\"3.0.0\">{body}</scene>"), Path::new("test.xml"), &given)
    }

    const MOVING: &str = r#"<default name="x" value="2"/><default name="r" value="0.5"/>
        <?diff param="x" min="-1" max="3"?> <?other thing?>
        <shape type="sphere"><point name="center" value="1, $x, -$r"/><float name="radius" value="$x"/>
        <transform name="to_world"><translate x="$x"/><scale value="$x"/></transform></shape>"#;

    #[test]
    fn a_parameter_carries_its_derivative_everywhere() {
        let desc = parse(MOVING, &[]).unwrap();
        let (x, shape) = (desc.wrt("x").unwrap(), desc.root.child("shape").unwrap().unwrap());
        let env = desc.dual(x);
        let c = shape.point(&env, "center", glam::DVec3::ZERO).unwrap();
        assert_eq!((c.value(), c.tangent()), (glam::DVec3::new(1.0, 2.0, -0.5), glam::DVec3::Y));
        assert_eq!(shape.float(&env, "radius", 1.0).unwrap(), Dual::variable(2.0, 0));
        // Translate first, then scale: x -> x (x + p), whose slope at p = 0 is 2 x.
        let m = shape.transform(&env, "to_world").unwrap();
        assert_eq!((m.m[0][3].v, m.m[0][3].d), (4.0, [4.0]));
        assert_eq!(desc.params[x].hint, DiffHint { min: Some(-1.0), max: Some(3.0), step: None });
        assert_eq!((desc.params[x].real_uses, desc.params[1].minus_uses), (4, 1));
        assert!(desc.wrt("r").unwrap_err().to_string().contains("`-$r`"));
        desc.finish().unwrap();
    }

    #[test]
    fn overrides_replace_defaults_and_must_be_used() {
        let desc = parse(MOVING, &[("x", "7")]).unwrap();
        assert_eq!(desc.params[0].value, 7.0);
        assert_ne!(desc.hash, parse(MOVING, &[]).unwrap().hash);
        assert_eq!(desc.hash, parse(MOVING, &[("x", "7")]).unwrap().hash);
        // A parameter may exist by -D alone.
        let only = "<shape type=\"sphere\"><float name=\"radius\" value=\"$q\"/></shape>";
        assert_eq!(parse(only, &[("q", "3")]).unwrap().params[0].value, 3.0);
        for (given, part) in [
            (vec![("y", "1")], "`-D y`: the scene never uses `$y`"),
            (vec![("x", "1"), ("x", "2")], "given twice"),
            (vec![("a b", "1")], "not a parameter name"),
            (vec![("x", "inf")], "`inf` is not a finite number"),
            (vec![("r", "-1")], "`--1` is not a number"),
        ] {
            let e = parse(MOVING, &given).unwrap_err().to_string();
            assert!(e.contains(part) && e.contains("help: "), "{e}");
        }
    }

    #[test]
    fn errors_name_the_parameters_of_their_property() {
        let body = r#"<default name="a" value="0.5"/>
            <medium type="homogeneous"><rgb name="albedo" value="0.1, $a, $a"/></medium>"#;
        let desc = parse(body, &[("a", "5")]).unwrap();
        let medium = desc.root.child("medium").unwrap().unwrap();
        let e = desc.name_parameters(medium.err("albedo", "too large", "make it smaller")).to_string();
        assert!(e.contains("too large (`$a` = 5)\n"), "{e}");
        let e = desc.name_parameters(medium.err("none", "missing", "add it")).to_string();
        assert!(e.contains(": missing\n"), "{e}");
    }

    #[test]
    fn unused_things_are_warnings() {
        let desc = parse("<default name=\"x\" value=\"1\"/><bsdf type=\"diffuse\" id=\"a\"/>", &[]).unwrap();
        assert_eq!(desc.warnings.len(), 2);
        desc.finish().unwrap();
    }

    #[test]
    fn suggestions_are_near() {
        let valid = ["radius", "center", "to_world"];
        assert_eq!(nearest("toWorld", valid), Some("to_world"));
        assert_eq!(nearest("raduis", valid), Some("radius"));
        assert_eq!(nearest("filename", valid), None);
        assert_eq!(nearest("", valid), None);
    }
}
