//! A text file with the place of every byte, and the attributes of its elements.

use super::desc::suggest;
use crate::error::{Error, Result, Span};
use std::path::{Path, PathBuf};

/// An XML element.
pub(super) type Element<'a, 'i> = roxmltree::Node<'a, 'i>;

/// One file of a scene.
pub(super) struct Source<'t> {
    pub file: PathBuf,
    pub text: &'t str,
    /// The byte at which each line starts.
    lines: Vec<usize>,
    /// Names are written as Mitsuba 0.6 and 2.x did (`toWorld`): read them as `to_world`.
    pub upgrade: bool,
}

/// The text of a file, the byte order mark removed.
pub(super) fn decode(file: &Path, bytes: Vec<u8>) -> Result<String> {
    let text = String::from_utf8(bytes).map_err(|e| {
        let good = e.utf8_error().valid_up_to();
        let before = String::from_utf8_lossy(&e.as_bytes()[..good]).into_owned();
        let span = Source::new(file, &before).span(before.len());
        Error::scene(&span, "the file is not UTF-8 text", "save it as UTF-8")
    })?;
    Ok(match text.strip_prefix('\u{feff}') {
        Some(rest) => rest.to_owned(),
        None => text,
    })
}

impl<'t> Source<'t> {
    pub fn new(file: &Path, text: &'t str) -> Self {
        let starts = text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(i, _)| i + 1);
        let lines = std::iter::once(0).chain(starts).collect();
        Source { file: file.to_owned(), text, lines, upgrade: false }
    }

    /// The place of a byte.
    pub fn span(&self, byte: usize) -> Span {
        let line = self.lines.partition_point(|&start| start <= byte).max(1);
        let before = self.text.get(self.lines[line - 1]..byte).unwrap_or_default();
        Span { file: self.file.clone(), line: line as u32, column: before.chars().count() as u32 + 1 }
    }

    /// The place of an element's `<`.
    pub fn at(&self, e: Element) -> Span {
        self.span(e.range().start)
    }

    /// Parse as XML; errors at their place.
    pub fn document(&self) -> Result<roxmltree::Document<'t>> {
        if let Some(byte) = too_deep(self.text) {
            let what = format!("XML: elements are nested deeper than {DEEPEST_XML} levels");
            return Err(Error::scene(&self.span(byte), what, "flatten the scene: use `id` and <ref>"));
        }
        roxmltree::Document::parse(self.text).map_err(|e| {
            use roxmltree::Error as X;
            // Some errors know no place: they belong to the end of the file, or to its beginning.
            let span = match e {
                X::UnclosedRootNode | X::UnexpectedEndOfStream => self.span(self.text.trim_end().len()),
                X::DtdDetected => self.span(self.text.find("<!DOCTYPE").unwrap_or(0)),
                _ => Span { file: self.file.clone(), line: e.pos().row, column: e.pos().col },
            };
            let text = e.to_string();
            let text = text.replace(&format!(" at {}", e.pos()), "");
            let remedy = match e {
                X::DtdDetected => "remove the <!DOCTYPE ...>: scenes take no document type",
                X::UnclosedRootNode | X::UnexpectedEndOfStream => {
                    "close every element, comment and quote: `</scene>` ends the file"
                }
                X::UnexpectedCloseTag(..) => "close the inner element first: `</tag>` or `<tag .../>`",
                X::DuplicatedAttribute(..) => "keep one of the two attributes",
                X::InvalidComment(_) => "a comment must not contain `--`",
                X::MalformedEntityReference(_) | X::UnknownEntityReference(..) => "write `&` as `&amp;`",
                X::InvalidAttributeValue(_) => "close the quote, or write `<` as `&lt;`",
                _ => "an element is `<tag name=\"...\" value=\"...\"/>`; look for a missing quote or bracket here",
            };
            Error::scene(&span, format!("XML: {text}"), remedy)
        })
    }

    /// An attribute, if it is there.
    pub fn attr<'a>(&'a self, e: Element<'a, '_>, name: &str) -> Option<Attr<'a>> {
        let a = e.attributes().find(|a| a.namespace().is_none() && a.name() == name)?;
        Some(Attr { source: self, text: a.value(), range: a.range_value() })
    }

    /// An attribute that must be there.
    pub fn need<'a>(&'a self, e: Element<'a, '_>, name: &str) -> Result<Attr<'a>> {
        self.attr(e, name).ok_or_else(|| {
            let tag = e.tag_name().name();
            let what = format!("<{tag}> has no attribute `{name}`");
            Error::scene(&self.at(e), what, format!("write `<{tag} {name}=\"...\" .../>`"))
        })
    }

    /// Only these attributes may stand there.
    pub fn only(&self, e: Element, valid: &[&str]) -> Result<()> {
        for a in e.attributes() {
            if a.namespace().is_some() || !valid.contains(&a.name()) {
                let what = format!("unknown attribute `{}` of <{}>", a.name(), e.tag_name().name());
                let remedy = suggest(a.name(), valid.iter().copied());
                return Err(Error::scene(&self.span(a.range().start), what, remedy));
            }
        }
        Ok(())
    }

    /// No text may stand there.
    pub fn no_text(&self, child: Element) -> Result<()> {
        let Some(text) = child.text().filter(|t| child.is_text() && !t.trim().is_empty()) else { return Ok(()) };
        let blank = text.len() - text.trim_start().len();
        let word = text.split_whitespace().next().unwrap_or_default();
        let span = self.span(child.range().start + blank);
        Err(Error::scene(
            &span,
            format!("stray text `{word}`"),
            "values stand in attributes: `value=\"...\"`; remarks in <!-- -->",
        ))
    }

    /// Nothing may stand between `<tag>` and `</tag>`.
    pub fn empty(&self, e: Element) -> Result<()> {
        for child in e.children() {
            self.no_text(child)?;
            if child.is_element() {
                let what = format!("<{}> inside <{}>", child.tag_name().name(), e.tag_name().name());
                let remedy = format!("<{}> holds no other elements: close it with `/>`", e.tag_name().name());
                return Err(Error::scene(&self.at(child), what, remedy));
            }
        }
        Ok(())
    }

    /// A property name in today's spelling.
    pub fn modern(&self, name: String) -> String {
        if self.upgrade { snake_case(&name) } else { name }
    }
}

/// Elements inside elements, values included. The XML parser calls itself for each level.
const DEEPEST_XML: usize = 128;

/// The byte at which elements are nested too deeply. What is no XML is left to the parser.
fn too_deep(text: &str) -> Option<usize> {
    let (mut depth, mut at) = (0usize, 0);
    loop {
        at += text[at..].find('<')?;
        let rest = &text[at..];
        let end = |mark: &str| rest.find(mark).map(|n| n + mark.len());
        at += if rest.starts_with("<!--") {
            end("-->")?
        } else if rest.starts_with("<![CDATA[") {
            end("]]>")?
        } else if rest.starts_with("<?") {
            end("?>")?
        } else if rest.starts_with("</") {
            depth = depth.saturating_sub(1);
            end(">")?
        } else {
            // A `>` inside quotes does not close the tag.
            let mut quote = None;
            let close = rest.bytes().position(|b| match (quote, b) {
                (None, b'"' | b'\'') => {
                    quote = Some(b);
                    false
                }
                (None, b'>') => true,
                (Some(q), _) if q == b => {
                    quote = None;
                    false
                }
                _ => false,
            })?;
            depth += usize::from(!rest[..close].ends_with('/'));
            if depth > DEEPEST_XML {
                return Some(at);
            }
            close + 1
        };
    }
}

/// `toWorld`, `intIOR` -> `to_world`, `int_ior`.
fn snake_case(name: &str) -> String {
    let mut out = String::with_capacity(name.len() + 2);
    let mut lower = false;
    for c in name.chars() {
        if c.is_ascii_uppercase() && lower {
            out.push('_');
        }
        lower = c.is_ascii_lowercase() || c.is_ascii_digit();
        out.push(c.to_ascii_lowercase());
    }
    out
}

/// The value of an attribute, with its place.
pub(super) struct Attr<'a> {
    source: &'a Source<'a>,
    pub text: &'a str,
    range: std::ops::Range<usize>,
}

impl Attr<'_> {
    pub fn span(&self) -> Span {
        self.span_at(0)
    }

    /// The place of a byte of the value; of its start where entities make the two differ.
    pub fn span_at(&self, byte: usize) -> Span {
        let plain = self.range.len() == self.text.len();
        self.source.span(self.range.start + if plain { byte } else { 0 })
    }
}

/// FNV-1a, 64 bits, over parts of any length.
pub(super) struct Hash(pub u64);

impl Hash {
    pub fn new() -> Self {
        Hash(0xcbf2_9ce4_8422_2325)
    }

    /// Add a part and its length, so that parts do not run into each other.
    pub fn add(&mut self, part: &str) {
        for b in part.bytes().chain((part.len() as u64).to_le_bytes()) {
            self.0 = (self.0 ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_names_are_upgraded() {
        for (old, new) in [("toWorld", "to_world"), ("intIOR", "int_ior"), ("sigmaT", "sigma_t"), ("g", "g")] {
            assert_eq!(snake_case(old), new);
        }
    }

    #[test]
    fn places_count_characters() {
        let s = Source::new(Path::new("a"), "ab\nüx\n");
        assert_eq!((s.span(0).line, s.span(0).column), (1, 1));
        assert_eq!((s.span(5).line, s.span(5).column), (2, 2));
        assert_eq!((s.span(7).line, s.span(7).column), (3, 1));
    }
}
