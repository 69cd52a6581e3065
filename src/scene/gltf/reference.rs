//! Every index of the document that import follows, checked once before anything is read.

use gltf::json::{Root, animation, mesh};

use crate::scene::error::Error;

/// Refuses the first index that names nothing.
pub(super) fn check(root: &Root) -> Result<(), Error> {
    views(root)?;
    nodes(root)?;
    skins(root)?;
    for (index, mesh) in root.meshes.iter().enumerate() {
        for (at, primitive) in mesh.primitives.iter().enumerate() {
            check_primitive(root, primitive, || format!("meshes[{index}].primitives[{at}]"))?;
        }
    }
    for (index, animation) in root.animations.iter().enumerate() {
        check_animation(root, animation, || format!("animations[{index}]"))?;
    }
    Ok(())
}

/// One index against the length of its list.
fn within(
    index: usize,
    count: usize,
    list: &'static str,
    place: impl FnOnce() -> String,
) -> Result<(), Error> {
    if index < count {
        return Ok(());
    }
    Err(Error::Reference { place: place(), list, index, count })
}

fn views(root: &Root) -> Result<(), Error> {
    let views = root.buffer_views.len();
    for (index, view) in root.buffer_views.iter().enumerate() {
        within(view.buffer.value(), root.buffers.len(), "buffers", || {
            format!("bufferViews[{index}].buffer")
        })?;
    }
    for (index, accessor) in root.accessors.iter().enumerate() {
        let place = |member: &str| format!("accessors[{index}].{member}");
        if let Some(view) = accessor.buffer_view {
            within(view.value(), views, "bufferViews", || place("bufferView"))?;
        }
        if let Some(sparse) = &accessor.sparse {
            let indices = sparse.indices.buffer_view.value();
            within(indices, views, "bufferViews", || place("sparse.indices.bufferView"))?;
            let values = sparse.values.buffer_view.value();
            within(values, views, "bufferViews", || place("sparse.values.bufferView"))?;
        }
    }
    Ok(())
}

fn nodes(root: &Root) -> Result<(), Error> {
    let count = root.nodes.len();
    for (index, node) in root.nodes.iter().enumerate() {
        for (at, child) in node.children.iter().flatten().enumerate() {
            within(child.value(), count, "nodes", || format!("nodes[{index}].children[{at}]"))?;
        }
        if let Some(mesh) = node.mesh {
            within(mesh.value(), root.meshes.len(), "meshes", || format!("nodes[{index}].mesh"))?;
        }
        if let Some(skin) = node.skin {
            within(skin.value(), root.skins.len(), "skins", || format!("nodes[{index}].skin"))?;
        }
    }
    for (index, scene) in root.scenes.iter().enumerate() {
        for (at, node) in scene.nodes.iter().enumerate() {
            within(node.value(), count, "nodes", || format!("scenes[{index}].nodes[{at}]"))?;
        }
    }
    match root.scene {
        Some(scene) => within(scene.value(), root.scenes.len(), "scenes", || "scene".into()),
        None => Ok(()),
    }
}

fn skins(root: &Root) -> Result<(), Error> {
    for (index, skin) in root.skins.iter().enumerate() {
        for (at, joint) in skin.joints.iter().enumerate() {
            within(joint.value(), root.nodes.len(), "nodes", || {
                format!("skins[{index}].joints[{at}]")
            })?;
        }
        if let Some(matrices) = skin.inverse_bind_matrices {
            within(matrices.value(), root.accessors.len(), "accessors", || {
                format!("skins[{index}].inverseBindMatrices")
            })?;
        }
    }
    Ok(())
}

fn check_primitive(
    root: &Root,
    primitive: &mesh::Primitive,
    place: impl Fn() -> String,
) -> Result<(), Error> {
    let count = root.accessors.len();
    for (semantic, accessor) in &primitive.attributes {
        within(accessor.value(), count, "accessors", || {
            format!("{}.attributes.{}", place(), semantic.to_string())
        })?;
    }
    if let Some(indices) = primitive.indices {
        within(indices.value(), count, "accessors", || format!("{}.indices", place()))?;
    }
    for (at, target) in primitive.targets.iter().flatten().enumerate() {
        let members = [
            ("POSITION", target.positions),
            ("NORMAL", target.normals),
            ("TANGENT", target.tangents),
        ];
        for (name, accessor) in members {
            if let Some(accessor) = accessor {
                within(accessor.value(), count, "accessors", || {
                    format!("{}.targets[{at}].{name}", place())
                })?;
            }
        }
    }
    Ok(())
}

fn check_animation(
    root: &Root,
    animation: &animation::Animation,
    place: impl Fn() -> String,
) -> Result<(), Error> {
    let count = root.accessors.len();
    for (at, sampler) in animation.samplers.iter().enumerate() {
        let (input, output) = (sampler.input.value(), sampler.output.value());
        within(input, count, "accessors", || format!("{}.samplers[{at}].input", place()))?;
        within(output, count, "accessors", || format!("{}.samplers[{at}].output", place()))?;
    }
    for (at, channel) in animation.channels.iter().enumerate() {
        within(channel.sampler.value(), animation.samplers.len(), "samplers", || {
            format!("{}.channels[{at}].sampler", place())
        })?;
        within(channel.target.node.value(), root.nodes.len(), "nodes", || {
            format!("{}.channels[{at}].target.node", place())
        })?;
    }
    Ok(())
}
