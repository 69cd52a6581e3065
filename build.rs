//! Finds Embree 4 and tells the linker; downloads nothing.
//!
//! Looked for in this order: the folder named by `POSELIGHT_EMBREE_DIR`, the folder `.embree/lib`
//! that `make setup` fills, the system's own library by pkg-config's usual folders.

use std::env;
use std::fs;
use std::io;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

/// What the linker asks for, and what the loader asks for at run time.
const LINK_NAME: &str = "libembree4.so";
const SONAME: &str = "libembree4.so.4";

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=POSELIGHT_EMBREE_DIR");
    if env::var_os("CARGO_FEATURE_BAKE").is_none() {
        return;
    }
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let named = env::var_os("POSELIGHT_EMBREE_DIR").map(PathBuf::from);
    let Some(folder) = find(&root, named.as_deref()) else {
        println!("cargo::error={}", not_found(named.as_deref()));
        return;
    };
    watch(&folder);
    link(&folder);
}

/// The folder that holds Embree: the one that is named, else where set-up and systems put it.
pub(crate) fn find(root: &Path, named: Option<&Path>) -> Option<PathBuf> {
    if let Some(named) = named {
        return [named.to_path_buf(), named.join("lib")].into_iter().find(|dir| holds_embree(dir));
    }
    let multiarch = format!("/usr/lib/{}-linux-gnu", env::consts::ARCH);
    [root.join(".embree/lib"), multiarch.into(), "/usr/local/lib".into(), "/usr/lib64".into()]
        .into_iter()
        .find(|dir| holds_embree(dir))
}

fn holds_embree(dir: &Path) -> bool {
    dir.join(SONAME).exists() || dir.join(LINK_NAME).exists()
}

/// The one sentence of a machine without Embree.
pub(crate) fn not_found(named: Option<&Path>) -> String {
    match named {
        None => format!(
            "Embree 4 was not found; run `make setup` in the repository (or set POSELIGHT_EMBREE_DIR \
             to a folder that holds {SONAME})."
        ),
        Some(named) => format!(
            "Embree 4 was not found: POSELIGHT_EMBREE_DIR names {}, which holds no {SONAME}; name \
             another folder, or unset it and run `make setup` in the repository.",
            named.display()
        ),
    }
}

/// Has cargo look again when the library that was found changes or goes. A path that does not exist
/// must not be watched: cargo would take the crate as changed at every build.
fn watch(folder: &Path) {
    let names = [SONAME, LINK_NAME].map(|name| folder.join(name));
    for name in names.iter().filter(|name| name.exists()) {
        println!("cargo:rerun-if-changed={}", name.display());
    }
}

/// Links through a folder of symbolic links inside `OUT_DIR`: cargo puts such folders on the
/// loader's path for everything it runs itself (doc tests too), and the rpath of the found folder
/// serves binaries that are started by hand.
fn link(folder: &Path) {
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default()).join("embree");
    if let Err(error) = mirror(folder, &out) {
        println!(
            "cargo::error=could not link {} into {}: {error}",
            folder.display(),
            out.display()
        );
        return;
    }
    println!("cargo:rustc-link-search=native={}", out.display());
    println!("cargo:rustc-link-arg=-Wl,-rpath,{}", folder.display());
}

/// Embree and the TBB beside it under every name they go by, and the two names that matter.
fn mirror(folder: &Path, out: &Path) -> io::Result<()> {
    let _ = fs::remove_dir_all(out);
    fs::create_dir_all(out)?;
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with("libembree4") || name.starts_with("libtbb") {
            symlink(&path, out.join(name))?;
        }
    }
    for (name, other) in [(LINK_NAME, SONAME), (SONAME, LINK_NAME)] {
        if !out.join(name).exists() {
            symlink(folder.join(other), out.join(name))?;
        }
    }
    Ok(())
}
