use std::sync::LazyLock;

use super::*;
use crate::render::Tone;
use crate::scene::{Limits, Source, figure, import_sources};

/// Made once: building the figure takes longer than any picture here.
static SCENE: LazyLock<Scene> = LazyLock::new(|| {
    let source = Source { name: "figure.glb".into(), bytes: figure::figure() };
    import_sources(vec![source], &Limits::default()).expect("the bundled figure")
});

pub(in crate::pipeline) fn settings<'a>() -> Still<'a> {
    Still {
        clip: None,
        times_s: Vec::new(),
        view: [30.0, 10.0],
        size: [24, 24],
        samples: 1,
        rays: 16,
        gains: vec![4.0],
        light: None,
        brdf: None,
        terms: 8,
        lobes: 8,
        turntable: None,
        tone: Tone::Linear,
        exposure_stops: 0.0,
    }
}

/// Without a model there is one panel a frame; frames are spread from the first to the last
/// moment; more stops are brighter, and a light's white is its brightest open surface.
#[test]
fn a_scene_alone_is_shaded_by_rays() {
    let scene = &*SCENE;
    let one = still(scene, None, &settings()).expect("rendered");
    assert_eq!(one.differences, [None]);
    let clip = scene.clips[0].name.clone();
    let times_s = spread_times(scene, &clip, 4).expect("times");
    assert_eq!((times_s[0], times_s[3]), (0.0, scene.clips[0].duration_s));
    let order = Order::new(3).expect("order");
    let light = ShLight::directional(order, [0.0, 1.0, 0.0], [8.0; 3]).expect("light");
    let lit = Still { clip: Some(&clip), times_s, light: Some(light), ..settings() };
    let four = still(scene, None, &lit).expect("rendered");
    assert_eq!(four.differences.len(), 4);
    assert!(four.pictures[0].width() > 2 * 24 && four.pictures[0].height() > 2 * 24);
    let brighter = still(scene, None, &Still { exposure_stops: 1.0, ..lit }).expect("rendered");
    assert!((brighter.exposure / four.exposure - 2.0).abs() < 1e-5);
}

/// A turn is a picture a frame, all of one size and not the same; a clip may play meanwhile.
#[test]
fn a_turntable_is_a_picture_a_frame() {
    let scene = &*SCENE;
    let turn = Still { turntable: Some(3), ..settings() };
    let made = still(scene, None, &turn).expect("rendered");
    assert_eq!((made.pictures.len(), made.differences.len()), (3, 3));
    assert!(made.pictures.iter().all(|p| p.width() == made.pictures[0].width()));
    assert_ne!(made.pictures[0], made.pictures[1]);
    let clip = scene.clips[0].name.clone();
    let times_s = vec![0.0, 0.2, 0.4];
    let playing = Still { clip: Some(&clip), times_s, ..turn.clone() };
    let played = still(scene, None, &playing).expect("rendered");
    assert_ne!(played.pictures[1], made.pictures[1]);
    let filmic = Still { tone: Tone::Filmic, ..settings() };
    let plain = still(scene, None, &settings()).expect("rendered");
    assert_ne!(still(scene, None, &filmic).expect("rendered").pictures, plain.pictures);
}

/// A grain runs along tangents of the bones, and which way it runs is seen; the still says how smooth
/// they are.
#[test]
fn reflectances_may_have_a_grain() {
    let order = Order::new(4).expect("order");
    let light = ShLight::cone(order, [0.3, 1.0, 0.6], 0.4, [6.0; 3]).expect("light");
    let made = |alpha: [f64; 2]| {
        let brdf = Brdf::Ggx { normal_reflectance: [0.8; 3], alpha };
        let lit = Some(light.clone());
        let grained = Still { brdf: Some(brdf.into()), light: lit, ..settings() };
        still(&SCENE, None, &grained).expect("rendered")
    };
    let (along, across) = (made([0.2, 0.7]), made([0.7, 0.2]));
    assert!(along.notices[0].contains("between neighbours"), "{:?}", along.notices);
    assert_ne!(along.pictures, across.pictures);
    assert!(made([0.4, 0.4]).notices.is_empty());
}

/// An operator from a file shades where rays can follow the reflectance that its name says; by rays
/// alone, and unknown to them, it is refused. What is wrong with a reflectance is told.
#[test]
fn operators_are_shown_where_rays_can_follow() {
    let order = Order::new(4).expect("order");
    let light = ShLight::cone(order, [0.3, 1.0, 0.6], 0.4, [6.0; 3]).expect("light");
    let gold = Finish::from(Brdf::Ggx { normal_reflectance: [0.9; 3], alpha: [0.4; 2] });
    let of = |name: &str| {
        let made = gold.operator(name, order, 8).expect("made").to_bytes().expect("bytes");
        Finish::from_bytes(&made).expect("read")
    };
    let lit = |brdf: Finish| Still { brdf: Some(brdf), light: Some(light.clone()), ..settings() };
    let known = still(&SCENE, None, &lit(of("ggx:0.9,0.4"))).expect("rendered");
    assert_eq!(known.pictures, still(&SCENE, None, &lit(gold.clone())).expect("rendered").pictures);
    let told = still(&SCENE, None, &lit(of("gold.binary"))).expect_err("unknown").to_string();
    assert!(told.contains("`gold.binary` does not tell"), "{told}");
    let (diffuse, specular) = ([1.0; 3], [0.5; 3]);
    let gain = Brdf::Phong { diffuse, specular, exponent: 2.0 };
    let made = still(&SCENE, None, &lit(gain.into())).expect("rendered");
    assert!(made.notices.iter().any(|told| told.contains("makes energy")), "{:?}", made.notices);
}

/// Numbers out of range, unknown clips and times past the end are refused by name.
#[test]
fn wrong_settings_are_refused() {
    let scene = &*SCENE;
    let clip = scene.clips[0].name.clone();
    let refused = |settings: Still<'_>, word: &str| {
        let message = still(scene, None, &settings).expect_err(word).to_string();
        assert!(message.contains(word), "{message}");
    };
    refused(Still { size: [8, 24], ..settings() }, "16 to 4096");
    refused(Still { samples: 0, ..settings() }, "samples");
    refused(Still { turntable: Some(1), ..settings() }, "of a turn");
    let two = vec![0.0; 2];
    let torn = Still { clip: Some(&clip), times_s: two, turntable: Some(3), ..settings() };
    refused(torn, "one each");
    refused(Still { lobes: 9, ..settings() }, "lobes");
    refused(Still { rays: 1, ..settings() }, "rays");
    refused(Still { gains: vec![f32::NAN], ..settings() }, "gain");
    refused(Still { view: [0.0, 90.0], ..settings() }, "pitch");
    refused(Still { exposure_stops: f32::NAN, ..settings() }, "exposure");
    refused(Still { clip: Some("fly"), times_s: vec![0.0], ..settings() }, "fly");
    refused(Still { clip: Some(&clip), times_s: vec![1e9], ..settings() }, "no time");
    refused(Still { clip: Some(&clip), times_s: vec![f32::NAN], ..settings() }, "no time");
    refused(Still { clip: Some(&clip), ..settings() }, "frames");
    let many = vec![0.0; MOST_STILL_FRAMES];
    refused(Still { clip: Some(&clip), times_s: many, size: [4096; 2], ..settings() }, "at most");
}
