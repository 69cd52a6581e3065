//! glTF 2.0 and GLB.
//!
//! The `gltf` crate parses the JSON; everything behind it (references, buffers, accessors,
//! topology, skins, clips) is read and checked here.

mod accessor;
mod buffer;
mod clip;
mod container;
mod extension;
mod instance;
mod mesh;
mod morph;
mod node;
mod reference;
mod skin;
mod surface;
mod topology;

use gltf::json::Root;

pub(super) use container::Document;

use super::budget::{Budget, Notices, Quantity};
use super::{Clip, Content, Error, Surface};
use crate::rig::{Mesh, Skeleton};
use accessor::Usage;
use buffer::Buffers;

pub(super) use buffer::Sources;

/// A document with everything that reading it needs.
struct File<'a, 'l> {
    root: &'a Root,
    buffers: &'a Buffers<'a>,
    /// Which accessors were read.
    usage: Usage,
    budget: &'a mut Budget<'l>,
    notices: &'a mut Notices,
}

/// The names of the external files that the document's views and pictures need, each once.
pub(super) fn external(
    document: &Document,
    content: Content,
    budget: &mut Budget,
) -> Result<Vec<String>, Error> {
    let mut names = buffer::external(&document.root, budget)?;
    if content.plain().is_some() {
        for name in surface::external(&document.root) {
            budget.take(Quantity::Files, 1, &name)?;
            if !names.contains(&name) {
                names.push(name);
            }
        }
    }
    Ok(names)
}

/// Finds the faults of a document that lie in the document itself; whether it needs no other file.
pub(super) fn check(
    document: &Document,
    budget: &mut Budget,
    notices: &mut Notices,
) -> Result<bool, Error> {
    extension::check(&document.root, notices)?;
    reference::check(&document.root)?;
    Ok(buffer::external(&document.root, budget)?.is_empty())
}

/// Builds what the chosen scene of the document shows.
pub(super) fn build(
    document: &Document,
    sources: &Sources,
    content: Content,
    budget: &mut Budget,
    notices: &mut Notices,
) -> Result<(Skeleton, Mesh, Vec<Clip>, Option<Surface>), Error> {
    let root = &document.root;
    extension::check(root, notices)?;
    reference::check(root)?;
    let buffers = Buffers::load(document, sources, budget)?;
    let usage = Usage::none(root.accessors.len());
    let mut file = File { root, buffers: &buffers, usage, budget, notices };
    let graph = node::read(&mut file)?;
    let built = mesh::read(&mut file, &graph)?;
    let clips = clip::read(&mut file, &graph, &built.slots)?;
    if built.mesh.triangles.is_empty() {
        mesh::hidden_fault(&mut file)?;
        let unread = file.unread_accessor_faults().into_iter().next();
        return Err(unread.unwrap_or(Error::NoTriangles { place: graph.scene }));
    }
    let surface = match content.plain() {
        Some(plain) => Some(surface::read(&mut file, &built.mesh, sources, plain)?),
        None => None,
    };
    if content.blocks_whole() {
        surface::tell_alpha(&mut file);
    }
    for fault in file.unread_accessor_faults() {
        notices.add(format!("not needed, but broken: {fault}"));
    }
    Ok((graph.skeleton, built.mesh, clips, surface))
}
