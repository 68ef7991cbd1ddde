//! One object of a scene: typed access to its properties and nested objects.
//!
//! Every accessor marks what it reads and remembers the name as a valid one, so that what nobody asked for is an
//! error with the nearest valid name ([`super::desc::SceneDesc::finish`]).

use super::desc::{Env, suggest};
use super::transform::Mat4;
use super::value::{Num, Value};
use crate::error::{Error, Result, Span};
use crate::math::{DVec3, Real, V3};
use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// An object: `<tag type="plugin" id="..." name="...">`. Shared by all `<ref>`s to it: compile it once per [`Node::key`].
#[derive(Debug)]
pub struct Node {
    pub tag: String,
    pub plugin: String,
    pub id: Option<String>,
    pub name: Option<String>,
    pub span: Span,
    pub(super) key: usize,
    pub(super) props: Vec<Prop>,
    pub(super) children: Vec<Child>,
    pub(super) folders: Arc<OnceLock<Vec<PathBuf>>>,
    /// Names and tags that the code has asked for.
    pub(super) asked: Mutex<BTreeSet<String>>,
    /// Some accessor has handed this node out.
    pub(super) reached: AtomicBool,
}

/// A property: `<kind name="..." value="..."/>`.
#[derive(Debug)]
pub(super) struct Prop {
    pub name: String,
    pub kind: &'static str,
    pub span: Span,
    pub value: Value,
    pub read: AtomicBool,
}

/// A nested object, or a `<ref>` to one; the node of a `<ref>` is set once the whole file is read.
#[derive(Debug)]
pub(super) struct Child {
    pub name: Option<String>,
    pub span: Span,
    pub refers_to: Option<String>,
    pub node: OnceLock<Arc<Node>>,
    pub read: AtomicBool,
}

impl Child {
    fn take(&self) -> Option<&Node> {
        let node = self.node.get()?;
        self.read.store(true, Relaxed);
        node.reached.store(true, Relaxed);
        Some(node)
    }

    fn has_tag(&self, tag: &str) -> bool {
        self.node.get().is_some_and(|n| n.tag == tag)
    }
}

impl Node {
    /// Equal for two accesses to the same object, through `<ref>`s or not.
    pub fn key(&self) -> usize {
        self.key
    }

    /// `<tag type="plugin">`, for messages.
    pub fn title(&self) -> String {
        match self.plugin.is_empty() {
            true => format!("<{}>", self.tag),
            false => format!("<{} type=\"{}\">", self.tag, self.plugin),
        }
    }

    fn ask(&self, name: &str) {
        self.asked.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned());
    }

    fn valid_names(&self) -> BTreeSet<String> {
        self.asked.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn prop(&self, name: &str) -> Option<&Prop> {
        self.ask(name);
        let p = self.props.iter().find(|p| p.name == name)?;
        p.read.store(true, Relaxed);
        Some(p)
    }

    /// A property or nested object of that name is there. Does not count as reading it.
    pub fn has(&self, name: &str) -> bool {
        self.ask(name);
        self.span_if(name).is_some()
    }

    /// The element kind of a property (`"float"`, `"string"`, ...), for properties that may be of several kinds.
    pub fn kind_of(&self, name: &str) -> Option<&'static str> {
        self.ask(name);
        self.props.iter().find(|p| p.name == name).map(|p| p.kind)
    }

    fn span_if(&self, name: &str) -> Option<&Span> {
        let prop = self.props.iter().find(|p| p.name == name).map(|p| &p.span);
        prop.or_else(|| self.children.iter().find(|c| c.name.as_deref() == Some(name)).map(|c| &c.span))
    }

    /// The place of a property or named object, else of the node.
    pub fn span_of(&self, name: &str) -> Span {
        self.span_if(name).unwrap_or(&self.span).clone()
    }

    /// An error about a property, at its place.
    pub fn err(&self, prop: &str, what: impl Into<String>, remedy: impl Into<String>) -> Error {
        Error::scene(&self.span_of(prop), what, remedy)
    }

    /// The parameters in the property that stands there, each once.
    pub(super) fn parameters_at(&self, span: &Span) -> Option<Vec<usize>> {
        match self.props.iter().find(|p| p.span == *span) {
            Some(p) => Some(p.value.parameters()),
            // What a <ref> names has its own place in the tree.
            None => {
                self.children.iter().filter(|c| c.refers_to.is_none()).find_map(|c| c.node.get()?.parameters_at(span))
            }
        }
    }

    /// An error about the node's `type`.
    pub fn unknown_plugin(&self, valid: &[&str]) -> Error {
        let what = match self.plugin.is_empty() {
            true => format!("<{}> has no `type`", self.tag),
            false => format!("unknown {} type `{}`", self.tag, self.plugin),
        };
        Error::scene(&self.span, what, suggest(&self.plugin, valid.iter().copied()))
    }

    fn missing(&self, name: &str, kind: &str) -> Error {
        let what = format!("{} needs `{name}`", self.title());
        let unread = self.props.iter().filter(|p| !p.read.load(Relaxed)).map(|p| p.name.as_str());
        let remedy = match super::desc::nearest(name, unread) {
            Some(n) => format!("rename `{n}` to `{name}`"),
            None => format!("add `<{kind} name=\"{name}\" .../>`"),
        };
        Error::scene(&self.span, what, remedy)
    }

    fn wrong_kind(&self, p: &Prop, wanted: &str) -> Error {
        let a = |kind: &str| if kind.starts_with('i') { "an" } else { "a" };
        let what =
            format!("`{}` of {} is {} <{}>, not {} <{wanted}>", p.name, self.title(), a(p.kind), p.kind, a(wanted));
        Error::scene(&p.span, what, format!("write `<{wanted} name=\"{}\" .../>`", p.name))
    }

    pub fn float_opt<R: Real>(&self, env: &Env<R>, name: &str) -> Result<Option<R>> {
        self.prop(name)
            .map(|p| match p.value {
                Value::Float(x) => Ok(x.eval(env)),
                Value::Int(i) => Ok(R::from(i as f64)),
                _ => Err(self.wrong_kind(p, "float")),
            })
            .transpose()
    }

    /// A number that no parameter can change.
    pub fn fixed_float_opt(&self, name: &str) -> Result<Option<f64>> {
        let open = self.prop(name).is_some_and(|p| !p.value.parameters().is_empty());
        if open {
            return Err(self.err(name, format!("`{name}` cannot be a parameter"), "write a number there"));
        }
        self.float_opt(&Env::default(), name)
    }

    pub fn float<R: Real>(&self, env: &Env<R>, name: &str, default: f64) -> Result<R> {
        Ok(self.float_opt(env, name)?.unwrap_or_else(|| R::from(default)))
    }

    pub fn float_req<R: Real>(&self, env: &Env<R>, name: &str) -> Result<R> {
        self.float_opt(env, name)?.ok_or_else(|| self.missing(name, "float"))
    }

    pub fn int_opt(&self, name: &str) -> Result<Option<i64>> {
        self.prop(name)
            .map(|p| match p.value {
                Value::Int(i) => Ok(i),
                _ => Err(self.wrong_kind(p, "integer")),
            })
            .transpose()
    }

    pub fn int(&self, name: &str, default: i64) -> Result<i64> {
        Ok(self.int_opt(name)?.unwrap_or(default))
    }

    pub fn bool(&self, name: &str, default: bool) -> Result<bool> {
        self.prop(name).map_or(Ok(default), |p| match p.value {
            Value::Bool(b) => Ok(b),
            _ => Err(self.wrong_kind(p, "boolean")),
        })
    }

    pub fn string_opt(&self, name: &str) -> Result<Option<String>> {
        self.prop(name)
            .map(|p| match &p.value {
                Value::Text(s) => Ok(s.clone()),
                _ => Err(self.wrong_kind(p, "string")),
            })
            .transpose()
    }

    pub fn string(&self, name: &str, default: &str) -> Result<String> {
        Ok(self.string_opt(name)?.unwrap_or_else(|| default.to_owned()))
    }

    /// `<rgb>`, `<spectrum>`, or one number for all three.
    pub fn rgb_opt<R: Real>(&self, env: &Env<R>, name: &str) -> Result<Option<[R; 3]>> {
        self.prop(name)
            .map(|p| match p.value {
                Value::Color(c) => Ok(c.map(|x| x.eval(env))),
                Value::Float(x) => Ok([x.eval(env); 3]),
                Value::Int(i) => Ok([R::from(i as f64); 3]),
                _ => Err(self.wrong_kind(p, "rgb")),
            })
            .transpose()
    }

    pub fn rgb<R: Real>(&self, env: &Env<R>, name: &str, default: f64) -> Result<[R; 3]> {
        Ok(self.rgb_opt(env, name)?.unwrap_or_else(|| [R::from(default); 3]))
    }

    fn triple<R: Real>(&self, env: &Env<R>, name: &str, default: DVec3, kind: &str) -> Result<V3<R>> {
        self.prop(name).map_or(Ok(V3::constant(default)), |p| match p.value {
            Value::Triple([x, y, z]) => Ok(V3::new(x.eval(env), y.eval(env), z.eval(env))),
            _ => Err(self.wrong_kind(p, kind)),
        })
    }

    /// `<point>`; a `<vector>` is taken too, as Mitsuba does.
    pub fn point<R: Real>(&self, env: &Env<R>, name: &str, default: DVec3) -> Result<V3<R>> {
        self.triple(env, name, default, "point")
    }

    /// `<vector>`; a `<point>` is taken too, as Mitsuba does.
    pub fn vector<R: Real>(&self, env: &Env<R>, name: &str, default: DVec3) -> Result<V3<R>> {
        self.triple(env, name, default, "vector")
    }

    /// The product of a `<transform>`'s operations, the first listed applied first; identity when absent.
    ///
    /// Errors: a degenerate operation, a singular or non-finite product.
    pub fn transform<R: Real>(&self, env: &Env<R>, name: &str) -> Result<Mat4<R>> {
        let Some(p) = self.prop(name) else { return Ok(Mat4::identity()) };
        let Value::Transform(ops) = &p.value else { return Err(self.wrong_kind(p, "transform")) };
        let mut m = Mat4::identity();
        for (span, op) in ops {
            let step = op.eval(env).map_err(|(what, remedy)| Error::scene(span, what, remedy))?;
            m = step * m;
        }
        m.check().map_err(|(what, remedy)| Error::scene(&p.span, format!("`{name}` {what}"), remedy))?;
        Ok(m)
    }

    /// A file name, searched in the folder of the XML file that names it, of the scene, and in the `<path>` entries.
    pub fn path(&self, name: &str) -> Result<Option<PathBuf>> {
        let Some(text) = self.string_opt(name)? else { return Ok(None) };
        let span = self.span_of(name);
        let own = span.file.parent().unwrap_or(Path::new(""));
        let entries = self.folders.get().map(Vec::as_slice).unwrap_or_default();
        let mut tried: Vec<PathBuf> = Vec::new();
        for folder in std::iter::once(own).chain(entries.iter().map(PathBuf::as_path)) {
            let full = folder.join(&text);
            if full.is_file() {
                return Ok(Some(full));
            }
            if !tried.contains(&full) {
                tried.push(full);
            }
        }
        let what = match text.is_empty() {
            true => format!("`{name}` is an empty file name"),
            false => format!("file `{text}` not found"),
        };
        let tried = tried.iter().map(|t| t.display().to_string()).collect::<Vec<_>>().join(", ");
        Err(Error::scene(&span, what, format!("searched {tried}; correct the name or add `<path value=\"folder\"/>`")))
    }

    /// All nested objects with that tag, named or not, `<ref>`s resolved, in the order of the file.
    pub fn children<'a>(&'a self, tag: &str) -> impl Iterator<Item = &'a Node> + use<'a> {
        self.ask(tag);
        let found: Vec<&Node> = self.children.iter().filter(|c| c.has_tag(tag)).filter_map(Child::take).collect();
        found.into_iter()
    }

    /// The one nested object with that tag and no name (or the tag as its name); two are an error.
    pub fn child(&self, tag: &str) -> Result<Option<&Node>> {
        self.ask(tag);
        let matches = |c: &&Child| c.has_tag(tag) && c.name.as_deref().is_none_or(|n| n == tag);
        let mut found = self.children.iter().filter(matches);
        let first = found.next();
        if let Some(second) = found.next() {
            let what = format!("{} has two nested <{tag}> objects", self.title());
            return Err(Error::scene(&second.span, what, "keep one of them"));
        }
        Ok(first.and_then(Child::take))
    }

    /// The nested object of that name, of whatever tag.
    pub fn named(&self, name: &str) -> Result<Option<&Node>> {
        self.ask(name);
        Ok(self.children.iter().find(|c| c.name.as_deref() == Some(name)).and_then(Child::take))
    }

    /// The first property or object in the order of the file that nobody has read, as an error.
    pub(super) fn check_read(&self, is_root: bool, seen: &mut HashSet<usize>) -> Result<()> {
        if !seen.insert(self.key) {
            return Ok(());
        }
        let valid = self.valid_names();
        let remedy = |name: &str| suggest(name, valid.iter().map(String::as_str));
        if let Some(p) = self.props.iter().find(|p| !p.read.load(Relaxed)) {
            let what = format!("{} has no property `{}`", self.title(), p.name);
            return Err(Error::scene(&p.span, what, remedy(&p.name)));
        }
        for c in &self.children {
            let Some(node) = c.node.get() else { continue };
            // An object of the library (an id at the top level) is read where it is referred to, or not at all.
            let library = is_root && node.id.is_some() && c.refers_to.is_none() && node.is_library();
            if !c.read.load(Relaxed) && !library {
                let (what, name) = match &c.name {
                    Some(n) => (format!("{} has no object `{n}`", self.title()), n),
                    None => (format!("{} takes no nested {}", self.title(), node.title()), &node.tag),
                };
                return Err(Error::scene(&c.span, what, remedy(name)));
            }
            if node.reached.load(Relaxed) {
                node.check_read(false, seen)?;
            }
        }
        Ok(())
    }

    /// Objects that do nothing by themselves at the top level of a scene.
    pub(super) fn is_library(&self) -> bool {
        !matches!(self.tag.as_str(), "shape" | "emitter" | "sensor" | "integrator")
    }
}

impl Num {
    pub fn eval<R: Real>(self, env: &Env<R>) -> R {
        match self {
            Num::Const(x) => R::from(x),
            Num::Param(i) => env.values.get(i).copied().unwrap_or_else(|| R::from(f64::NAN)),
        }
    }
}
