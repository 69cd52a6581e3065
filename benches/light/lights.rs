//! Lobes of environment maps, and operators of reflectances.

use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

use poselight::scene;
use poselight::shade::{
    Brdf, Colours, EnvironmentMap, Factoring, Material, Reflector, ZonalLight, factor, factor_by,
};

use crate::order;

/// Every map of the asset folder at order 4.
pub(crate) fn lobes() {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/assets");
    let assets = std::env::var_os("POSELIGHT_ASSETS").map_or(PathBuf::from(beside), PathBuf::from);
    let Ok(entries) = std::fs::read_dir(assets.join("env")) else { return };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    println!(
        "\n| map, order 4 | projection | residual of 1 lobe | 2 | 3 | 4 | 5 | 6 | 7 | 8 | fit of 3 | of 8 |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
    for path in paths {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let Ok(picture) = scene::environment(&std::fs::read(&path).unwrap(), &name) else {
            continue;
        };
        let (width, height) = (picture.width, picture.height);
        let map = EnvironmentMap { width, height, texels: &picture.texels };
        let start = Instant::now();
        let (light, _) = map.project(order(4)).unwrap();
        let projection = start.elapsed().as_secs_f64() * 1e3;
        let timed = |lobes| {
            let start = Instant::now();
            let fit = ZonalLight::fit(&light, lobes);
            (fit, start.elapsed().as_secs_f64() * 1e3)
        };
        let ((_, three), (fit, eight)) = (timed(3), timed(8));
        // A fit ends where nothing is left.
        let residual = |k| {
            let left: Option<&f64> = fit.residuals().get(k);
            left.map_or("–".to_owned(), |left| format!("{:.2} %", 100.0 * left))
        };
        let residuals: Vec<String> = (0..8).map(residual).collect();
        println!(
            "| {name} {width} × {height} | {projection:.0} ms | {} | {three:.0} ms | {eight:.0} ms |",
            residuals.join(" | ")
        );
    }
}

pub(crate) fn brdfs() -> Vec<(&'static str, Brdf)> {
    let half = [0.5; 3];
    let ggx = |alpha: [f64; 2]| Brdf::Ggx { normal_reflectance: half, alpha };
    vec![
        ("Lambert", Brdf::Lambert { albedo: half }),
        ("Phong, exponent 10", Brdf::Phong { diffuse: [0.3; 3], specular: half, exponent: 10.0 }),
        ("GGX, α 0.5", ggx([0.5; 2])),
        ("GGX, α 0.2", ggx([0.2; 2])),
        ("GGX, α 0.2 and 0.5", ggx([0.2, 0.5])),
        (
            "Ashikhmin–Shirley, 10 and 100",
            Brdf::AshikhminShirley { diffuse: [0.3; 3], specular: half, exponents: [10.0, 100.0] },
        ),
    ]
}

/// What three colours lose by sharing their light factors.
fn sharing() {
    println!(
        "\n| GGX in three colours, order 4 | terms | red | green | blue | bytes |\n|---|---|---|---|---|---|"
    );
    for alpha in [0.2, 0.5] {
        let gold = Brdf::Ggx { normal_reflectance: [0.9, 0.6, 0.3], alpha: [alpha; 2] };
        for (name, colours) in [("together", Colours::Together), ("apart", Colours::Apart)] {
            let way = Factoring { colours, ..Factoring::default() };
            let factored = factor_by(&gold, order(4), 64, way).unwrap();
            for terms in [4, 8, 12] {
                let operators = factored.each_ref().map(|colour| colour.operator(terms));
                let errors =
                    factored.each_ref().map(|f| format!("{:.2} %", 100.0 * f.error(terms)));
                let bytes = Reflector::new(name, &operators, [0.0; 3]).bytes();
                println!("| α {alpha}, {name} | {terms} | {} | {bytes} |", errors.join(" | "));
            }
        }
    }
}

/// Operators: the time of one, and the errors of the factored reflectance over terms and orders.
pub(crate) fn reflection() {
    println!(
        "\n| operator of 8 terms, order 4 | time | bytes a colour | error | of it detail finer than the bands | of what a light of these bands shows |\n|---|---|---|---|---|---|"
    );
    let percent = |error: f64| format!("{:.1} %", 100.0 * error);
    let nodes = |brdf: &Brdf| Material::from(*brdf).nodes();
    for (name, brdf) in brdfs() {
        let start = Instant::now();
        let factored = factor(&brdf, order(4), nodes(&brdf)).unwrap();
        let operators = factored.each_ref().map(|colour| colour.operator(8));
        let reflector = black_box(Reflector::new(name, &operators, [0.0; 3]));
        let seconds = start.elapsed().as_secs_f64();
        let worst = &factored[0];
        println!(
            "| {name} | {seconds:.2} s | {} | {} | {} | {} |",
            reflector.bytes() / reflector.header().channels,
            percent(worst.error(8)),
            percent(worst.band_limit()),
            percent(worst.lit_error(8))
        );
    }
    sharing();
    println!(
        "\n| error by terms | order | 1 | 2 | 4 | 8 | 16 | all, the bands' own | of what the light shows: 8 | all |\n|---|---|---|---|---|---|---|---|---|---|"
    );
    for (name, brdf) in brdfs() {
        for n in [2, 3, 4, 5, 6, 8] {
            let factored = &factor(&brdf, order(n), nodes(&brdf)).unwrap()[0];
            let by_terms = [1, 2, 4, 8, 16].map(|k| percent(factored.error(k)));
            println!(
                "| {name} | {n} | {} | {} | {} | {} |",
                by_terms.join(" | "),
                percent(factored.band_limit()),
                percent(factored.lit_error(8)),
                percent(factored.lit_error(usize::MAX))
            );
        }
    }
}
