//! Pass on what the -sys crates found, and stamp the version.
//!
//! `TYNDALL_VERSION`: the package's version, with the commit where git knows it. `TYNDALL_EMBREE_HEADER`,
//! `TYNDALL_OPENVDB_HEADER`: versions built against. cfg `embree_major = "3" | "4"`.

use std::env;
use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-check-cfg=cfg(embree_major, values(\"3\", \"4\"))");
    let var = |name: &str| env::var(name).unwrap_or_default();

    println!("cargo:rustc-cfg=embree_major=\"{}\"", var("DEP_EMBREE_MAJOR"));
    println!("cargo:rustc-env=TYNDALL_EMBREE_HEADER={}", var("DEP_EMBREE_VERSION"));
    println!("cargo:rustc-env=TYNDALL_OPENVDB_HEADER={}", var("DEP_OPENVDB_SHIM_VERSION"));

    // An Embree from elsewhere may want a newer C library than this system's; it is run through its own loader then.
    if var("DEP_EMBREE_FOREIGN") == "1" {
        println!("cargo:rustc-link-arg=-Wl,--allow-shlib-undefined");
    }

    let package = var("CARGO_PKG_VERSION");
    let version = match git(&["describe", "--always", "--dirty=+", "--exclude=*"]) {
        Some(commit) => format!("{package} ({commit})"),
        None => package,
    };
    println!("cargo:rustc-env=TYNDALL_VERSION={version}");

    // Stamp again at a new commit: HEAD, or the branch that it names.
    for name in ["HEAD", "logs/HEAD"] {
        if let Some(file) = git(&["rev-parse", "--git-path", name]) {
            if Path::new(&file).exists() {
                println!("cargo:rerun-if-changed={file}");
            }
        }
    }
}

/// First line of what git says; `None` outside a repository of our own and where there is no git.
fn git(args: &[&str]) -> Option<String> {
    // A source tree unpacked inside someone else's repository is not that repository's commit.
    let root = env::var("CARGO_MANIFEST_DIR").ok()?;
    if !Path::new(&root).join(".git").exists() {
        return None;
    }
    let out = Command::new("git").args(args).current_dir(root).output().ok()?;
    let line = String::from_utf8(out.stdout).ok()?.lines().next()?.trim().to_string();
    (out.status.success() && !line.is_empty()).then_some(line)
}
