//! The floors of ARCHITECTURE.md: a module imports only lower ones, `unsafe` stays in `native`.

use std::path::{Path, PathBuf};

/// Every module with its floor.
const FLOORS: [(&str, u32); 18] = [
    ("error", 0),
    ("math", 1),
    ("image", 1),
    ("native", 2),
    ("params", 3),
    ("phase", 3),
    ("shape", 4),
    ("surface", 4),
    ("medium", 4),
    ("light", 4),
    ("sensor", 4),
    ("scene", 5),
    ("transport", 6),
    ("term", 7),
    ("render", 8),
    ("inverse", 9),
    ("study", 9),
    ("cli", 10),
];

fn sources(dir: &Path, out: &mut Vec<PathBuf>) {
    for e in std::fs::read_dir(dir).unwrap() {
        let p = e.unwrap().path();
        if p.is_dir() {
            sources(&p, out);
        } else if p.extension().is_some_and(|x| x == "rs") {
            out.push(p);
        }
    }
}

fn all() -> (PathBuf, Vec<PathBuf>) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    (root, files)
}

fn floor(module: &str) -> u32 {
    FLOORS
        .iter()
        .find(|f| f.0 == module)
        .unwrap_or_else(|| panic!("module `{module}` has no floor: add it here and to ARCHITECTURE.md"))
        .1
}

#[test]
fn no_module_imports_a_higher_floor() {
    let (root, files) = all();
    let mut wrong = Vec::new();
    for f in files {
        let relative = f.strip_prefix(&root).unwrap();
        let module =
            relative.components().next().unwrap().as_os_str().to_str().unwrap().trim_end_matches(".rs").to_string();
        if ["lib", "main"].contains(&module.as_str()) {
            continue;
        }
        let own = floor(&module);
        for (i, line) in std::fs::read_to_string(&f).unwrap().lines().enumerate() {
            let mut rest = line;
            while let Some(at) = rest.find("crate::") {
                rest = &rest[at + 7..];
                let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                if !line.trim_start().starts_with("//") && FLOORS.iter().any(|x| x.0 == name) && floor(&name) > own {
                    wrong.push(format!("{}:{}: imports `{name}`", relative.display(), i + 1));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "upward imports:\n{}", wrong.join("\n"));
}

#[test]
fn unsafe_lives_in_native() {
    let (root, files) = all();
    for f in files {
        let relative = f.strip_prefix(&root).unwrap();
        let text = std::fs::read_to_string(&f).unwrap();
        let code = text.lines().filter(|l| !l.trim_start().starts_with("//"));
        let uses =
            code.filter(|l| l.contains("unsafe {") || l.contains("unsafe fn") || l.contains("unsafe impl")).count();
        assert!(uses == 0 || relative.starts_with("native"), "unsafe in {}", relative.display());
    }
}
