//! Sizes and times, beside published ones.

use super::input::ReportInput;
use super::spectrum;
use super::text::{count, escape, many, number, percent, time};
use crate::measure::{Kind, Measured, Signal};

/// What the published columns are.
const SOURCES: [&str; 3] = ["PRT07 P(8,22)", "PRT07 P(15,500)", "PRT07 linear"];

/// A row: what, ours, and the three published values; `same` where one value covers all three.
fn row(what: &str, ours: &str, published: [&str; 3]) -> String {
    let cells = if published[0] == published[1] && published[1] == published[2] {
        format!("<td colspan=\"3\">{}</td>", published[0])
    } else {
        published.iter().map(|p| format!("<td>{p}</td>")).collect()
    };
    format!("<tr><th scope=\"row\">{what}</th><td class=\"ours\">{ours}</td>{cells}</tr>")
}

/// The table against PRT07, whose signal is radiance transfer of order 6.
pub(super) fn beside_prt(input: &ReportInput<'_>) -> String {
    let (character, model, times) = (&input.character, &input.model, &input.times);
    let unknown = || "–".to_owned();
    let phases = |pca: bool| {
        let picked: Vec<f64> =
            times.fit.iter().filter(|p| p.pca == pca).map(|p| p.seconds).collect();
        if picked.is_empty() { unknown() } else { time(picked.iter().sum()) }
    };
    let per_pose = times.bake_s.filter(|_| times.bake_poses > 0);
    let per_pose = per_pose.map_or_else(unknown, |s| time(s / times.bake_poses as f64));
    let of_mesh = Some(model.tensor_bytes).filter(|_| model.mesh_bytes > 0);
    let of_mesh = of_mesh.map_or_else(unknown, |b| percent(b as f64 / model.mesh_bytes as f64));
    let rate = model.evaluate_us.filter(|&us| us > 0.0);
    let rate = rate.map_or_else(unknown, |us| format!("{}\u{a0}Hz", number(1e6 / us, 3)));
    let dimensions = |summary: spectrum::Summary| {
        let [a, b, c] = summary.dimensions.map(|d| d.map_or_else(unknown, |d| d.to_string()));
        format!("{a} / {b} / {c}")
    };
    let pose = dimensions(spectrum::summary(&input.pose_spectrum));
    let output = dimensions(spectrum::summary(&input.output_spectrum));
    let operations = format!("{}\u{a0}million", number(3.0 * model.multiply_adds as f64 / 1e6, 3));
    let rows = [
        row("Vertices", &count(character.vertices as u64), ["11,534", "11,534", "11,534"]),
        row(
            "Training poses, pose parameters",
            &format!("{}, {}", count(character.training_poses as u64), model.parameters),
            ["430, 54"; 3],
        ),
        row("Rays per vertex", &count(u64::from(character.rays)), ["500"; 3]),
        row("Bake, per pose", &per_pose, ["&lt; 25\u{a0}s"; 3]),
        row("Fit without PCA", &phases(false), ["73\u{a0}s"; 3]),
        row("PCA", &phases(true), ["324\u{a0}s"; 3]),
        row(
            "Tensors, of one mesh’s coefficients",
            &of_mesh,
            ["62.9\u{a0}%", "1457\u{a0}%", "5400\u{a0}%"],
        ),
        row(
            "Operations per pose, all coefficients",
            &operations,
            ["27.4\u{a0}million", "623\u{a0}million", "67.7\u{a0}million"],
        ),
        row("Evaluations per second", &rate, ["105\u{a0}Hz", "34\u{a0}Hz", "65\u{a0}Hz"]),
        row("Pose dimensions for 90 / 99 / 99.9 %", &pose, ["8 / – / –"; 3]),
        row("Output dimensions for 90 / 99 / 99.9 %", &output, ["22 / 500 / 1000"; 3]),
    ];
    let heads: String = SOURCES.iter().map(|s| format!("<th scope=\"col\">{s}</th>")).collect();
    format!(
        "<div class=\"scroll\" tabindex=\"0\"><table class=\"figures beside\"><thead><tr><th scope=\"col\"></th><th scope=\"col\">This run</th>{heads}</tr></thead><tbody>{}</tbody></table></div>\
         <p class=\"note\">Published figures: Nowrouzezahrai et al. 2007, tables 1 and 2 and §5. <strong>Other hardware, other characters, other motion</strong>: they show the scale of things, not a race. Operations count a multiplication as 2 and an addition as 1, as they did; theirs are for one coefficient, times 36 here. Their rates are of the whole program, ours of the evaluation on one core. Our output dimensions are of the energy with the mean in it, theirs of a PCA.</p>",
        rows.concat()
    )
}

/// Model sizes and errors of the other papers.
pub(super) fn beside_others(input: &ReportInput<'_>) -> String {
    let split = input.measured.headline.and_then(|s| input.measured.split(s));
    let model = split.and_then(|s| s.candidates.iter().find(|c| c.kind == Kind::Model));
    let ours = model.map_or_else(|| "–".to_owned(), |m| number(m.ao.mean_absolute.value, 3));
    let bytes =
        input.model.sizes.first().map_or_else(|| "–".to_owned(), |s| super::text::size(s.1));
    let fit: f64 = input.times.fit.iter().map(|p| p.seconds).sum();
    let fit = if input.times.fit.is_empty() { "–".to_owned() } else { time(fit) };
    let rows = [
        ["This run", &bytes, &ours, &fit],
        ["AO07, 5 clusters × 5 dimensions", "1.0–4.5\u{a0}MB", "0.011", "–"],
        ["AO07, 15 clusters × 15 dimensions", "7.1–34.7\u{a0}MB", "0.005", "–"],
        ["Kontkanen and Aila 2006, as in AO07", "10.4\u{a0}MB", "0.006", "–"],
        ["RPO09 linear (visibility)", "1.4–16.1\u{a0}MB", "–", "8–62\u{a0}min"],
        ["RPO09 quadratic", "1.5–16.9\u{a0}MB", "–", "11–98\u{a0}min"],
        ["RPO09 network", "1.8–17.9\u{a0}MB", "–", "5–32\u{a0}h"],
    ];
    let rows: String = rows
        .iter()
        .map(|[what, bytes, error, fit]| {
            let class = if *what == "This run" { " class=\"ours\"" } else { "" };
            format!("<tr{class}><th scope=\"row\">{what}</th><td>{bytes}</td><td>{error}</td><td>{fit}</td></tr>")
        })
        .collect();
    format!(
        "<div class=\"scroll\" tabindex=\"0\"><table class=\"figures beside\"><thead><tr><th scope=\"col\"></th><th scope=\"col\">Model</th><th scope=\"col\">AO mean |e|</th><th scope=\"col\">Fit</th></tr></thead><tbody>{rows}</tbody></table></div>\
         <p class=\"note\">AO07: Kirk and Arikan 2007, table 1, over 4130 frames; it does not say which of them its models had been fitted to. RPO09: Nowrouzezahrai et al. 2009, table 1. {}</p>",
        ao_note(input.measured)
    )
}

fn ao_note(measured: &Measured) -> &'static str {
    match measured.signal {
        Signal::Ao => "Other hardware, other characters.",
        Signal::Transfer | Signal::Visibility => {
            "Other hardware, other characters; our ambient occlusion is one number derived from a \
             model of all coefficients."
        }
    }
}

/// Where the time of this run went.
pub(super) fn spent(input: &ReportInput<'_>) -> String {
    let times = &input.times;
    let mut rows: Vec<(String, f64, String)> = Vec::new();
    if let Some(s) = times.bake_s {
        let more =
            format!("{} rays, {} rays/s", many(times.bake_rays), per_second(times.bake_rays, s));
        rows.push(("Bake".to_owned(), s, more));
    }
    if let Some(s) = times.reference_s {
        rows.push(("Reference bakes".to_owned(), s, "for measuring only".to_owned()));
    }
    rows.extend(
        times.fit.iter().map(|p| (format!("Fit: {}", escape(&p.name)), p.seconds, String::new())),
    );
    if rows.is_empty() {
        return String::new();
    }
    let most = rows.iter().map(|r| r.1).fold(1e-12, f64::max);
    let rows: String = rows
        .iter()
        .map(|(what, seconds, more)| {
            format!(
                "<tr><th scope=\"row\">{what}</th><td><div class=\"bar model\"><i style=\"width:{:.1}%\"></i><span>{} <small>{more}</small></span></div></td></tr>",
                50.0 * seconds / most,
                time(*seconds),
            )
        })
        .collect();
    format!("<table class=\"lights\"><tbody>{rows}</tbody></table>")
}

/// A rate in words.
pub(super) fn per_second(n: u64, seconds: f64) -> String {
    if seconds > 0.0 { many((n as f64 / seconds) as u64) } else { "–".to_owned() }
}
