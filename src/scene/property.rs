//! The elements that are values: `<float>`, `<rgb>`, `<point>`, ..., and `<transform>` with its operations.

use super::desc::suggest;
use super::source::{Element, Source};
use super::transform::Op;
use super::value::{Num, Params, Value};
use crate::error::{Error, Result, Span};

pub(super) const KINDS: [&str; 9] =
    ["float", "integer", "boolean", "string", "rgb", "spectrum", "point", "vector", "transform"];
pub(super) const OPERATIONS: [&str; 5] = ["translate", "rotate", "scale", "lookat", "matrix"];

/// The value of a property element.
pub(super) fn read(params: &mut Params, source: &Source, e: Element, name: &str) -> Result<Value> {
    let tag = e.tag_name().name();
    if tag == "transform" {
        source.only(e, &["name"])?;
        return Ok(Value::Transform(operations(params, source, e)?));
    }
    if tag == "spectrum" {
        if let Some(a) = e.attributes().find(|a| ["type", "filename"].contains(&a.name())) {
            let remedy = format!("write `<rgb name=\"{name}\" value=\"r, g, b\"/>`: the renderer works in linear RGB");
            return Err(Error::scene(
                &source.span(a.range().start),
                "spectra of many wavelengths are not supported",
                remedy,
            ));
        }
    }
    let triple = matches!(tag, "point" | "vector");
    source.only(e, if triple { &["name", "value", "x", "y", "z"] } else { &["name", "value"] })?;
    source.empty(e)?;
    if triple {
        return Ok(Value::Triple(xyz(params, source, e, 0.0, false)?));
    }
    let attr = source.need(e, "value")?;
    let flaw = |what: String, remedy: &str| Err(Error::scene(&attr.span(), what, remedy));
    match tag {
        // A material's name.
        "float" if name.ends_with("_ior") && attr.text.trim().starts_with(|c: char| c.is_ascii_alphabetic()) => {
            let text = attr.text.trim();
            let what = format!("`{text}` is not a number");
            flaw(
                what,
                &format!("write <string name=\"{name}\" value=\"{text}\"/> for a material, or its index as a number"),
            )
        }
        "float" => match params.numbers(&attr, false)?[..] {
            [x] => Ok(Value::Float(x)),
            ref all => Err(arity(&attr.span(), tag, "1 number", all.len())),
        },
        "rgb" | "spectrum" => {
            if tag == "spectrum" && attr.text.contains(':') {
                let remedy = "write `<rgb .../>` or one value: the renderer works in linear RGB";
                return flaw("spectra of many wavelengths are not supported".into(), remedy);
            }
            match params.numbers(&attr, true)?[..] {
                [x] => Ok(Value::Color([x; 3])),
                [r, g, b] => Ok(Value::Color([r, g, b])),
                ref all => Err(arity(&attr.span(), tag, "1 or 3 numbers", all.len())),
            }
        }
        "integer" => {
            let text = params.text(&attr, &format!("an integer (`{name}`)"))?;
            match text.trim().parse() {
                Ok(i) => Ok(Value::Int(i)),
                Err(_) => flaw(
                    format!("`{name}`: `{text}` is not an integer"),
                    "write a whole number such as 16 or -1, or <float> where the property takes any number",
                ),
            }
        }
        "boolean" => match params.text(&attr, &format!("a boolean (`{name}`)"))?.trim() {
            "true" => Ok(Value::Bool(true)),
            "false" => Ok(Value::Bool(false)),
            other => flaw(format!("`{other}` is not a boolean"), "write `true` or `false`"),
        },
        _ if name == "filename" => Ok(Value::Text(params.file_name(&attr, "a file name (`filename`)")?)),
        _ => Ok(Value::Text(params.text(&attr, &format!("a string (`{name}`)"))?)),
    }
}

fn arity(span: &Span, tag: &str, wanted: &str, got: usize) -> Error {
    let remedy = match wanted.starts_with("1 number") {
        true => format!("write {wanted}"),
        false => format!("write {wanted}, separated by commas or blanks"),
    };
    Error::scene(span, format!("<{tag}> takes {wanted}, not {got}"), remedy)
}

/// `value="x, y, z"` or `x= y= z=`; `uniform`: one number for all three.
fn xyz(params: &mut Params, source: &Source, e: Element, default: f64, uniform: bool) -> Result<[Num; 3]> {
    let tag = e.tag_name().name();
    let single = ["x", "y", "z"].map(|n| source.attr(e, n));
    if let Some(attr) = source.attr(e, "value") {
        if let Some(other) = single.iter().flatten().next() {
            let what = format!("<{tag}> has both `value` and `x`, `y`, `z`");
            return Err(Error::scene(&other.span(), what, "keep one of the two forms"));
        }
        let all = params.numbers(&attr, false)?;
        return match all[..] {
            [x, y, z] => Ok([x, y, z]),
            [x] if uniform => Ok([x; 3]),
            _ => Err(arity(&attr.span(), tag, if uniform { "1 or 3 numbers" } else { "3 numbers" }, all.len())),
        };
    }
    if single.iter().all(Option::is_none) {
        let what = format!("<{tag}> has no value");
        return Err(Error::scene(&source.at(e), what, format!("write `<{tag} ... value=\"x, y, z\"/>` or x=, y=, z=")));
    }
    let mut out = [Num::Const(default); 3];
    for (slot, attr) in out.iter_mut().zip(&single) {
        let Some(attr) = attr else { continue };
        match params.numbers(attr, false)?[..] {
            [x] => *slot = x,
            ref all => return Err(arity(&attr.span(), tag, "1 number for each of x, y, z", all.len())),
        }
    }
    Ok(out)
}

fn operations(params: &mut Params, source: &Source, e: Element) -> Result<Vec<(Span, Op)>> {
    let mut out = Vec::new();
    for child in e.children() {
        source.no_text(child)?;
        if !child.is_element() {
            continue;
        }
        let tag = child.tag_name().name();
        // Mitsuba 0.6 wrote lookAt.
        let tag = if source.upgrade && matches!(tag, "lookAt" | "look_at") { "lookat" } else { tag };
        let op = match tag {
            "translate" | "scale" => {
                source.only(child, &["value", "x", "y", "z"])?;
                let moves = tag == "translate";
                let v = xyz(params, source, child, if moves { 0.0 } else { 1.0 }, !moves)?;
                if moves { Op::Translate(v) } else { Op::Scale(v) }
            }
            "rotate" => {
                source.only(child, &["value", "x", "y", "z", "angle"])?;
                let axis = xyz(params, source, child, 0.0, false)?;
                let attr = source.need(child, "angle")?;
                match params.numbers(&attr, false)?[..] {
                    [angle] => Op::Rotate { axis, angle },
                    ref all => return Err(arity(&attr.span(), "rotate", "1 number as angle", all.len())),
                }
            }
            "lookat" => {
                source.only(child, &["origin", "target", "up"])?;
                let mut point = |name: &str| {
                    let attr = source.need(child, name)?;
                    match params.numbers(&attr, false)?[..] {
                        [x, y, z] => Ok([x, y, z]),
                        ref all => Err(arity(&attr.span(), "lookat", "3 numbers", all.len())),
                    }
                };
                let (origin, target) = (point("origin")?, point("target")?);
                let up = source.attr(child, "up").map(|_| point("up")).transpose()?;
                Op::LookAt { origin, target, up }
            }
            "matrix" => matrix(params, source, child)?,
            _ => {
                let what = format!("<{tag}> is not an operation of a <transform>");
                return Err(Error::scene(&source.at(child), what, suggest(tag, OPERATIONS)));
            }
        };
        source.empty(child)?;
        out.push((source.at(child), op));
    }
    Ok(out)
}

/// 16 numbers, row by row, or the 9 of the linear part.
fn matrix(params: &mut Params, source: &Source, e: Element) -> Result<Op> {
    source.only(e, &["value"])?;
    let attr = source.need(e, "value")?;
    let all = params.numbers(&attr, false)?;
    let identity = |i: usize, j: usize| Num::Const(if i == j { 1.0 } else { 0.0 });
    let m: [Num; 16] = match all.len() {
        16 => std::array::from_fn(|k| all[k]),
        9 => std::array::from_fn(|k| match (k / 4, k % 4) {
            (i, j) if i < 3 && j < 3 => all[3 * i + j],
            (i, j) => identity(i, j),
        }),
        n => return Err(arity(&attr.span(), "matrix", "16 or 9 numbers", n)),
    };
    if (0..4).any(|j| m[12 + j] != identity(3, j)) {
        let what = "the last row of <matrix> is not 0 0 0 1";
        return Err(Error::scene(
            &attr.span(),
            what,
            "only affine maps place objects; rows come first, points are columns",
        ));
    }
    Ok(Op::Matrix(Box::new(m)))
}
