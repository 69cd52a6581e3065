//! Surfaces that no modeller should make and every exporter does.

use glam::Vec3;
use serde_json::{Value, json};

use super::*;
use crate::pipeline::recipe::FamilyName;
use crate::pipeline::recipe::subdivide::SubdivideRecipe;
use crate::rig::Mesh;

/// A file under construction.
struct Maker {
    document: Value,
    binary: Vec<u8>,
}

impl Maker {
    fn new() -> Self {
        let document = json!({
            "asset": {"version": "2.0"}, "bufferViews": [], "accessors": [],
            "meshes": [], "nodes": [], "scenes": [{"nodes": []}],
        });
        Self { document, binary: Vec::new() }
    }

    fn push(&mut self, list: &str, value: Value) -> usize {
        let all = self.document[list].as_array_mut().unwrap();
        all.push(value);
        all.len() - 1
    }

    fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        let start = self.binary.len();
        self.binary.extend(bytes);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": start, "byteLength": bytes.len()});
        let view = self.push("bufferViews", view);
        let accessor =
            json!({"bufferView": view, "componentType": component, "count": count, "type": kind});
        self.push("accessors", accessor)
    }

    fn vectors(&mut self, vectors: &[[f32; 3]]) -> usize {
        let bytes: Vec<u8> = vectors.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let index = self.accessor("VEC3", 5126, vectors.len(), &bytes);
        self.document["accessors"][index]["min"] = json!([-9, -9, -9]);
        self.document["accessors"][index]["max"] = json!([9, 9, 9]);
        index
    }

    fn primitive(&mut self, positions: &[[f32; 3]], indices: &[u16]) -> Value {
        let position = self.vectors(positions);
        let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let indices = self.accessor("SCALAR", 5123, indices.len(), &bytes);
        json!({"attributes": {"POSITION": position}, "indices": indices})
    }

    fn node(&mut self, mut node: Value, primitives: &Value) {
        node["mesh"] = json!(self.push("meshes", json!({"primitives": primitives})));
        let node = self.push("nodes", node);
        self.document["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(node));
    }

    fn glb(&self) -> Vec<u8> {
        let mut document = self.document.clone();
        document["buffers"] = json!([{"byteLength": self.binary.len()}]);
        glb(&document, self.binary.clone())
    }
}

fn of_one_mesh(positions: &[[f32; 3]], indices: &[u16]) -> Vec<u8> {
    let mut maker = Maker::new();
    let primitive = maker.primitive(positions, indices);
    maker.node(json!({}), &json!([primitive]));
    maker.glb()
}

fn job_of(file: Vec<u8>, edit: impl FnOnce(&mut Recipe)) -> Job {
    let mut recipe = Recipe::default();
    (recipe.bake.rays, recipe.bake.order) = (16, 2);
    edit(&mut recipe);
    Job::new(import(file), None, recipe).unwrap()
}

/// Refines without probes; the result and its mesh.
fn refine(job: &Job, triangles: usize) -> (Subdivided, Mesh) {
    let refinement = refinement(ErrorMeasure::Uniform, triangles);
    let done = subdivide(job, &refinement, None, &AtomicBool::new(false), &mut |_| ()).unwrap();
    let mesh = import(done.glb.clone()).mesh;
    (done, mesh)
}

fn area(mesh: &Mesh) -> f32 {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        (b - a).cross(c - a).length() / 2.0
    };
    mesh.triangles.iter().map(of).sum()
}

/// No vertex lies within an edge of a triangle, whose ends lie elsewhere.
fn has_no_t_vertex(mesh: &Mesh) -> bool {
    let edges = mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    edges.into_iter().all(|edge| {
        let [from, to] = edge.map(|v| mesh.positions[v as usize]);
        mesh.triangles.iter().flatten().all(|&v| {
            let p = mesh.positions[v as usize];
            let beside = (p - from).length() + (p - to).length() - (to - from).length();
            let apart = (p - from).length().min((p - to).length());
            apart < 1e-5 || beside > 1e-6
        })
    })
}

/// Three triangles at one edge, one without area and two vertices that are one: all of it is refined,
/// the edge stays shared by all that share it, and nothing opens.
#[test]
fn edges_of_three_flat_triangles_and_doubles_are_kept() {
    let positions = [
        [0., 0., 0.],
        [0., 1., 0.],
        [1., 0., 0.],
        [-1., 0., 0.5],
        [-1., 0., -0.5],
        // The second again, and the middle of the first edge.
        [0., 1., 0.],
        [0., 0.5, 0.],
    ];
    let indices = [0, 2, 1, 0, 1, 3, 0, 5, 4, 0, 6, 1, 3, 3, 0];
    let job = job_of(of_one_mesh(&positions, &indices), |_| ());
    let (done, mesh) = refine(&job, 60);
    assert!((40..=60).contains(&done.triangles[1]), "{:?}", done.triangles);
    assert!((area(&mesh) - area(&job.scene.mesh)).abs() < 1e-5);
    // Triangles without area show no crack; one has a corner within the edge from the start.
    let mut open = mesh.clone();
    open.triangles.retain(|t| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        (b - a).cross(c - a).length() > 1e-9
    });
    assert!(has_no_t_vertex(&open));
    let on_edge = |v: u32| {
        let p = mesh.positions[v as usize];
        p.x.abs() < 1e-6 && p.z.abs() < 1e-6
    };
    let mut shared = std::collections::BTreeMap::new();
    for t in &open.triangles {
        for i in 0..3 {
            let ends = [t[i], t[(i + 1) % 3]];
            if ends.into_iter().all(on_edge) {
                let mut at = ends.map(|v| (mesh.positions[v as usize].y * 1024.0).round() as i32);
                at.sort_unstable();
                *shared.entry(at).or_insert(0) += 1;
            }
        }
    }
    assert!(shared.len() > 1 && shared.values().all(|&count| count == 3), "{shared:?}");
}

/// One triangle becomes 4, 16, 64.
#[test]
fn one_triangle_is_refined() {
    let job = job_of(of_one_mesh(&[[0., 0., 0.], [0., 0., 1.], [1., 0., 0.]], &[0, 1, 2]), |_| ());
    let (done, mesh) = refine(&job, 64);
    assert_eq!((done.triangles, mesh.triangles.len()), ([1, 64], 64));
    assert_eq!(mesh.positions.len(), 45);
    assert!(has_no_t_vertex(&mesh));
}

/// Lines and points stay what they are beside the triangles that are refined.
#[test]
fn lines_and_points_stay() {
    let mut maker = Maker::new();
    let square = [[0., 0., 0.], [0., 0., 1.], [1., 0., 0.], [1., 0., 1.]];
    let mut lines = maker.primitive(&square, &[0, 1, 2, 3]);
    lines["mode"] = json!(1);
    let surface = maker.primitive(&square, &[0, 1, 2, 2, 1, 3]);
    let mut points = maker.primitive(&square, &[0, 1]);
    points["mode"] = json!(0);
    maker.node(json!({}), &json!([lines, surface, points]));
    let job = job_of(maker.glb(), |_| ());
    let (done, mesh) = refine(&job, 32);
    assert_eq!(mesh.triangles.len(), 32);
    let length = u32::from_le_bytes(done.glb[12..16].try_into().unwrap()) as usize;
    let after: Value = serde_json::from_slice(&done.glb[20..20 + length]).unwrap();
    let primitives = &after["meshes"][0]["primitives"];
    assert_eq!((&primitives[0], &primitives[2]), (&lines, &points));
    assert_ne!(primitives[1]["indices"], surface["indices"]);
    assert_eq!(after["accessors"][0], maker.document["accessors"][0]);
}

/// Weights that sum to 0.5 or 2 are what the importer takes them for; those of new vertices sum to 1, and
/// the given ones stay as they were written.
#[test]
fn weights_that_do_not_sum_to_one_are_mixed_as_they_act() {
    let mut maker = Maker::new();
    let positions = [[0., 0., 0.], [0., 0., 1.], [1., 0., 0.]];
    let mut surface = maker.primitive(&positions, &[0, 1, 2]);
    let joints: Vec<u8> = [[0, 1, 0, 0]; 3].concat();
    surface["attributes"]["JOINTS_0"] = json!(maker.accessor("VEC4", 5121, 3, &joints));
    let weights = [[0.25_f32, 0.25, 0., 0.], [2., 0., 0., 0.], [0.5, 1.5, 0., 0.]];
    let bytes: Vec<u8> = weights.iter().flatten().flat_map(|w| w.to_le_bytes()).collect();
    surface["attributes"]["WEIGHTS_0"] = json!(maker.accessor("VEC4", 5126, 3, &bytes));
    maker.document["skins"] = json!([{"joints": [1, 2]}]);
    maker.node(json!({"skin": 0}), &json!([surface]));
    for name in ["a", "b"] {
        let node = maker.push("nodes", json!({"name": name}));
        maker.document["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(node));
    }
    let job = job_of(maker.glb(), |_| ());
    let (_, mesh) = refine(&job, 16);
    for vertex in 0..mesh.positions.len() {
        let sum: f32 = mesh.influences_of(vertex).iter().map(|one| one.weight).sum();
        assert!((sum - 1.0).abs() < 1e-5, "{vertex}: {sum}");
    }
    let near = |p: Vec3| mesh.positions.iter().position(|&q| (q - p).length() < 1e-6).unwrap();
    // Halfway between (½, ½) and (1, 0).
    let middle = mesh.influences_of(near(Vec3::new(0.0, 0.0, 0.5)));
    let first = middle.iter().find(|one| one.deformer == 0).unwrap();
    assert!((first.weight - 0.75).abs() < 1e-5, "{middle:?}");
}

/// A seam whose sides lie among other joints, turning: what is new on it is one place in every pose.
#[test]
fn seams_stay_closed_in_every_pose() {
    let mut maker = Maker::new();
    let positions =
        [[0., 0., 0.], [0., 0., 1.], [1., 0., 0.], [0., 0., 1.], [0., 0., 0.], [-1., 0., 0.]];
    let mut surface = maker.primitive(&positions, &[0, 1, 2, 3, 4, 5]);
    let joints: Vec<u8> =
        [[0, 1, 0, 0], [1, 0, 0, 0], [2, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [3, 0, 0, 0]]
            .concat();
    surface["attributes"]["JOINTS_0"] = json!(maker.accessor("VEC4", 5121, 6, &joints));
    let weights = [[0.5_f32, 0.5], [1., 0.], [1., 0.], [1., 0.], [0.5, 0.5], [1., 0.]];
    let bytes = |all: &[f32]| all.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let weights: Vec<f32> = weights.iter().flat_map(|[a, b]| [*a, *b, 0., 0.]).collect();
    surface["attributes"]["WEIGHTS_0"] = json!(maker.accessor("VEC4", 5126, 6, &bytes(&weights)));
    maker.document["skins"] = json!([{"joints": [1, 2, 3, 4]}]);
    maker.node(json!({"skin": 0}), &json!([surface]));
    let times = maker.accessor("SCALAR", 5126, 2, &bytes(&[0., 1.]));
    (maker.document["accessors"][times]["min"], maker.document["accessors"][times]["max"]) =
        (json!([0]), json!([1]));
    let (mut channels, mut samplers) = (Vec::new(), Vec::new());
    for (joint, angle) in (1..5).zip([0.9_f32, -0.7, 0.5, -0.3]) {
        let node = maker.push("nodes", json!({}));
        assert_eq!(node, joint);
        maker.document["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(node));
        let turn = [0., 0., 0., 1., angle.sin(), 0., 0., angle.cos()];
        let output = maker.accessor("VEC4", 5126, 2, &bytes(&turn));
        samplers.push(json!({"input": times, "output": output}));
        let target = json!({"node": node, "path": "rotation"});
        channels.push(json!({"sampler": joint - 1, "target": target}));
    }
    maker.document["animations"] = json!([{"channels": channels, "samplers": samplers}]);
    let (done, _) = refine(&job_of(maker.glb(), |_| ()), 128);
    assert!(done.deviation.fitted > 4, "{:?}", done.deviation);
    let job = job_of(done.glb, |_| ());
    let rest = &job.scene.mesh.positions;
    let mut doubles = 0;
    for pose in 0..job.poses.samples.len() {
        let posed = job.deformed(pose).positions;
        for (a, b) in (0..rest.len()).flat_map(|b| (0..b).map(move |a| (a, b))) {
            if rest[a] == rest[b] {
                doubles += 1;
                assert!((posed[a] - posed[b]).length() < 1e-6, "{} opens in {pose}", rest[a]);
            }
        }
    }
    assert!(doubles > 8 * job.poses.samples.len(), "{doubles}");
}

/// Of two nodes with meshes of the same form the one that gets values is refined, not the one that only
/// blocks.
#[test]
fn what_only_blocks_is_not_refined() {
    let mut maker = Maker::new();
    let triangle = [[0., 0., 0.], [0., 0., 1.], [1., 0., 0.]];
    for (name, height) in [("roof", 1.0), ("floor", 0.0)] {
        let surface = maker.primitive(&triangle, &[0, 1, 2]);
        maker.node(json!({"name": name, "translation": [0, height, 0]}), &json!([surface]));
    }
    let job = job_of(maker.glb(), |recipe| {
        recipe.bake.surroundings.occluder_nodes = vec!["roof".into()];
    });
    let (_, mesh) = refine(&job, 16);
    let counts: Vec<usize> = mesh.parts.iter().map(|part| part.triangles.len()).collect();
    assert_eq!(counts, [1, 16]);
}

/// A `.gltf` with its buffer as text or in a file of its own gives the mesh that the `.glb` gives.
#[test]
fn other_forms_of_a_scene_are_gathered() {
    let whole = column();
    let length = u32::from_le_bytes(whole[12..16].try_into().unwrap()) as usize;
    let mut document: Value = serde_json::from_slice(&whole[20..20 + length]).unwrap();
    document["buffers"][0]["uri"] = json!("column%20one.bin");
    let main = File { name: "column.gltf".into(), bytes: document.to_string().into_bytes() };
    let buffer = File { name: "column one.bin".into(), bytes: whole[20 + length + 8..].to_vec() };
    let scene = import_sources(vec![main, buffer], &Limits::default()).unwrap();
    let mut recipe = Recipe::default();
    (recipe.bake.rays, recipe.bake.order) = (16, 2);
    let apart = Job::new(scene, None, recipe).unwrap();
    let (_, found) = refine(&apart, 100);
    let (_, expected) = refine(&job_of(whole, |_| ()), 100);
    assert_eq!((found.triangles, found.positions), (expected.triangles, expected.positions));
}

/// New vertices of an octahedron with a sphere's normals come near the sphere where that is asked for: from
/// 0.61 of its radius to 0.80 at the least.
#[test]
fn smooth_surfaces_are_projected_where_asked() {
    let axes =
        [[1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [-1., 0., 0.], [0., -1., 0.], [0., 0., -1.]];
    let indices = [0, 1, 2, 1, 3, 2, 3, 4, 2, 4, 0, 2, 1, 0, 5, 3, 1, 5, 4, 3, 5, 0, 4, 5];
    let mut maker = Maker::new();
    let mut surface = maker.primitive(&axes, &indices);
    surface["attributes"]["NORMAL"] = json!(maker.vectors(&axes));
    maker.node(json!({}), &json!([surface]));
    let job = job_of(maker.glb(), |_| ());
    let least = |smooth| {
        let goal = Goal { triangles: 128, vertices: usize::MAX, error: 0.0, depth: 8, area: 0.0 };
        let refinement = Refinement { goal, smooth, ..refinement(ErrorMeasure::Uniform, 128) };
        let stop = AtomicBool::new(false);
        let done = subdivide(&job, &refinement, None, &stop, &mut |_| ()).unwrap();
        let mesh = import(done.glb).mesh;
        assert_eq!(mesh.triangles.len(), 128);
        mesh.positions.iter().map(|p| p.length()).fold(f32::INFINITY, f32::min)
    };
    assert!((least(false) - 0.375_f32.sqrt()).abs() < 1e-5, "{}", least(false));
    assert!(least(true) > 0.8, "{}", least(true));
}

/// A run's model keeps within the bytes that its mesh was refined for, and uses most of them; a model
/// that has no room for the scene as it is, or of sizes that nobody knows before, is refused.
#[test]
fn a_model_keeps_within_its_bytes() {
    let bytes = 200_000;
    let asked = |bytes, family| {
        let mut recipe = Recipe::default();
        (recipe.bake.rays, recipe.bake.order) = (16, 6);
        recipe.fit.family = family;
        recipe.subdivide = Some(SubdivideRecipe { bytes: Some(bytes), ..Default::default() });
        Job::new(import(column()), None, recipe)
    };
    use crate::pipeline::recipe::FamilyName;
    let folder = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(false);
    let watch = crate::pipeline::Watch { report: &|_| (), cancelled: &stop };
    let job = asked(bytes, FamilyName::Mean).unwrap();
    let job = crate::pipeline::refined(job, &folder.path().join(REFINED), &watch).unwrap();
    let set = folder.path().join("set");
    crate::pipeline::bake(&job, &set, &watch).unwrap();
    let dataset = crate::pipeline::Dataset::open(&set).unwrap();
    let model = crate::pipeline::fit(&dataset, &job.recipe).unwrap().model;
    let found = model.to_bytes(job.checked.precision).unwrap().len() as u64;
    assert!(found <= bytes && found > bytes / 2, "{found} of {bytes}");
    let fault = |made: Result<Job, Error>| made.unwrap_err().to_string();
    let told = fault(asked(50_000, FamilyName::Mean));
    assert!(told.contains("subdivide.bytes") && told.contains("room for"), "{told}");
    let told = fault(asked(bytes, FamilyName::ClusteredTanh));
    assert!(told.contains("the family clustered-tanh"), "{told}");
}

/// Vertices that no triangle uses are kept, and were never baked.
#[test]
fn unused_vertices_are_not_baked_in_vain() {
    let mut positions = vec![[0., 0., 0.], [0., 0., 1.], [1., 0., 0.]];
    positions.resize(23, [5., 5., 5.]);
    let (done, mesh) = refine(&job_of(of_one_mesh(&positions, &[0, 1, 2]), |_| ()), 16);
    assert_eq!(mesh.triangles.len(), 16);
    assert!(done.in_vain < 10, "{}", done.in_vain);
}

/// What refuses a refinement refuses its plan.
#[test]
fn plans_refuse_what_runs_refuse() {
    let told = |edit: fn(&mut Recipe), triangles| {
        let job = job_of(column(), edit);
        let refinement = refinement(ErrorMeasure::Surplus, triangles);
        plan_subdivision(&job, &refinement, 0).unwrap_err().to_string()
    };
    assert!(told(|_| (), 5).contains("less than the 10"), "{}", told(|_| (), 5));
    assert!(told(|recipe| recipe.bake.bounces = 1, 40).contains("bake.bounces"));
    let job = job_of(column(), |_| ());
    let rays = |probes| {
        plan_subdivision(&job, &refinement(ErrorMeasure::Surplus, 40), probes).unwrap().rays
    };
    assert!(rays(100) >= rays(0) + 100 * 4 * 16, "{} {}", rays(100), rays(0));
}

/// Where bytes of a model bound the mesh, the model is a part of what names the refined one and its bake.
#[test]
fn bytes_of_another_model_are_another_refinement() {
    let names = |family, bytes| {
        let job = job_of(column(), |recipe| {
            recipe.fit.family = family;
            recipe.subdivide = Some(SubdivideRecipe { bytes, ..SubdivideRecipe::default() });
        });
        [refinement_hash(&job), job.hashes.bake]
    };
    let [mean, linear] = [FamilyName::Mean, FamilyName::Linear];
    for (a, b) in names(mean, Some(1 << 20)).iter().zip(&names(linear, Some(1 << 20))) {
        assert_ne!(a, b);
    }
    assert_eq!(names(mean, None), names(linear, None));
}
