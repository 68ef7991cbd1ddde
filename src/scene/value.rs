//! Values as they stand in the file: numbers that may be `$parameters`, and the table of parameters.

use super::desc::{DiffHint, Param, suggest};
use super::frame;
use super::source::Attr;
use super::transform::Op;
use crate::error::{Error, Result, Span};
use std::collections::HashMap;
use std::path::Path;

/// A number of the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Num {
    Const(f64),
    /// `$x`, by its index in `SceneDesc::params`.
    Param(usize),
}

/// The value of a property.
#[derive(Clone, Debug)]
pub enum Value {
    Float(Num),
    Int(i64),
    Bool(bool),
    Text(String),
    Color([Num; 3]),
    Triple([Num; 3]),
    Transform(Vec<(Span, Op)>),
}

impl Value {
    /// The parameters among its numbers, each once. Those of a transform belong to its operations.
    pub(super) fn parameters(&self) -> Vec<usize> {
        let numbers: &[Num] = match self {
            Value::Float(x) => std::slice::from_ref(x),
            Value::Color(c) | Value::Triple(c) => c,
            _ => &[],
        };
        let mut found = Vec::new();
        for x in numbers {
            match *x {
                Num::Param(i) if !found.contains(&i) => found.push(i),
                _ => {}
            }
        }
        found
    }
}

/// A finite number, the whole text; else what is wrong.
pub(super) fn number(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() => Ok(x),
        Ok(_) => Err(format!("`{text}` is not a finite number")),
        Err(_) => Err(format!("`{text}` is not a number")),
    }
}

/// `#rrggbb`, sRGB, to linear.
fn hex_color(text: &str) -> Option<[f64; 3]> {
    let digits = text.strip_prefix('#').filter(|d| d.len() == 6 && d.bytes().all(|b| b.is_ascii_hexdigit()))?;
    let bits = u32::from_str_radix(digits, 16).ok()?;
    Some([16, 8, 0].map(|shift| {
        let c = f64::from((bits >> shift) & 255) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    }))
}

/// The words between commas and blanks, each with its byte; an empty place between two commas is `None`.
fn words(text: &str) -> Vec<(usize, Option<&str>)> {
    let mut out = Vec::new();
    let mut offset = 0;
    let pieces: Vec<&str> = text.split(',').collect();
    for (i, piece) in pieces.iter().enumerate() {
        let before = out.len();
        for word in piece.split_ascii_whitespace() {
            out.push((offset + (word.as_ptr() as usize - piece.as_ptr() as usize), Some(word)));
        }
        // A comma at the very end is harmless, an empty place inside is not.
        if out.len() == before && pieces.len() > 1 && i + 1 < pieces.len() {
            out.push((offset, None));
        }
        offset += piece.len() + 1;
    }
    out
}

fn is_name(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// The parameters while the file is being read.
#[derive(Default)]
pub(super) struct Params {
    pub list: Vec<Param>,
    index: HashMap<String, usize>,
    overrides: HashMap<String, String>,
    /// Every name that some `<default>` gives, even further down.
    pub later: HashMap<String, Span>,
    /// The frame that names of files are of.
    frame: Option<u32>,
}

impl Params {
    pub fn new(overrides: &[(String, String)], frame: Option<u32>) -> Result<Self> {
        let mut params = Params { frame, ..Params::default() };
        for (name, text) in overrides {
            if !is_name(name) {
                let what = format!("`-D {name}={text}`: `{name}` is not a parameter name");
                return Err(Error::usage(what, "names consist of letters, digits and `_`"));
            }
            if params.overrides.insert(name.clone(), text.clone()).is_some() {
                return Err(Error::usage(format!("`-D {name}` is given twice"), "keep one of the two"));
            }
        }
        Ok(params)
    }

    fn add(&mut self, name: &str, text: String, span: Span) -> usize {
        let value = number(text.trim()).unwrap_or(f64::NAN);
        let hint = DiffHint::default();
        let (real_uses, other_uses, minus_uses, other_place) = (0, 0, 0, None);
        let name = name.to_owned();
        self.index.insert(name.clone(), self.list.len());
        self.list.push(Param { name, value, text, span, hint, real_uses, other_uses, minus_uses, other_place });
        self.list.len() - 1
    }

    /// A `<default>`. The first one of a name counts, unless `-D` overrides it; a second one in the same file is an error.
    pub fn declare(&mut self, name: &str, text: String, span: Span) -> Result<()> {
        if !is_name(name) {
            let remedy = "names consist of letters, digits and `_`, and do not start with a digit";
            return Err(Error::scene(&span, format!("`{name}` is not a parameter name"), remedy));
        }
        match self.index.get(name).map(|i| self.list[*i].span.clone()) {
            Some(first) if first.file == span.file && !self.overrides.contains_key(name) => {
                let what = format!("parameter `{name}` has a second <default>");
                Err(Error::scene(&span, what, format!("the first is at {first}: keep one of them")))
            }
            Some(_) => Ok(()),
            None => {
                let text = self.overrides.get(name).cloned().unwrap_or(text);
                self.add(name, text, span);
                Ok(())
            }
        }
    }

    fn find(&mut self, name: &str, span: &Span) -> Result<usize> {
        if let Some(i) = self.index.get(name) {
            return Ok(*i);
        }
        if let Some(text) = self.overrides.get(name).cloned() {
            return Ok(self.add(name, text, span.clone()));
        }
        let what = format!("undefined parameter `${name}`");
        let mut known: Vec<&str> = self.index.keys().chain(self.overrides.keys()).map(String::as_str).collect();
        known.sort_unstable();
        known.dedup();
        let remedy = match self.later.get(name) {
            Some(at) => format!("its <default> at {at} comes too late: move it above the first use"),
            None if super::desc::nearest(name, known.iter().copied()).is_some() => suggest(name, known),
            None => {
                let others = if known.is_empty() { String::new() } else { format!("; {}", suggest(name, known)) };
                format!("add `<default name=\"{name}\" value=\"...\"/>` above, or pass `-D {name}=...`{others}")
            }
        };
        Err(Error::scene(span, what, remedy))
    }

    fn used_as(&mut self, i: usize, span: Span, place: String) {
        self.list[i].other_place.get_or_insert((span, place));
    }

    /// Put the text of every `$x` into an attribute that is not a real number.
    pub fn text(&mut self, attr: &Attr, place: &str) -> Result<String> {
        let mut out = String::new();
        let mut rest = attr.text;
        while let Some(at) = rest.find('$') {
            let tail = &rest[at + 1..];
            let end = tail.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(tail.len());
            let span = attr.span_at(attr.text.len() - rest.len() + at);
            if end == 0 {
                return Err(Error::scene(&span, "`$` without a parameter name", "write `$name`"));
            }
            let i = self.find(&tail[..end], &span)?;
            self.list[i].other_uses += 1;
            self.used_as(i, span, place.to_owned());
            out += &rest[..at];
            out += &self.list[i].text;
            rest = &tail[end..];
        }
        Ok(out + rest)
    }

    /// The name of a file, with the frame's number in place of patterns.
    pub fn file_name(&mut self, attr: &Attr, place: &str) -> Result<String> {
        let text = self.text(attr, place)?;
        match self.frame {
            Some(frame) => Ok(frame::numbered(&text, frame).unwrap_or(text)),
            None if frame::has_pattern(&text) && !Path::new(&text).exists() => Err(Error::scene(
                &attr.span(),
                format!("`{text}` has a place for a frame's number, and there is no frame"),
                "give --frames to `render` or `grad`; for other commands write the number here, or a `$parameter` in place of the name",
            )),
            None => Ok(text),
        }
    }

    /// All numbers of an attribute; colours may be `#rrggbb`.
    pub fn numbers(&mut self, attr: &Attr, color: bool) -> Result<Vec<Num>> {
        let mut out = Vec::new();
        for (byte, word) in words(attr.text) {
            let span = attr.span_at(byte);
            match word {
                None => return Err(Error::scene(&span, "nothing between two commas", "write a number there")),
                Some(word) if word.contains('$') => self.parameter(word, &span, color, &mut out)?,
                Some(word) => constants(word, &span, color, &mut out)?,
            }
        }
        Ok(out)
    }

    fn parameter(&mut self, word: &str, span: &Span, color: bool, out: &mut Vec<Num>) -> Result<()> {
        // A whole token carries the derivative.
        if let Some(name) = word.strip_prefix('$').filter(|n| is_name(n)) {
            let i = self.find(name, span)?;
            let p = &mut self.list[i];
            if p.value.is_finite() {
                p.real_uses += 1;
                out.push(Num::Param(i));
                return Ok(());
            }
            // A parameter may stand for several numbers, as text.
            p.other_uses += 1;
            let text = p.text.clone();
            self.used_as(i, span.clone(), "a list of numbers".into());
            for (_, word) in words(&text) {
                constants(word.unwrap_or_default(), span, color, out).map_err(|_| {
                    let flaw = number(&text).err().unwrap_or_default();
                    let remedy =
                        format!("give `${name}` a number: in its <default> ({}) or with `-D`", self.list[i].span);
                    Error::scene(span, format!("parameter `${name}`: {flaw}"), remedy)
                })?;
            }
            return Ok(());
        }
        // `-$x` puts text behind a sign, as Mitsuba does.
        if let Some(name) = word.strip_prefix("-$").filter(|n| is_name(n)) {
            let i = self.find(name, span)?;
            let text = format!("-{}", self.list[i].text.trim());
            self.list[i].minus_uses += 1;
            self.used_as(i, span.clone(), format!("`-${name}` (text behind a sign)"));
            let value = number(&text).map_err(|flaw| {
                let remedy =
                    format!("parameters are put in as text: change the sign of the <default> and write `${name}`");
                Error::scene(span, format!("`-${name}`: {flaw}"), remedy)
            })?;
            out.push(Num::Const(value));
            return Ok(());
        }
        let remedy =
            "write `$name` alone between commas or blanks; there is no arithmetic: add a parameter for the result";
        Err(Error::scene(span, format!("`{word}`: a parameter must stand by itself"), remedy))
    }

    /// After reading: an override that nothing uses is an error.
    pub fn check_overrides(&self) -> Result<()> {
        let used = |p: &&Param| p.real_uses + p.other_uses + p.minus_uses > 0;
        let names = || self.list.iter().filter(used).map(|p| p.name.as_str());
        let mut unused: Vec<&String> = self.overrides.keys().filter(|n| !names().any(|u| u == n.as_str())).collect();
        unused.sort();
        match unused.first() {
            Some(name) => {
                Err(Error::usage(format!("`-D {name}`: the scene never uses `${name}`"), suggest(name, names())))
            }
            None => Ok(()),
        }
    }

    /// `<?diff param="x" min="" max="" step=""?>`, written as an element.
    pub fn hint(&mut self, text: &str, span: &Span) -> Result<()> {
        let flaw = |what: String| {
            Error::scene(
                span,
                format!("<?diff?>: {what}"),
                "write `<?diff param=\"x\" min=\"-1\" max=\"1\" step=\"0.01\"?>`",
            )
        };
        let element = format!("<diff {text}/>");
        let doc = roxmltree::Document::parse(&element).map_err(|_| flaw("malformed hint".into()))?;
        let mut hint = DiffHint::default();
        let mut name = None;
        for a in doc.root_element().attributes() {
            let field = match a.name() {
                "param" => {
                    name = Some(a.value());
                    continue;
                }
                "min" => &mut hint.min,
                "max" => &mut hint.max,
                "step" => &mut hint.step,
                other => return Err(flaw(format!("unknown key `{other}`"))),
            };
            *field = Some(number(a.value().trim()).map_err(&flaw)?);
        }
        let name = name.ok_or_else(|| flaw("no `param`".into()))?;
        let Some(i) = self.index.get(name) else {
            let remedy = suggest(name, self.list.iter().map(|p| p.name.as_str()));
            return Err(Error::scene(span, format!("<?diff?>: unknown parameter `{name}`"), remedy));
        };
        if hint.min.zip(hint.max).is_some_and(|(a, b)| a >= b) {
            return Err(flaw(format!("min is not below max for `{name}`")));
        }
        if hint.step.is_some_and(|s| s <= 0.0) {
            return Err(flaw(format!("step is not positive for `{name}`")));
        }
        self.list[*i].hint = hint;
        Ok(())
    }
}

fn constants(word: &str, span: &Span, color: bool, out: &mut Vec<Num>) -> Result<()> {
    if let Some(c) = color.then(|| hex_color(word)).flatten() {
        out.extend(c.map(Num::Const));
        return Ok(());
    }
    let remedy = if color {
        "write one number, three numbers, or #rrggbb"
    } else {
        "write a plain decimal number such as 1.5 or 2e-3"
    };
    out.push(Num::Const(number(word).map_err(|flaw| Error::scene(span, flaw, remedy))?));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_split_at_commas_and_blanks() {
        assert_eq!(words("1, 2\t3"), [(0, Some("1")), (3, Some("2")), (5, Some("3"))]);
        assert_eq!(words("1,,2"), [(0, Some("1")), (2, None), (3, Some("2"))]);
        assert_eq!(words(" 1 2,"), [(1, Some("1")), (3, Some("2"))]);
        assert_eq!(words("  "), []);
    }

    #[test]
    fn hex_colors_are_linearised() {
        assert_eq!(hex_color("#ff0000"), Some([1.0, 0.0, 0.0]));
        let gray = hex_color("#808080").unwrap();
        assert!((gray[1] - 0.215_860_5).abs() < 1e-6);
        for bad in ["#fff", "ff0000", "#ff00zz", "#ff00ü0"] {
            assert_eq!(hex_color(bad), None);
        }
    }

    #[test]
    fn numbers_are_whole_tokens() {
        assert_eq!(number("-1.5e-3"), Ok(-1.5e-3));
        for bad in ["", "1 2", "0x10", "1f", "inf", "NaN", "1e400", "--1"] {
            assert!(number(bad).is_err(), "{bad}");
        }
    }
}
