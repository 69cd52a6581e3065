//! Morphing and linear-blend skinning of the whole mesh.

use glam::{Affine3A, Mat3A, Vec3, Vec3A};

use super::{Mesh, RigidFrame};

/// The mesh in one pose, in the root frame.
///
/// *Facing.* Normals point out of the surface whatever the sign of the blended matrix'
/// determinant. Triangles keep their vertex order, so where a mirroring node has a negative
/// determinant the geometric normal (b − a) × (c − a) points inwards: whoever needs an outward
/// geometric normal gives it the sign of its dot product with the vertex normals.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Deformed {
    /// Metres, parallel to [`Mesh::positions`].
    pub positions: Vec<Vec3>,
    /// Unit shading normals, parallel to `positions`.
    pub normals: Vec<Vec3>,
}

/// Moves every vertex by the pose: x' = root⁻¹ Σ_j w_j · global_j · inverse-bind_j · (x + Σ_m
/// weight_m · δ_m), normals by the inverse transpose of the same blended matrix.
///
/// `globals` are those of [`super::Skeleton::globals`], `weights` those of [`super::Pose`]; `out`
/// is resized, so one buffer serves many poses. Where the blended matrix crushes a normal to
/// nothing, the vertex keeps its undeformed one, turned by the root frame.
///
/// # Panics
/// If `globals` or `weights` are shorter than what the mesh refers to.
pub fn deform(
    mesh: &Mesh,
    globals: &[Affine3A],
    weights: &[f32],
    root: RigidFrame,
    out: &mut Deformed,
) {
    let to_root = root.inverse();
    let matrices: Vec<Affine3A> = mesh
        .deformers
        .iter()
        .map(|deformer| to_root * globals[deformer.node] * deformer.inverse_bind)
        .collect();
    out.positions.clone_from(&mesh.positions);
    out.normals.clone_from(&mesh.normals);
    morph(mesh, weights, out);
    skin(mesh, &matrices, to_root, out);
}

/// Adds the weighted deltas of every target whose weight is not zero.
fn morph(mesh: &Mesh, weights: &[f32], out: &mut Deformed) {
    for target in &mesh.morphs {
        let weight = weights[target.weight];
        if weight == 0.0 {
            continue;
        }
        add(&target.vertices, &target.position_deltas, weight, &mut out.positions);
        add(&target.vertices, &target.normal_deltas, weight, &mut out.normals);
    }
}

/// `values[vertex] += weight · delta` over a sparse list.
fn add(vertices: &[u32], deltas: &[Vec3], weight: f32, values: &mut [Vec3]) {
    for (&vertex, &delta) in vertices.iter().zip(deltas) {
        values[vertex as usize] += weight * delta;
    }
}

/// Applies each vertex's blended matrix in place.
fn skin(mesh: &Mesh, matrices: &[Affine3A], to_root: Affine3A, out: &mut Deformed) {
    let mut start = 0;
    let vertices = out.positions.iter_mut().zip(&mut out.normals);
    for ((position, normal), &end) in vertices.zip(&mesh.influence_starts[1..]) {
        let influences = &mesh.influences[start..end as usize];
        start = end as usize;
        let matrix = match influences {
            [only] => matrices[only.deformer as usize],
            _ => influences.iter().fold(ZERO, |sum, influence| {
                add_scaled(sum, influence.weight, matrices[influence.deformer as usize])
            }),
        };
        *position = matrix.transform_point3a(Vec3A::from(*position)).into();
        *normal = transform_normal(matrix.matrix3, Vec3A::from(*normal))
            .or_else(|| unit(to_root.matrix3 * Vec3A::from(*normal)))
            .unwrap_or(Vec3A::Y)
            .into();
    }
}

const ZERO: Affine3A = Affine3A { matrix3: Mat3A::ZERO, translation: Vec3A::ZERO };

/// `sum + weight · matrix`, entry by entry.
#[inline]
fn add_scaled(sum: Affine3A, weight: f32, matrix: Affine3A) -> Affine3A {
    Affine3A {
        matrix3: Mat3A::from_cols(
            sum.matrix3.x_axis + weight * matrix.matrix3.x_axis,
            sum.matrix3.y_axis + weight * matrix.matrix3.y_axis,
            sum.matrix3.z_axis + weight * matrix.matrix3.z_axis,
        ),
        translation: sum.translation + weight * matrix.translation,
    }
}

/// The unit normal under the inverse transpose of `matrix`, computed as its cofactors times the
/// sign of the determinant: the same direction, without a division that fails for flat matrices.
#[inline]
fn transform_normal(matrix: Mat3A, normal: Vec3A) -> Option<Vec3A> {
    let (a, b, c) = (matrix.x_axis, matrix.y_axis, matrix.z_axis);
    let first = b.cross(c);
    let cofactor = first * normal.x + c.cross(a) * normal.y + a.cross(b) * normal.z;
    unit(if a.dot(first) < 0.0 { -cofactor } else { cofactor })
}

/// The direction of `vector`, also where the square of its length leaves the range of f32.
#[inline]
fn unit(vector: Vec3A) -> Option<Vec3A> {
    let squared = vector.length_squared();
    if squared > 1e-30 && squared < 1e30 {
        return Some(vector / squared.sqrt());
    }
    let largest = vector.abs().max_element();
    if largest > 0.0 { (vector / largest).try_normalize() } else { None }
}

#[cfg(test)]
#[path = "deform_tests.rs"]
mod tests;
