//! `<ref>`s: find their objects, refuse circles, link; then say what nothing refers to.

use super::desc::suggest;
use super::node::Node;
use super::value::Params;
use super::xml::DEEPEST;
use crate::error::{Error, Result, Span, Warning, WarningKind};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

pub(super) fn unresolved(tag: &str, id: &str, span: &Span, nodes: &HashMap<String, Arc<Node>>) -> Error {
    let mut ids: Vec<&str> = nodes.keys().map(String::as_str).collect();
    ids.sort_unstable();
    Error::scene(span, format!("<{tag}> to an unknown id `{id}`"), suggest(id, ids))
}

/// Find the object of every `<ref>`, check that none contains itself, then link them. Returns the keys referred to.
pub(super) fn resolve(root: &Node, nodes: &HashMap<String, Arc<Node>>) -> Result<HashSet<usize>> {
    fn height(
        n: &Node,
        depth: usize,
        nodes: &HashMap<String, Arc<Node>>,
        done: &mut HashMap<usize, Option<usize>>,
        referred: &mut HashSet<usize>,
    ) -> Result<usize> {
        done.insert(n.key, None);
        let mut tallest = 0;
        for c in &n.children {
            let target = match &c.refers_to {
                None => c.node.get().cloned(),
                Some(id) => {
                    let target = nodes.get(id).cloned().ok_or_else(|| unresolved("ref", id, &c.span, nodes))?;
                    referred.insert(target.key);
                    Some(target)
                }
            };
            let Some(target) = target else { continue };
            let below = match done.get(&target.key) {
                Some(Some(h)) => *h,
                Some(None) => {
                    let what = format!("`{}` refers to itself", target.id.as_deref().unwrap_or(&target.tag));
                    return Err(Error::scene(&c.span, what, "break the circle of <ref>s"));
                }
                None if depth < DEEPEST => height(&target, depth + 1, nodes, done, referred)?,
                None => DEEPEST,
            };
            if depth + below >= DEEPEST {
                let what = format!("objects are nested deeper than {DEEPEST} levels");
                return Err(Error::scene(&c.span, what, "shorten the chain of <ref>s"));
            }
            tallest = tallest.max(below);
        }
        done.insert(n.key, Some(tallest + 1));
        Ok(tallest + 1)
    }
    let mut referred = HashSet::new();
    height(root, 0, nodes, &mut HashMap::new(), &mut referred)?;

    // Nothing is circular: link.
    fn link(n: &Node, nodes: &HashMap<String, Arc<Node>>) {
        for c in &n.children {
            match &c.refers_to {
                Some(id) => {
                    if let Some(target) = nodes.get(id) {
                        let _ = c.node.set(target.clone());
                    }
                }
                None => {
                    if let Some(own) = c.node.get() {
                        link(own, nodes);
                    }
                }
            }
        }
    }
    link(root, nodes);
    Ok(referred)
}

/// Parameters and library objects that nothing uses.
pub(super) fn no_effect(root: &Node, params: &Params, referred: &HashSet<usize>) -> Vec<Warning> {
    let warn = |span: &Span, what: String, hint: String| Warning {
        kind: WarningKind::NoEffect,
        span: span.clone(),
        what,
        hint,
    };
    let unused = params.list.iter().filter(|p| p.real_uses + p.other_uses + p.minus_uses == 0);
    let mut out: Vec<Warning> = unused
        .map(|p| {
            warn(
                &p.span,
                format!("parameter `{}` is never used", p.name),
                format!("write `${}` where it should act", p.name),
            )
        })
        .collect();
    for c in root.children.iter().filter(|c| c.refers_to.is_none()) {
        if let Some((n, id)) = c.node.get().and_then(|n| Some((n, n.id.as_ref()?))) {
            if n.is_library() && !referred.contains(&n.key) {
                out.push(warn(
                    &n.span,
                    format!("{} `{id}` is never used", n.title()),
                    format!("write `<ref id=\"{id}\"/>` where it belongs"),
                ));
            }
        }
    }
    out
}
