//! Find the installed Embree (4 before 3), bind its own header, link its library.
//!
//! `EMBREE_DIR`: prefix with `include/embreeN/rtcore.h` and `lib*/libembreeN.so`. `EMBREE_MAJOR`: 3 or 4, no other is tried.
//! Dependents read `DEP_EMBREE_MAJOR`, `DEP_EMBREE_VERSION` and, for a prefix of its own, `DEP_EMBREE_FOREIGN=1`.

use std::env;
use std::path::{Path, PathBuf};

const LIBRARY_DIRS: [&str; 5] = ["lib/x86_64-linux-gnu", "lib/aarch64-linux-gnu", "lib64", "lib", ""];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=EMBREE_DIR");
    println!("cargo:rerun-if-env-changed=EMBREE_MAJOR");
    println!("cargo:rustc-check-cfg=cfg(embree, values(\"3\", \"4\"))");

    let own_prefix = env::var_os("EMBREE_DIR").filter(|d| !d.is_empty()).map(PathBuf::from);
    let majors: Vec<u32> = match env::var("EMBREE_MAJOR").as_deref() {
        Ok("3") => vec![3],
        Ok("4") => vec![4],
        Ok("") | Err(_) => vec![4, 3],
        Ok(other) => fail(&format!("EMBREE_MAJOR is `{other}`: it must be 3 or 4")),
    };
    let prefixes = match &own_prefix {
        Some(p) => vec![p.clone()],
        None => vec![PathBuf::from("/usr/local"), PathBuf::from("/usr")],
    };

    // Take the first header whose library lies beside it.
    let mut seen = Vec::new();
    let found = majors.iter().flat_map(|&m| prefixes.iter().map(move |p| (m, p))).find_map(|(major, prefix)| {
        let header = prefix.join(format!("include/embree{major}/rtcore.h"));
        seen.push(header.display().to_string());
        if !header.is_file() {
            return None;
        }
        let name = format!("libembree{major}.so");
        let dir = LIBRARY_DIRS.iter().map(|d| prefix.join(d)).find(|d| d.join(&name).is_file())?;
        Some((major, prefix.clone(), header, dir))
    });
    let Some((major, prefix, header, library_dir)) = found else {
        fail(&format!(
            "Embree was not found (looked for {}, each with its libembreeN.so).\n\
             Install it:  sudo apt-get install libembree-dev libclang-dev\n\
             or name its prefix:  EMBREE_DIR=/opt/embree EMBREE_MAJOR=4 cargo build",
            seen.join(", ")
        ))
    };

    let version = header_version(&prefix.join(format!("include/embree{major}/rtcore_config.h")));
    if !version.starts_with(&format!("{major}.")) || (major == 3 && !version.starts_with("3.13.")) {
        fail(&format!("{} is of Embree {version}: 3.13 or 4.x is needed", header.display()));
    }
    println!("cargo:rerun-if-changed={}", header.display());
    println!("cargo:rustc-cfg=embree=\"{major}\"");
    println!("cargo:rustc-link-search=native={}", library_dir.display());
    println!("cargo:rustc-link-lib=dylib=embree{major}");
    println!("cargo:major={major}");
    println!("cargo:version={version}");
    println!("cargo:foreign={}", u32::from(own_prefix.is_some()));

    let bindings = bindgen::Builder::default()
        .header(header.display().to_string())
        .clang_arg(format!("-I{}", prefix.join("include").display()))
        .allowlist_item("(rtc|RTC).*")
        .blocklist_function("rtc.*(4|8|16|1M|Np|NM)(Ex)?")
        .default_enum_style(bindgen::EnumVariation::NewType { is_bitfield: false, is_global: false })
        .prepend_enum_name(false)
        .rust_target(bindgen::RustTarget::stable(85, 0).unwrap_or_else(|_| fail("bindgen does not know Rust 1.85")))
        .rust_edition(bindgen::RustEdition::Edition2024)
        .generate_comments(false)
        .layout_tests(false)
        .parse_callbacks(Box::new(bindgen::CargoCallbacks::new()))
        .generate();
    let bindings = match bindings {
        Ok(b) => b,
        Err(e) => fail(&format!(
            "bindgen on {}: {e}\nIs libclang there?  sudo apt-get install libclang-dev",
            header.display()
        )),
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default()).join("embree.rs");
    if let Err(e) = bindings.write_to_file(&out) {
        fail(&format!("{}: {e}", out.display()));
    }
}

/// `RTC_VERSION_STRING` of a header, "" if it has none.
fn header_version(config: &Path) -> String {
    let text = std::fs::read_to_string(config).unwrap_or_default();
    text.lines()
        .find_map(|l| l.trim().strip_prefix("#define RTC_VERSION_STRING"))
        .map(|v| v.trim().trim_matches('"').to_string())
        .unwrap_or_default()
}

fn fail(what: &str) -> ! {
    // Cargo shows a build script's panic in a long form; plain text on stderr and a code read better.
    eprintln!("error: {what}");
    std::process::exit(1)
}
