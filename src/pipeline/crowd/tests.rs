use super::*;
use crate::pipeline::recipe::{FamilyName, Recipe, SignalName};
use crate::pipeline::{Job, Watch, bake, fit, open_dataset};
use crate::render::Tone;
use crate::scene::{Limits, Source, import_sources};
use crate::shade::{Brdf, Material, ShLight};
use crate::trace::shapes::sphere;

/// A ball that floats over the ground, with its mean visibility by a bake.
fn model() -> (Scene, Model) {
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
    recipe.fit.family = FamilyName::Mean;
    let job = Job::new(import(), None, recipe).expect("a job");
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("ball.zarr");
    let stop = std::sync::atomic::AtomicBool::new(false);
    let watch = Watch { cancelled: &stop, report: &|_| () };
    bake(&job, &path, &watch).expect("baked");
    let dataset = open_dataset(&path).expect("read").expect("a data set");
    (import(), fit(&dataset, &job.recipe).expect("fitted").model)
}

/// Characters and floor are shaded nearer to the truth with the shadows that spheres cast than without;
/// settings out of range are refused by name.
#[test]
fn cast_shadows_come_near_the_truth() {
    let (scene, model) = model();
    let order = model.header().sh_order();
    let light = ShLight::cone(order, [0.6, 0.8, 0.0], 0.5, [3.0; 3]).expect("light");
    let place = |x: f32, clip: Option<&str>| CrowdPlace {
        at: [x, 0.0],
        yaw_degrees: 30.0,
        clip: clip.map(|name| (name.to_owned(), 0.5)),
    };
    let settings = Crowd {
        places: vec![place(-0.35, None), place(0.35, None)],
        spheres: 1,
        floor_vertices: 33,
        light: &light,
        material: Material::from(Brdf::Lambert { albedo: [0.8, 0.6, 0.4] }),
        terms: 4,
        lobes: 3,
        view: [20.0, 30.0],
        size: [32, 24],
        samples: 1,
        rays: 16,
        gains: vec![4.0],
        tone: Tone::Linear,
        exposure_stops: 0.0,
    };
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
    refused(Crowd { view: [0.0, 90.0], ..settings.clone() }, "pitch");
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
