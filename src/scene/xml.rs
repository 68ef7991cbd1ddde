//! Mitsuba 3 XML to [`SceneDesc`]: includes, defaults, references, older spellings.

use super::desc::{SceneDesc, suggest};
use super::node::{Child, Node, Prop};
use super::property::{self, KINDS};
use super::refs::{no_effect, resolve, unresolved};
use super::source::{Attr, Element, Hash, Source, decode};
use super::value::Params;
use crate::error::{Error, Result, Span};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, OnceLock};

/// Elements that are objects: they have a `type` and nested elements.
const OBJECTS: [&str; 12] = [
    "shape",
    "bsdf",
    "emitter",
    "medium",
    "volume",
    "phase",
    "sensor",
    "film",
    "sampler",
    "rfilter",
    "integrator",
    "texture",
];
const OTHERS: [&str; 6] = ["default", "path", "alias", "include", "ref", "transform"];

/// Objects inside objects, references included, and files inside files: deeper is taken for a mistake.
pub(super) const DEEPEST: usize = 64;
const DEEPEST_INCLUDE: usize = 16;

pub(super) fn load(path: &Path, overrides: &[(String, String)], frame: Option<u32>) -> Result<SceneDesc> {
    let bytes = std::fs::read(path).map_err(|e| {
        let what = format!("cannot read the scene `{}`: {e}", path.display());
        Error::usage(what, "give the path of a scene's .xml file")
    })?;
    parse(&decode(path, bytes)?, path, overrides, frame)
}

pub(super) fn parse(text: &str, path: &Path, overrides: &[(String, String)], frame: Option<u32>) -> Result<SceneDesc> {
    let mut reader = Reader {
        params: Params::new(overrides, frame)?,
        ids: HashMap::new(),
        nodes: HashMap::new(),
        aliases: Vec::new(),
        folders: vec![path.parent().unwrap_or(Path::new("")).to_owned()],
        shared_folders: Arc::new(OnceLock::new()),
        hash: Hash::new(),
        including: vec![path.canonicalize().unwrap_or_else(|_| path.to_owned())],
        hints: Vec::new(),
        next_key: 0,
    };
    let mut source = Source::new(path, text.strip_prefix('\u{feff}').unwrap_or(text));
    let doc = source.document()?;
    let e = doc.root_element();
    if e.tag_name().name() != "scene" {
        let what = format!("the outermost element is <{}>", e.tag_name().name());
        return Err(Error::scene(&source.at(e), what, "a scene file is `<scene version=\"3.0.0\"> ... </scene>`"));
    }
    source.only(e, &["version"])?;
    source.upgrade = version(&source.need(e, "version")?)?;

    // Read the tree, then resolve what may refer forwards.
    let mut root = reader.node("scene", String::new(), None, None, source.at(e));
    reader.open(&source, &doc);
    reader.fill(&source, e, &mut root, &mut HashMap::new(), 0)?;
    for (span, text) in std::mem::take(&mut reader.hints) {
        reader.params.hint(&text, &span)?;
    }
    reader.params.check_overrides()?;
    reader.resolve_aliases()?;
    let referred = resolve(&root, &reader.nodes)?;
    let warnings = no_effect(&root, &reader.params, &referred);
    let _ = reader.shared_folders.set(reader.folders);

    let mut given: Vec<_> = overrides.iter().collect();
    given.sort();
    for (name, text) in given {
        reader.hash.add(name);
        reader.hash.add(text);
    }
    if let Some(frame) = frame {
        reader.hash.add(&format!("frame {frame}"));
    }
    Ok(SceneDesc { path: path.to_owned(), params: reader.params.list, root, warnings, hash: reader.hash.0 })
}

/// True where names need upgrading.
fn version(attr: &Attr) -> Result<bool> {
    let parts: Option<Vec<u32>> = attr.text.split('.').map(|p| p.parse().ok()).collect();
    match parts.as_deref() {
        Some([3, ..]) => Ok(false),
        Some([2, ..] | [0, 5 | 6, ..]) => Ok(true),
        _ => {
            let what = format!("scene version `{}` is not supported", attr.text);
            Err(Error::scene(&attr.span(), what, "use version=\"3.0.0\"; 2.x and 0.6 are upgraded"))
        }
    }
}

/// The names of properties and objects of one object so far.
type Names = HashMap<String, Span>;

struct Reader {
    params: Params,
    /// Ids as they are opened, and their objects once closed.
    ids: HashMap<String, Span>,
    nodes: HashMap<String, Arc<Node>>,
    /// (id, as, place)
    aliases: Vec<(String, String, Span)>,
    folders: Vec<PathBuf>,
    shared_folders: Arc<OnceLock<Vec<PathBuf>>>,
    hash: Hash,
    including: Vec<PathBuf>,
    hints: Vec<(Span, String)>,
    next_key: usize,
}

impl Reader {
    fn node(&mut self, tag: &str, plugin: String, id: Option<String>, name: Option<String>, span: Span) -> Node {
        self.next_key += 1;
        Node {
            tag: tag.to_owned(),
            plugin,
            id,
            name,
            span,
            key: self.next_key - 1,
            props: Vec::new(),
            children: Vec::new(),
            folders: self.shared_folders.clone(),
            asked: Mutex::default(),
            reached: AtomicBool::new(false),
        }
    }

    /// Note what belongs to a file as a whole: its text, its hints, the names it will define.
    fn open(&mut self, source: &Source, doc: &roxmltree::Document) {
        self.hash.add(source.text);
        for n in doc.root().descendants() {
            if let Some(pi) = n.pi().filter(|pi| pi.target == "diff") {
                self.hints.push((source.at(n), pi.value.unwrap_or_default().to_owned()));
            }
            if let Some(name) = n.attribute("name").filter(|_| n.has_tag_name("default")) {
                self.params.later.entry(name.to_owned()).or_insert_with(|| source.at(n));
            }
        }
    }

    /// Read everything inside an object (or a whole file) into `node`.
    fn fill(&mut self, source: &Source, e: Element, node: &mut Node, names: &mut Names, depth: usize) -> Result<()> {
        for child in e.children() {
            source.no_text(child)?;
            if child.is_element() {
                self.element(source, child, node, names, depth)?;
            }
        }
        Ok(())
    }

    fn element(&mut self, source: &Source, e: Element, node: &mut Node, names: &mut Names, depth: usize) -> Result<()> {
        let tag = e.tag_name().name();
        if let Some(kind) = KINDS.iter().find(|k| **k == tag) {
            let name = self.text(&source.need(e, "name")?, "the name of a property", true)?;
            let name = source.modern(name);
            unique(names, &name, &source.at(e))?;
            // A flaw in a number names the property too.
            let value = property::read(&mut self.params, source, e, &name).map_err(|e| match e {
                Error::Scene { span, what, remedy } if what.ends_with("number") => {
                    Error::Scene { span, what: format!("`{name}`: {what}"), remedy }
                }
                other => other,
            })?;
            node.props.push(Prop { name, kind, span: source.at(e), value, read: AtomicBool::new(false) });
            return Ok(());
        }
        if OBJECTS.contains(&tag) {
            let object = self.object(source, e, depth + 1)?;
            if let Some(name) = &object.name {
                unique(names, name, &source.at(e))?;
            }
            let (name, span) = (object.name.clone(), object.span.clone());
            let object = Arc::new(object);
            if let Some(id) = &object.id {
                self.nodes.insert(id.clone(), object.clone());
            }
            node.children.push(Child {
                name,
                span,
                refers_to: None,
                node: object.into(),
                read: AtomicBool::new(false),
            });
            return Ok(());
        }
        let top = node.tag == "scene";
        match tag {
            "include" => return self.include(source, e, node, names, depth),
            "ref" => {
                source.only(e, &["id", "name"])?;
                let refers_to = Some(self.text(&source.need(e, "id")?, "an id", true)?);
                let name = source.attr(e, "name").map(|a| self.text(&a, "the name of an object", true)).transpose()?;
                let (name, span) = (name.map(|n| source.modern(n)), source.at(e));
                if let Some(name) = &name {
                    unique(names, name, &span)?;
                }
                node.children.push(Child {
                    name,
                    span,
                    refers_to,
                    node: OnceLock::new(),
                    read: AtomicBool::new(false),
                });
            }
            "default" if top => {
                source.only(e, &["name", "value"])?;
                let name = source.need(e, "name")?;
                let value = self.text(&source.need(e, "value")?, "the value of a <default>", false)?;
                self.params.declare(name.text, value, source.at(e))?;
            }
            "path" if top => {
                source.only(e, &["value"])?;
                let value = source.need(e, "value")?;
                let folder = self.text(&value, "a <path>", true)?;
                let full = source.file.parent().unwrap_or(Path::new("")).join(&folder);
                if !full.is_dir() {
                    let remedy = format!("searched {}: relative folders start at the XML file", full.display());
                    return Err(Error::scene(&value.span(), format!("<path>: folder `{folder}` not found"), remedy));
                }
                self.folders.push(full);
            }
            "alias" if top => {
                source.only(e, &["id", "as"])?;
                let id = self.text(&source.need(e, "id")?, "an id", true)?;
                let new = self.text(&source.need(e, "as")?, "an id", true)?;
                self.reserve(&new, source.at(e))?;
                self.aliases.push((id, new, source.at(e)));
            }
            "default" | "path" | "alias" => {
                let what = format!("<{tag}> inside {}", node.title());
                return Err(Error::scene(&source.at(e), what, format!("move <{tag}> to the top level of the scene")));
            }
            _ if property::OPERATIONS.contains(&tag) => {
                let remedy = format!("write `<transform name=\"to_world\"> <{tag} .../> </transform>`");
                return Err(Error::scene(&source.at(e), format!("<{tag}> outside a <transform>"), remedy));
            }
            _ => {
                let valid = OBJECTS.iter().chain(&KINDS).chain(&OTHERS).copied();
                return Err(Error::scene(&source.at(e), format!("unknown element <{tag}>"), suggest(tag, valid)));
            }
        }
        source.empty(e)
    }

    /// The text of an attribute, parameters put in.
    fn text(&mut self, attr: &Attr, place: &str, needed: bool) -> Result<String> {
        let text = self.params.text(attr, place)?;
        if needed && text.is_empty() {
            return Err(Error::scene(&attr.span(), format!("{place} is empty"), "write it between the quotes"));
        }
        Ok(text)
    }

    fn reserve(&mut self, id: &str, span: Span) -> Result<()> {
        if let Some(first) = self.ids.get(id) {
            let remedy = format!("the first is at {first}: rename one of them");
            return Err(Error::scene(&span, format!("duplicate id `{id}`"), remedy));
        }
        self.ids.insert(id.to_owned(), span);
        Ok(())
    }

    fn object(&mut self, source: &Source, e: Element, depth: usize) -> Result<Node> {
        if depth > DEEPEST {
            let what = format!("objects are nested deeper than {DEEPEST} levels");
            return Err(Error::scene(&source.at(e), what, "flatten the scene: use `id` and <ref>"));
        }
        let whole_file = e.parent().is_none_or(|p| p.is_root());
        source.only(e, if whole_file { &["type", "id", "name", "version"] } else { &["type", "id", "name"] })?;
        let plugin = self.text(&source.need(e, "type")?, "the type of an object", true)?;
        let id = source.attr(e, "id").map(|a| self.text(&a, "an id", true)).transpose()?;
        let name = source.attr(e, "name").map(|a| self.text(&a, "the name of an object", true)).transpose()?;
        if let Some(id) = &id {
            self.reserve(id, source.at(e))?;
        }
        let mut node = self.node(e.tag_name().name(), plugin, id, name.map(|n| source.modern(n)), source.at(e));
        self.fill(source, e, &mut node, &mut HashMap::new(), depth)?;
        Ok(node)
    }

    fn include(&mut self, source: &Source, e: Element, node: &mut Node, names: &mut Names, depth: usize) -> Result<()> {
        source.only(e, &["filename"])?;
        source.empty(e)?;
        let attr = source.need(e, "filename")?;
        let name = self.text(&attr, "the file name of an <include>", true)?;
        let error = |what: String, remedy: String| Err(Error::scene(&attr.span(), what, remedy));
        let own = source.file.parent().unwrap_or(Path::new(""));
        let places: Vec<PathBuf> =
            std::iter::once(own).chain(self.folders.iter().map(PathBuf::as_path)).map(|f| f.join(&name)).collect();
        let Some(file) = places.iter().find(|p| p.is_file()) else {
            return error(format!("<include>: file `{name}` not found"), format!("searched {}", places[0].display()));
        };

        // A file inside itself never ends.
        let real = file.canonicalize().unwrap_or_else(|_| file.clone());
        if self.including.contains(&real) || self.including.len() > DEEPEST_INCLUDE {
            return error(format!("<include>: `{name}` includes itself"), "break the circle of includes".into());
        }
        let bytes = match std::fs::read(file) {
            Ok(bytes) => bytes,
            Err(e) => {
                return error(format!("<include>: cannot read `{name}`: {e}"), "check the file's permissions".into());
            }
        };
        let text = decode(file, bytes)?;
        let mut inner = Source::new(file, &text);
        let doc = inner.document()?;
        let root = doc.root_element();
        inner.upgrade = inner.attr(root, "version").map_or(Ok(source.upgrade), |a| version(&a))?;
        self.including.push(real);
        self.open(&inner, &doc);
        if root.tag_name().name() == "scene" {
            inner.only(root, &["version"])?;
            self.fill(&inner, root, node, names, depth)?;
        } else {
            self.element(&inner, root, node, names, depth)?;
        }
        self.including.pop();
        Ok(())
    }

    fn resolve_aliases(&mut self) -> Result<()> {
        for (id, new, span) in &self.aliases {
            let Some(node) = self.nodes.get(id).cloned() else {
                return Err(unresolved("alias", id, span, &self.nodes));
            };
            self.nodes.insert(new.clone(), node);
        }
        Ok(())
    }
}

fn unique(names: &mut Names, name: &str, span: &Span) -> Result<()> {
    if let Some(first) = names.get(name) {
        let remedy = format!("the first is at {first}: keep one of them");
        return Err(Error::scene(span, format!("duplicate property `{name}`"), remedy));
    }
    names.insert(name.to_owned(), span.clone());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Env;

    fn write(dir: &Path, name: &str, text: &str) -> PathBuf {
        let path = dir.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn includes_paths_and_refs() {
        let dir = tempfile::tempdir().unwrap();
        let at = dir.path();
        write(
            at,
            "lib/bsdf.xml",
            "<bsdf type=\"diffuse\" id=\"wood\"><float name=\"reflectance\" value=\"$shade\"/></bsdf>",
        );
        let extra = "<scene version=\"2.0.0\"><default name=\"shade\" value=\"9\"/>\n<shape type=\"obj\"><string name=\"fileName\" value=\"a.obj\"/><ref id=\"wood\"/></shape></scene>";
        let extra = write(at, "lib/extra.xml", extra);
        write(at, "meshes/a.obj", "");
        let text = "\u{feff}<scene version=\"3.0.0\"><default name=\"shade\" value=\"0.25\"/><path value=\"meshes\"/>
            <include filename=\"lib/extra.xml\"/><include filename=\"lib/bsdf.xml\"/>
            <shape type=\"cube\"><ref name=\"coat\" id=\"wood\"/></shape></scene>";
        let main = write(at, "main.xml", text);
        let desc = load(&main, &[], None).unwrap();
        let env: Env<f64> = desc.values();
        let shapes: Vec<&Node> = desc.root.children("shape").collect();
        assert_eq!(shapes[0].span, Span { file: extra.clone(), line: 2, column: 1 });
        // The upgraded name is found, the file through <path>.
        assert_eq!(shapes[0].path("file_name").unwrap(), Some(at.join("meshes/a.obj")));
        // Both refer to one object; the first <default> counts.
        let (a, b) = (shapes[0].child("bsdf").unwrap().unwrap(), shapes[1].named("coat").unwrap().unwrap());
        assert_eq!(a.key(), b.key());
        assert_eq!(a.float(&env, "reflectance", 0.5).unwrap(), 0.25);
        assert_eq!(desc.wrt("shade").unwrap(), 0);
        desc.finish().unwrap();

        // A change of an included file changes the hash.
        let text = std::fs::read_to_string(&extra).unwrap();
        std::fs::write(&extra, text + "\n").unwrap();
        assert_ne!(load(&main, &[], None).unwrap().hash, desc.hash);
    }

    #[test]
    fn a_missing_scene_is_a_usage_error() {
        let e = load(Path::new("no/such/scene.xml"), &[], None).unwrap_err();
        assert!(matches!(e, Error::Usage { .. }), "{e}");
    }

    #[test]
    fn finish_finds_what_is_unread_inside_referred_objects() {
        let text =
            "<scene version=\"3.0.0\"><bsdf type=\"diffuse\" id=\"a\">\n<float name=\"refl\" value=\"1\"/></bsdf>
            <shape type=\"cube\"><ref id=\"a\"/></shape></scene>";
        let desc = parse(text, Path::new("t.xml"), &[], None).unwrap();
        assert!(desc.finish().unwrap_err().to_string().contains("takes no nested <shape"));
        let shape = desc.root.children("shape").next().unwrap();
        assert!(desc.finish().unwrap_err().to_string().contains("takes no nested <bsdf"));
        let bsdf = shape.child("bsdf").unwrap().unwrap();
        bsdf.rgb::<f64>(&desc.values(), "reflectance", 0.5).unwrap();
        let e = desc.finish().unwrap_err().to_string();
        assert!(e.starts_with("t.xml:2:1: ") && e.contains("no property `refl`"), "{e}");
        assert!(!bsdf.has("sheen") && bsdf.has("refl"));
    }
}
