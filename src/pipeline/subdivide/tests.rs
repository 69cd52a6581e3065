use std::sync::atomic::AtomicBool;

use serde_json::json;

mod bad_input;

use super::*;
use crate::bake::subdivide::{ErrorMeasure, Goal};
use crate::pipeline::recipe::{Recipe, SignalName};
use crate::scene::{Limits, Scene, Source as File, import_sources};

/// Corner positions of a quad in order around it.
type Quad = [[f32; 3]; 4];

/// A floor of two triangles, and a column on it of which the top is missing: two primitives of one
/// mesh, each quad with vertices and normals of its own.
fn column() -> Vec<u8> {
    let floor: Quad = [[-2., 0., -2.], [-2., 0., 2.], [2., 0., 2.], [2., 0., -2.]];
    let side = |[a, b]: [[f32; 2]; 2]| {
        [[a[0], 0., a[1]], [b[0], 0., b[1]], [b[0], 3., b[1]], [a[0], 3., a[1]]]
    };
    let corners = [[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]];
    let sides: Vec<Quad> = (0..4).map(|i| side([corners[i], corners[(i + 1) % 4]])).collect();
    let mut binary = Vec::new();
    let (mut views, mut accessors, mut primitives) = (Vec::new(), Vec::new(), Vec::new());
    for quads in [vec![floor], sides] {
        let positions = quads.concat();
        let normal = |quad: &Quad| {
            let [a, b, c, _] = quad.map(glam::Vec3::from);
            [(b - a).cross(c - a).normalize().to_array(); 4]
        };
        let normals: Vec<[f32; 3]> = quads.iter().flat_map(normal).collect();
        let indices: Vec<u16> =
            (0..quads.len() as u16).flat_map(|q| [0, 1, 2, 0, 2, 3].map(|i| q * 4 + i)).collect();
        let mut view = |bytes: Vec<u8>| {
            views.push(json!({"buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len()}));
            binary.extend(bytes);
            binary.resize(binary.len().next_multiple_of(4), 0);
            views.len() - 1
        };
        let first = accessors.len();
        for vectors in [&positions, &normals] {
            let bytes = vectors.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
            accessors.push(json!({"bufferView": view(bytes), "componentType": 5126, "count": vectors.len(), "type": "VEC3", "min": [-2, 0, -2], "max": [2, 3, 2]}));
        }
        let bytes = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        accessors.push(json!({"bufferView": view(bytes), "componentType": 5123, "count": indices.len(), "type": "SCALAR"}));
        primitives.push(
            json!({"attributes": {"POSITION": first, "NORMAL": first + 1}, "indices": first + 2}),
        );
    }
    let document = json!({
        "asset": {"version": "2.0"}, "buffers": [{"byteLength": binary.len()}],
        "bufferViews": views, "accessors": accessors, "meshes": [{"primitives": primitives}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "extras": {"kept": true},
    });
    glb(&document, binary)
}

fn glb(document: &serde_json::Value, binary: Vec<u8>) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = 12 + 8 + text.len() + 8 + binary.len();
    let mut glb = [b"glTF\x02\0\0\0".to_vec(), (length as u32).to_le_bytes().to_vec()].concat();
    for (kind, body) in [(b"JSON", text), (b"BIN\0", binary)] {
        glb.extend((body.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(body);
    }
    glb
}

fn import(glb: Vec<u8>) -> Scene {
    let main = File { name: "column.glb".into(), bytes: glb };
    import_sources(vec![main], &Limits::default()).unwrap()
}

fn job(rays: u32) -> Job {
    let mut recipe = Recipe::default();
    (recipe.bake.rays, recipe.bake.order, recipe.bake.signal) = (rays, 3, SignalName::Transfer);
    Job::new(import(column()), None, recipe).unwrap()
}

fn refinement(measure: ErrorMeasure, triangles: usize) -> Refinement {
    let goal = Goal { triangles, vertices: usize::MAX, error: 0.0, depth: 8, area: 0.0 };
    Refinement { goal, measure, key_poses: 4, bound: 1e-3, keep_bound: false, smooth: false }
}

fn refined(job: &Job, measure: ErrorMeasure, triangles: usize) -> Subdivided {
    let stop = AtomicBool::new(false);
    let probes = interpolation_probes(job, 4, 800, &stop).unwrap();
    subdivide(job, &refinement(measure, triangles), Some(&probes), &stop, &mut |_| ()).unwrap()
}

/// The column's shadow on the floor: each budget is kept and well used, more triangles leave less
/// error, and at equal triangles the orders that see the middles of edges leave at most two thirds of
/// the error of splitting all alike. (Transfer jumps along the contact: the share falls with the root
/// of the number of triangles.)
#[test]
fn triangles_go_where_transfer_changes() {
    let job = job(1024);
    let error = |measure, budget| {
        let done = refined(&job, measure, budget);
        assert!((budget - 6..=budget).contains(&done.triangles[1]), "{:?}", done.triangles);
        done.fidelity.unwrap()[1].rms
    };
    let uniform = error(ErrorMeasure::Uniform, 640);
    let [small, large] = [160, 640].map(|budget| error(ErrorMeasure::Surplus, budget));
    let ahead = error(ErrorMeasure::Midpoint, 640);
    assert!(
        large < small && large.max(ahead) < 0.667 * uniform,
        "{small} {large} {ahead} {uniform}"
    );
}

/// The result is a file that imports: the same surface at rest, the given vertices as they were, the
/// new ones with unit normals and weights, as many values as vertices, everything else kept; and the
/// same bytes each time.
#[test]
fn the_refined_file_is_the_same_surface() {
    let job = job(64);
    let done = refined(&job, ErrorMeasure::Surplus, 300);
    assert_eq!(done.glb, refined(&job, ErrorMeasure::Surplus, 300).glb);
    let (before, after) = (&job.scene.mesh, import(done.glb.clone()).mesh);
    assert_eq!(
        [after.triangles.len(), after.positions.len()],
        [done.triangles[1], done.vertices[1]]
    );
    for (old, new) in before.parts.iter().zip(&after.parts) {
        let count = old.vertices.len();
        let own =
            |mesh: &crate::rig::Mesh, start: usize| mesh.positions[start..start + count].to_vec();
        assert_eq!(own(before, old.vertices.start), own(&after, new.vertices.start));
    }
    let area = |mesh: &crate::rig::Mesh| {
        let of = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
            (b - a).cross(c - a).length() / 2.0
        };
        mesh.triangles.iter().map(of).sum::<f32>()
    };
    assert!((area(before) - area(&after)).abs() < 1e-4);
    assert!(after.normals.iter().all(|normal| (normal.length() - 1.0).abs() < 1e-6));
    assert_eq!(done.values.unwrap().len(), after.positions.len() * 9);
    assert_eq!(done.errors.len(), after.positions.len());
    let text = String::from_utf8_lossy(&done.glb);
    assert!(text.contains(r#""extras":{"kept":true}"#));
}

/// A threshold that cannot be reached ends at the stated depth, and says for how many triangles.
#[test]
fn an_unreachable_threshold_ends_at_the_depth() {
    let job = job(64);
    let mut refinement = refinement(ErrorMeasure::Distance, 100_000);
    (refinement.goal.error, refinement.goal.depth) = (1e-6, 2);
    let done = subdivide(&job, &refinement, None, &AtomicBool::new(false), &mut |_| ()).unwrap();
    assert!(done.work.at_depth > 0 && done.work.left > 1e-6, "{:?}", done.work);
    assert!(done.triangles[1] <= 10 * 16);
}
