//! Spheres that stand for a character where it casts shadows.

use glam::{Affine3A, Vec3};

use super::Error;
use super::geometry::Geometry;
use super::occluder::{Inscribed, Proxy, cut};
use crate::model::Signal;
use crate::model::occluder::ANCHORS;
use crate::rig::{Bones, Influence, Mesh, Mix, Points, Pose, Skeleton};
use crate::sh::Order;
use crate::shade::SphereSet;

/// Vertices that are looked at, at most.
const CLOUD: usize = 4000;

/// Cuts `count` spheres from the rest mesh, or as many as it allows, at least one for every bone: clusters
/// of the vertices' largest inscribed balls, bone by bone (the same that occluder models are cut by; ours
/// in place of RPO09's clusters of vertices, which are patches of skin where a body is wider than a limb).
/// A centre is moved by the mean of its cluster's influences.
///
/// # Errors
/// What the clustering's decomposition objects to.
pub fn sphere_set(skeleton: &Skeleton, mesh: &Mesh, count: usize) -> Result<SphereSet, Error> {
    let points = Points::merge(mesh);
    let bones = Bones::dominant(mesh, &points);
    let order = Order::new(1).expect("order 1 is one");
    let geometry = Geometry {
        skeleton,
        mesh,
        points: &points,
        bones: &bones,
        signal: Signal::Visibility,
        order,
        columns: Vec::new(),
        tangents: None,
        poses: Vec::new(),
    };
    let spheres = cut(&Inscribed::among(&geometry, CLOUD), count, Proxy::Sphere)?;
    let rest = geometry.rest();
    let mut mixes = Vec::new();
    let mut influences = Vec::new();
    let mut targets = Vec::new();
    for (anchors, offset) in spheres.anchors.chunks_exact(ANCHORS).zip(&spheres.offsets) {
        let vertices: Vec<u32> =
            anchors.iter().map(|&point| points.vertex[point as usize]).collect();
        let carried: Vec3 =
            anchors.iter().map(|&point| rest.positions[point as usize]).sum::<Vec3>();
        targets.push(carried / ANCHORS as f32 + *offset);
        influences.push(mean_influences(mesh, &vertices));
        mixes.push(Mix { vertices: [vertices[0]; 3], weights: [1.0, 0.0, 0.0] });
    }
    let mut centres = mesh.between(&mixes, &influences);
    let pose = Pose::rest(skeleton, &mesh.default_weights);
    let globals = skeleton.globals(&pose.local);
    for (i, target) in targets.iter().enumerate() {
        // Where the blended matrix of the rest pose takes the vertex to the target.
        let matrix = blended(&centres, &globals, i);
        let morphed: Vec3 = morph(&centres, &pose.weights, i);
        let inverse = matrix.inverse();
        if inverse.is_finite() {
            centres.positions[i] = inverse.transform_point3(*target) - morphed;
        }
    }
    Ok(SphereSet::new(centres, spheres.radii))
}

/// The mean of some vertices' influences, heaviest first.
fn mean_influences(mesh: &Mesh, vertices: &[u32]) -> Vec<Influence> {
    let mut sums: Vec<Influence> = Vec::new();
    let share = 1.0 / vertices.len() as f32;
    for &vertex in vertices {
        for &Influence { deformer, weight } in mesh.influences_of(vertex as usize) {
            match sums.iter_mut().find(|sum| sum.deformer == deformer) {
                Some(sum) => sum.weight += share * weight,
                None => sums.push(Influence { deformer, weight: share * weight }),
            }
        }
    }
    sums.sort_by(|a, b| b.weight.total_cmp(&a.weight).then(a.deformer.cmp(&b.deformer)));
    sums
}

/// Σ_j w_j · global_j · inverse-bind_j of a vertex.
fn blended(mesh: &Mesh, globals: &[Affine3A], vertex: usize) -> Affine3A {
    let mut sum = Affine3A::from_scale(Vec3::ZERO);
    for influence in mesh.influences_of(vertex) {
        let deformer = &mesh.deformers[influence.deformer as usize];
        let matrix = globals[deformer.node] * deformer.inverse_bind;
        sum.matrix3 += influence.weight * matrix.matrix3;
        sum.translation += influence.weight * matrix.translation;
    }
    sum
}

/// What morph targets add to a vertex.
fn morph(mesh: &Mesh, weights: &[f32], vertex: usize) -> Vec3 {
    let deltas = mesh.morphs.iter().filter_map(|target| {
        let at = target.vertices.iter().position(|&v| v as usize == vertex)?;
        Some(weights[target.weight] * target.position_deltas[at])
    });
    deltas.sum()
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::rig::{Deformer, Node, RigidFrame, Transform};
    use crate::trace::shapes::sphere;

    /// Two balls of radius 0.3, at the origin and a metre above it, each on a bone of its own.
    fn balls() -> (Skeleton, Mesh) {
        let node = |name: &str, parent, y: f32| Node {
            name: name.to_owned(),
            parent,
            rest: Transform { translation: Vec3::Y * y, ..Transform::IDENTITY },
        };
        let skeleton = Skeleton { nodes: vec![node("a", None, 0.0), node("b", Some(0), 1.0)] };
        let (ball, triangles) = sphere(2);
        let mut mesh = Mesh { influence_starts: vec![0], ..Mesh::default() };
        for bone in 0..2_u32 {
            let (first, centre) = (mesh.positions.len() as u32, Vec3::Y * bone as f32);
            mesh.positions.extend(ball.iter().map(|p| centre + 0.3 * *p));
            mesh.normals.extend(&ball);
            mesh.triangles.extend(triangles.iter().map(|t| t.map(|v| first + v)));
            for _ in &ball {
                mesh.influences.push(Influence { deformer: bone, weight: 1.0 });
                mesh.influence_starts.push(mesh.influences.len() as u32);
            }
            let inverse_bind = Affine3A::from_translation(-centre);
            mesh.deformers.push(Deformer { node: bone as usize, inverse_bind });
        }
        (skeleton, mesh)
    }

    /// Each ball is one sphere about its centre, and moves with its bone: a turn of the lower one swings
    /// the upper one around; a placement moves and scales all.
    #[test]
    fn spheres_are_carried_by_the_bones() {
        let (skeleton, mesh) = balls();
        let set = sphere_set(&skeleton, &mesh, 2).unwrap();
        assert_eq!((set.len(), set.is_empty()), (2, false));
        let mut pose = Pose::rest(&skeleton, &[]);
        let spheres = |pose: &Pose, place: Affine3A| {
            let mut out = Vec::new();
            let globals = skeleton.globals(&pose.local);
            set.pose(&globals, &[], (RigidFrame::IDENTITY, place), &mut out);
            out.sort_by(|a, b| a.centre.y.total_cmp(&b.centre.y));
            out
        };
        let rest = spheres(&pose, Affine3A::IDENTITY);
        assert!(rest[0].centre.length() < 0.02 && (rest[1].centre - Vec3::Y).length() < 0.02);
        assert!(rest.iter().all(|s| (0.2..0.45).contains(&s.radius)), "{rest:?}");
        pose.local[0].rotation = Quat::from_rotation_z(-0.5);
        let turned = spheres(&pose, Affine3A::IDENTITY);
        let expected = Quat::from_rotation_z(-0.5) * rest[1].centre;
        assert!((turned[1].centre - expected).length() < 1e-4, "{turned:?}");
        let place =
            Affine3A::from_scale_rotation_translation(Vec3::splat(2.0), Quat::IDENTITY, Vec3::X);
        let placed = spheres(&pose, place);
        assert!((placed[1].centre - (2.0 * turned[1].centre + Vec3::X)).length() < 1e-4);
        assert!((placed[0].radius - 2.0 * turned[0].radius).abs() < 1e-5);
    }
}
