//! Proves that real environment maps become the light that they show: their mean, the side of
//! their sun, and lobes that hold most of their energy; by the real binary and by the library.

use std::process::Command;

use poselight::scene;
use poselight::sh::Order;
use poselight::shade::{EnvironmentMap, ZonalLight};
use serde_json::Value;

#[path = "needs/assets.rs"]
mod assets;

/// The map of a few texels is projected as its own sum over texels says, by midpoints: a slow
/// path that shares nothing with the exact one but the texels.
#[test]
fn real_maps_are_their_texels() {
    let Some(folder) = assets::folder() else { return };
    let path = folder.join("env/royal_esplanade_256.hdr");
    let picture = scene::environment(&std::fs::read(&path).expect("map"), "map").expect("decoded");
    let (width, height) = (picture.width, picture.height);
    let map = EnvironmentMap { width, height, texels: &picture.texels };
    let order = Order::new(6).expect("order");
    let (light, facts) = map.project(order).expect("projected");
    let mut sum = vec![0.0; 36];
    let mut y = [0.0; 36];
    for (i, texel) in picture.texels.iter().enumerate() {
        let u = ((i % width) as f64 + 0.5) / width as f64;
        let v = ((i / width) as f64 + 0.5) / height as f64;
        let (azimuth, polar) = (std::f64::consts::TAU * (u - 0.5), std::f64::consts::PI * v);
        let d = [polar.sin() * azimuth.cos(), polar.cos(), polar.sin() * azimuth.sin()];
        poselight::sh::evaluate_f64(order, d, &mut y);
        let area = polar.sin() * 2.0 * std::f64::consts::PI.powi(2) / (width * height) as f64;
        sum.iter_mut().zip(&y).for_each(|(s, y)| *s += area * f64::from(texel[1]) * y);
    }
    let norm = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
    for (i, (a, b)) in light.colours()[1].iter().zip(&sum).enumerate() {
        assert!((a - b).abs() < 2e-3 * norm, "coefficient {i}: {a} {b}");
    }
    let mean = facts.mean_radiance[1] * (4.0 * std::f64::consts::PI).sqrt();
    assert!((light.coefficient(0)[1] / mean - 1.0).abs() < 1e-12);
}

/// Three lobes leave less than a tenth of the energy of each real map at order 4, eight (or as many
/// as there is anything left for) next to nothing.
#[test]
fn few_lobes_hold_most_of_real_light() {
    let Some(folder) = assets::folder() else { return };
    for name in ["royal_esplanade_256.hdr", "studio.hdr", "sunset.hdr"] {
        let bytes = std::fs::read(folder.join("env").join(name)).expect("map");
        let picture = scene::environment(&bytes, name).expect("decoded");
        let (width, height) = (picture.width, picture.height);
        let map = EnvironmentMap { width, height, texels: &picture.texels };
        let (light, _) = map.project(Order::new(4).expect("order")).expect("projected");
        let fit = ZonalLight::fit(&light, 8);
        let residuals = fit.residuals();
        let last = residuals.last().expect("a residual");
        assert!(residuals[2] < 0.1 && *last < 1e-3, "{name}: {residuals:?}");
    }
}

/// The command prints one JSON object with the light in every convention.
#[test]
fn the_command_prints_every_convention() {
    let Some(folder) = assets::folder() else { return };
    let mut command = Command::new(env!("CARGO_BIN_EXE_poselight"));
    command.arg("light").arg(folder.join("env/royal_esplanade_256.hdr"));
    command.args(["--order", "4", "--window", "hann", "--json"]);
    let output = command.output().expect("started");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let json: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    let colours = |name: &str| json[name]["coefficients"].as_array().map_or(0, Vec::len);
    assert_eq!([colours("poselight"), colours("three_js"), colours("filament")], [16, 9, 9]);
    assert_eq!(json["d3dx"]["green"].as_array().map(Vec::len), Some(16));
    assert_eq!((&json["map"]["width"], &json["window"]["kind"]), (&256.into(), &"hann".into()));
    let first = |name: &str| json[name]["coefficients"][0][0].as_f64().expect("a number");
    let mean = json["map"]["mean_radiance"][0].as_f64().expect("a number");
    assert!((first("filament") / mean - 1.0).abs() < 1e-9);
    assert_eq!(first("three_js"), first("poselight"));
}
