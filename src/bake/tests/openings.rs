//! Surfaces that do not block every ray, against form factors.

use std::sync::Arc;

use super::*;
use crate::scene::{Alpha, Material, Picture, Surface, Texture, Wrap};

/// A level point under a square ceiling of half-width 1.5 at height 1, which faces down or up, and
/// the share of its sky that the ceiling takes: F = 4/π · A atan A, A = a/√(1+a²).
fn ceiling(faces_down: bool) -> (Body, f64) {
    let mut body = Body { sensors: usize::MAX, ..Body::nothing() };
    body.positions.extend([Vec3::ZERO, Vec3::Z * 1e-3, Vec3::X * 1e-3]);
    body.normals.extend([Vec3::Y; 3]);
    body.triangles.push([0, 1, 2]);
    let c = |x: f32, z: f32| Vec3::new(1.5 * x, 1.0, 1.5 * z);
    let down = [c(-1.0, -1.0), c(1.0, -1.0), c(1.0, 1.0), c(-1.0, 1.0)];
    body.quad(if faces_down { down } else { [down[0], down[3], down[2], down[1]] });
    let side = 1.5 / f64::from(3.25_f32).sqrt();
    (body, 4.0 * side * side.atan() / std::f64::consts::PI)
}

fn ao(faces_down: bool, material: Material, alpha: bool, one_sided: bool) -> f64 {
    let (body, _) = ceiling(faces_down);
    let uv = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let surface = Surface {
        materials: vec![Material::default(), material],
        material: vec![0, 1, 1],
        uv: vec![[[0.0; 2]; 3], [uv[0], uv[1], uv[2]], [uv[0], uv[2], uv[3]]],
        ..Surface::default()
    };
    let openings = Openings { surface: Arc::new(surface), alpha, one_sided };
    let baker = body.baker(&settings(Signal::Ao, 8192)).through(openings);
    let pose = baker.bake(&[body.posed(0.0)], &AtomicBool::new(false)).unwrap().swap_remove(0);
    f64::from(pose.coefficients[0])
}

/// Over 8,192 rays (which of them a blended surface blocks is random: a standard error of 0.005)
/// a blended ceiling takes its alpha's share of its form factor, a chequered mask the half that is
/// solid, and both all of it where alpha does not count or the material is opaque.
#[test]
fn alpha_lets_its_share_through() {
    let (_, factor) = ceiling(true);
    let blended = Material { alpha: Alpha::Blend, opacity: 0.3, ..Material::default() };
    let texels = vec![[255; 3]; 16];
    let alpha = (0..16).map(|i| if (i / 4 + i % 4) % 2 == 0 { 255 } else { 0 }).collect();
    let picture = Arc::new(Picture { width: 4, height: 4, texels, alpha });
    let texture = Texture { picture, wrap: [Wrap::Repeat; 2] };
    let masked = Material {
        alpha: Alpha::Mask(0.5),
        texture: Some(Arc::new(texture)),
        ..Material::default()
    };
    for (material, share) in [(blended.clone(), 0.3), (masked.clone(), 0.5)] {
        let found = ao(true, material.clone(), true, false);
        assert!((found - (1.0 - share * factor)).abs() < 2e-2, "{share}: {found}, {factor}");
        for (material, alpha) in
            [(material.clone(), false), (Material { alpha: Alpha::Opaque, ..material }, true)]
        {
            let found = ao(true, material, alpha, false);
            assert!((found - (1.0 - factor)).abs() < 1e-3, "{found}, {factor}");
        }
    }
}

/// A one-sided ceiling blocks who sees its front and nobody else; a double-sided one blocks always,
/// and so does every ceiling where sides do not count.
#[test]
fn backs_block_only_where_they_are_meant_to() {
    let (_, factor) = ceiling(true);
    let single = Material::default();
    let double = Material { double_sided: true, ..single.clone() };
    for (faces_down, material, one_sided, share) in [
        (true, &single, true, 1.0),
        (false, &single, true, 0.0),
        (false, &single, false, 1.0),
        (false, &double, true, 1.0),
    ] {
        let found = ao(faces_down, material.clone(), false, one_sided);
        assert!((found - (1.0 - share * factor)).abs() < 1e-3, "{found}, {factor}");
    }
}
