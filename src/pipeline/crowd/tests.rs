use super::*;
use crate::pipeline::recipe::surroundings::GroundRecipe;
use crate::pipeline::recipe::{FamilyName, FrameName, Recipe, SignalName};
use crate::pipeline::{Finish, Job, Watch, bake, fit, open_dataset};
use crate::render::Tone;
use crate::scene::{Limits, Source, import_sources};
use crate::shade::{Brdf, Material, Reflector, ShLight, factor};
use crate::trace::shapes::sphere;

/// A ball, over ground but in the bone frame, with its mean visibility by a bake.
fn model(frame: FrameName) -> (Scene, Model) {
    let (positions, triangles) = sphere(2);
    let mut text = String::new();
    for p in &positions {
        text += &format!("v {} {} {}\n", 0.3 * p.x, 0.3 * p.y + 0.5, 0.3 * p.z);
    }
    for [a, b, c] in triangles {
        text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
    }
    let import = || {
        let source = Source { name: "ball.obj".into(), bytes: text.clone().into_bytes() };
        import_sources(vec![source], &Limits::default()).expect("a ball")
    };
    let mut recipe = Recipe::default();
    (recipe.bake.signal, recipe.bake.order, recipe.bake.rays) = (SignalName::Visibility, 3, 16);
    (recipe.fit.family, recipe.fit.frame) = (FamilyName::Mean, frame);
    // Without anything around it a ball is open in every frame.
    let ground = (frame != FrameName::Bone).then_some(GroundRecipe::Lowest);
    recipe.bake.surroundings.ground = ground;
    let job = Job::new(import(), None, recipe).expect("a job");
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("ball.zarr");
    let stop = std::sync::atomic::AtomicBool::new(false);
    let watch = Watch { cancelled: &stop, report: &|_| () };
    bake(&job, &path, &watch).expect("baked");
    let dataset = open_dataset(&path).expect("read").expect("a data set");
    (import(), fit(&dataset, &job.recipe).expect("fitted").model)
}

/// A small picture of nobody under a light.
fn plain(light: &ShLight) -> Crowd<'_> {
    Crowd {
        places: Vec::new(),
        spheres: 1,
        floor_vertices: 9,
        light,
        finish: Brdf::Lambert { albedo: [0.8, 0.6, 0.4] }.into(),
        terms: 4,
        lobes: 3,
        view: [20.0, 30.0],
        size: [32, 24],
        samples: 1,
        rays: 16,
        gains: vec![4.0],
        tone: Tone::Linear,
        exposure_stops: 0.0,
    }
}

/// Characters and floor are shaded nearer to the truth with the shadows that spheres cast than without;
/// settings out of range are refused by name.
#[test]
fn cast_shadows_come_near_the_truth() {
    let (scene, model) = model(FrameName::Bone);
    let order = model.header().sh_order();
    let light = ShLight::cone(order, [0.6, 0.8, 0.0], 0.5, [3.0; 3]).expect("light");
    let place = |x: f32, clip: Option<&str>| CrowdPlace {
        at: [x, 0.0],
        yaw_degrees: 30.0,
        clip: clip.map(|name| (name.to_owned(), 0.5)),
    };
    let places = vec![place(-0.35, None), place(0.35, None)];
    let settings = Crowd { places, floor_vertices: 33, ..plain(&light) };
    let made = crowd(&scene, &model, &settings).expect("rendered");
    assert!(made.picture.width() > 3 * 32 && made.spheres == 1);
    assert!(
        made.difference < 0.85 * made.difference_without,
        "{} {}",
        made.difference,
        made.difference_without
    );
    let refused = |settings: Crowd<'_>, word: &str| {
        let told = crowd(&scene, &model, &settings).expect_err(word).to_string();
        assert!(told.contains(word), "{told}");
    };
    refused(Crowd { places: Vec::new(), ..settings.clone() }, "1 to 16");
    refused(Crowd { places: vec![place(f32::NAN, None)], ..settings.clone() }, "a place");
    refused(Crowd { places: vec![place(0.0, Some("fly"))], ..settings.clone() }, "fly");
    refused(Crowd { spheres: 0, ..settings.clone() }, "spheres");
    refused(Crowd { terms: 0, ..settings.clone() }, "terms");
    refused(Crowd { terms: 10, ..settings.clone() }, "1 to 9 terms, not 10");
    refused(Crowd { view: [0.0, 90.0], ..settings.clone() }, "pitch");
}

/// A grain runs along tangents, and which way is seen; a model that holds ground, of which the rays of a
/// crowd know nothing, is refused.
#[test]
fn crowds_have_a_grain_and_no_ground_of_their_own() {
    let (scene, bone) = model(FrameName::Bone);
    let order = bone.header().sh_order();
    let light = ShLight::cone(order, [0.3, 1.0, 0.6], 0.4, [3.0; 3]).expect("light");
    let ggx = |alpha| Brdf::Ggx { normal_reflectance: [0.8; 3], alpha };
    let place = CrowdPlace { at: [0.0, 0.0], yaw_degrees: 30.0, clip: None };
    let settings = |alpha| Crowd {
        places: vec![place.clone()],
        finish: ggx(alpha).into(),
        terms: 8,
        ..plain(&light)
    };
    let made = |alpha| crowd(&scene, &bone, &settings(alpha)).expect("rendered");
    let (along, across) = (made([0.2, 0.7]), made([0.7, 0.2]));
    assert!(along.picture != across.picture && along.difference < 0.3, "{}", along.difference);
    let (_, grounded) = model(FrameName::Root);
    let told = crowd(&scene, &grounded, &settings([0.5; 2])).expect_err("ground").to_string();
    assert!(told.contains("surroundings"), "{told}");
}

/// A grain meets models that carry tangents, along which it runs, and no others.
#[test]
fn a_grain_wants_the_tangent_frame() {
    let (scene, root) = model(FrameName::Root);
    let (_, tangent) = model(FrameName::Tangent);
    let order = root.header().sh_order();
    let light = ShLight::cone(order, [0.6, 0.8, 0.0], 0.5, [3.0; 3]).expect("light");
    let pose = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    let lit = |model: &Model, alpha| {
        let finish = Finish::from(Brdf::Ggx { normal_reflectance: [0.9; 3], alpha });
        let operator = finish.operator("x", order, 8).expect("an operator");
        let gloss = Gloss::new(model, &light, operator, 3).expect("a gloss");
        let query = Query::from_pose(model, &scene, &pose).expect("a pose");
        let posed = query.posed(model, Some(&scene)).expect("a mesh");
        let mut out = Vec::new();
        let eye = Vec3::new(1.0, 2.0, 2.0);
        posed.reflected(model, (&gloss, eye, None), None, &mut out).map(|()| out)
    };
    let (along, across) = (lit(&tangent, [0.2, 0.6]), lit(&tangent, [0.6, 0.2]));
    assert_ne!(along.expect("tangents"), across.expect("tangents"));
    let told = lit(&root, [0.2, 0.6]).expect_err("no tangents").to_string();
    assert!(told.contains("frame `tangent`") && told.contains("`root`"), "{told}");
    assert!(lit(&root, [0.4; 2]).is_ok());
}

/// The upper half is half of the constant function, and at the zenith what its bands make of 1.
#[test]
fn the_floor_hides_the_lower_half() {
    let order = Order::new(4).expect("order");
    let upper = upper_half(order);
    let open = (4.0 * std::f32::consts::PI).sqrt();
    assert!((upper[0] - 0.5 * open).abs() < 1e-5, "{upper:?}");
    let mut y = [0.0; 16];
    crate::sh::evaluate(order, Vec3::Y, &mut y);
    let at_zenith: f32 = upper.iter().zip(&y).map(|(u, y)| u * y).sum();
    // 1/2 + 3/4 − 7/16: what four bands make of 1.
    assert!((at_zenith - 0.8125).abs() < 1e-5, "{at_zenith}");
}

/// A model in the tangent frame has the values of one in the root frame, by the scene's mesh and by its own
/// alike; and its visibility, which meets the operator as it is, reflects as that of the other does, which is
/// rotated into every vertex's frame first. Parameters alone give it in its own frame, which no light meets.
#[test]
fn the_tangent_frame_reflects_as_the_root_frame() {
    let (scene, root) = model(FrameName::Root);
    let (_, tangent) = model(FrameName::Tangent);
    assert!(tangent.turns_with_tangents() && tangent.tangents().len() == root.shape().points);
    let pose = Pose::rest(&scene.skeleton, &scene.mesh.default_weights);
    let order = root.header().sh_order();
    let light = ShLight::cone(order, [0.6, 0.8, 0.0], 0.5, [3.0, 2.0, 1.0]).expect("light");
    let brdf = Material::from(Brdf::Ggx { normal_reflectance: [0.9, 0.5, 0.2], alpha: [0.5; 2] });
    let operators = factor(&brdf, order, 16).expect("factored").map(|o| o.operator(5));
    let eye = Vec3::new(1.0, 2.0, 2.0);
    let of = |model: &Model, points: rig::Points| {
        let mesh = scene.mesh.subset(&points.vertex);
        let own = model.clone().with_rest(mesh).expect("its points");
        let reflector = Reflector::new("gold", &operators, [0.0; 3]);
        let gloss = Gloss::new(model, &light, reflector, 3).expect("a gloss");
        [model, &own].map(|model| {
            let query = Query::from_pose(model, &scene, &pose).expect("a pose");
            let (mut values, mut lit) = (Vec::new(), Vec::new());
            query.values(model, None, None, &mut values).expect("values");
            let posed = query.posed(model, Some(&scene)).expect("a mesh");
            posed.reflected(model, (&gloss, eye, None), None, &mut lit).expect("reflected");
            (values, lit)
        })
    };
    let points = || rig::Points::merge(&scene.mesh);
    let [(values, lit), _] = of(&root, points());
    for (found, shaded) in of(&tangent, points()) {
        let apart = |a: &[f32], b: &[f32]| {
            assert_eq!(a.len(), b.len());
            a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        assert!(apart(&values, &found) < 1e-4 && values.iter().any(|x| *x > 1.0));
        assert!(apart(&lit, &shaded) < 1e-4 && lit.iter().any(|x| *x > 0.05));
    }
    let alone = Query::from_parameters(&tangent, &[]).expect("no parameters");
    assert!(!alone.is_turned(&tangent));
    let mut own = Vec::new();
    alone.values(&tangent, None, None, &mut own).expect("its own frame");
    assert!(own.len() == values.len() && own != values);
}
