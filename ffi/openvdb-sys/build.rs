//! Compile the shim against the installed OpenVDB and link it.
//!
//! `OPENVDB_DIR`: prefix with `include/openvdb/openvdb.h` and `lib*/libopenvdb.so`. Dependents read `DEP_OPENVDB_SHIM_VERSION`.

use std::env;
use std::path::{Path, PathBuf};

const LIBRARY_DIRS: [&str; 5] = ["lib/x86_64-linux-gnu", "lib/aarch64-linux-gnu", "lib64", "lib", ""];

fn main() {
    for f in ["build.rs", "src/shim.cpp", "src/shim.h"] {
        println!("cargo:rerun-if-changed={f}");
    }
    println!("cargo:rerun-if-env-changed=OPENVDB_DIR");

    let own_prefix = env::var_os("OPENVDB_DIR").filter(|d| !d.is_empty()).map(PathBuf::from);
    let prefixes = match &own_prefix {
        Some(p) => vec![p.clone()],
        None => vec![PathBuf::from("/usr/local"), PathBuf::from("/usr")],
    };
    let found = prefixes.iter().find_map(|p| {
        let dir = LIBRARY_DIRS.iter().map(|d| p.join(d)).find(|d| d.join("libopenvdb.so").is_file())?;
        p.join("include/openvdb/openvdb.h").is_file().then_some((p, dir))
    });
    let Some((prefix, library_dir)) = found else {
        fail(
            "OpenVDB was not found (include/openvdb/openvdb.h and libopenvdb.so below /usr, /usr/local or OPENVDB_DIR).\n\
              Install it:  sudo apt-get install libopenvdb-dev libboost-dev",
        )
    };
    let version = version(&prefix.join("include/openvdb/version.h"));

    // OpenVDB's headers include boost's, and Debian's package does not say so.
    let system = [prefix.join("include"), PathBuf::from("/usr/include"), PathBuf::from("/usr/local/include")];
    let has = |header: &str| system.iter().any(|d| d.join(header).is_file());
    if version.0 < 12 && !has("boost/any.hpp") {
        fail(
            "boost's headers were not found, and OpenVDB's need them.\nInstall them:  sudo apt-get install libboost-dev",
        )
    }
    if !has("tbb/parallel_for.h") {
        fail("TBB's headers were not found, and OpenVDB's need them.\nInstall them:  sudo apt-get install libtbb-dev")
    }

    let mut build = cc::Build::new();
    build.cpp(true).std("c++17").file("src/shim.cpp").warnings(false).define("NDEBUG", None);
    // An optimised shim with checks off also in debug builds: it copies every voxel.
    build.opt_level(2).debug(false);
    if own_prefix.is_some() {
        build.include(prefix.join("include"));
    }
    // Clippy runs a script of its own, whose library nothing links: the better part of its time.
    println!("cargo:rerun-if-env-changed=RUSTC_WORKSPACE_WRAPPER");
    let lints = env::var("RUSTC_WORKSPACE_WRAPPER").is_ok_and(|w| w.ends_with("clippy-driver"));
    let compiled = if lints { Ok(()) } else { build.try_compile("tyndall_openvdb") };
    if let Err(e) = compiled {
        fail(&format!("the OpenVDB shim does not compile: {e}\nA compiler is needed:  sudo apt-get install g++"));
    }

    println!("cargo:rustc-link-search=native={}", library_dir.display());
    println!("cargo:rustc-link-lib=dylib=openvdb");
    println!("cargo:rustc-link-lib=dylib=tbb");
    // Half floats: Imath 3 in Debian 12 and 13; newer releases drop the suffix, OpenVDB 12 carries its own.
    let all = LIBRARY_DIRS.iter().flat_map(|d| [prefix.join(d), Path::new("/usr").join(d)]);
    let all: Vec<PathBuf> = all.collect();
    for imath in ["Imath-3_1", "Imath-3_2", "Imath"] {
        if all.iter().any(|d| d.join(format!("lib{imath}.so")).is_file()) {
            println!("cargo:rustc-link-lib=dylib={imath}");
            break;
        }
    }
    println!("cargo:version={}.{}.{}", version.0, version.1, version.2);
}

/// Library version of a header; zeros where it cannot be read.
fn version(header: &Path) -> (u32, u32, u32) {
    let text = std::fs::read_to_string(header).unwrap_or_default();
    let part = |which: &str| {
        let key = format!("#define OPENVDB_LIBRARY_{which}_VERSION_NUMBER");
        text.lines().find_map(|l| l.trim().strip_prefix(&key)?.trim().parse().ok()).unwrap_or(0)
    };
    (part("MAJOR"), part("MINOR"), part("PATCH"))
}

fn fail(what: &str) -> ! {
    eprintln!("error: {what}");
    std::process::exit(1)
}
