//! What the page says in words and lists: the worst places, the character, what was left out, the
//! method, the recipe.

use super::body;
use super::input::ReportInput;
use super::text::{count, escape, many, number, plural, time};
use crate::measure::{BlockMethod, Kind, Measured, Place, Signal, Worst};

/// The picture of the surface, and the worst pose, vertex and sample by name.
pub(super) fn worst(input: &ReportInput<'_>) -> String {
    let measured = input.measured;
    let surface = measured.surface.as_ref().zip(input.rest);
    let picture = surface.and_then(|(surface, rest)| body::figure(surface, &rest));
    let split = measured.headline.and_then(|s| measured.split(s));
    let model = split.and_then(|s| s.candidates.iter().find(|c| c.kind == Kind::Model));
    let worst = model.and_then(|m| m.worst.as_ref()).map(worst_list);
    picture.unwrap_or_default() + &worst.unwrap_or_default()
}

fn worst_list(worst: &Worst) -> String {
    let clip = |name: &str, time_s: f64, pose: usize| match name {
        "" => format!("pose {pose}"),
        name => format!("{} at {time_s:.2}\u{a0}s (pose {pose})", escape(name)),
    };
    format!(
        "<dl><dt>Worst pose</dt><dd>{}: mean |error| {}</dd><dt>Worst vertex</dt><dd>{}: mean |error| {}</dd><dt>Worst of all</dt><dd>{} in {}: {} by {}</dd></dl>",
        clip(&worst.pose.clip, worst.pose.time_s, worst.pose.pose),
        number(worst.pose.ao_mae, 3),
        place(&worst.vertex.place),
        number(worst.vertex.ao_mae, 3),
        place(&worst.sample.place),
        clip(&worst.sample.clip, worst.sample.time_s, worst.sample.pose),
        if worst.sample.ao_error > 0.0 { "too bright" } else { "too dark" },
        number(worst.sample.ao_error.abs(), 3),
    )
}

fn place(place: &Place) -> String {
    match place.part.as_str() {
        "" => format!("vertex {}", count(u64::from(place.vertex))),
        part => format!(
            "vertex {} of {} ({} in the mesh)",
            count(u64::from(place.vertex_in_part)),
            escape(part),
            count(u64::from(place.vertex))
        ),
    }
}

/// Terms and their values as a list.
fn list(entries: &[(&str, String)]) -> String {
    let entries: String = entries
        .iter()
        .filter(|e| !e.1.is_empty())
        .map(|(term, value)| format!("<dt>{term}</dt><dd>{value}</dd>"))
        .collect();
    format!("<dl>{entries}</dl>")
}

/// Key numbers and the table of clips.
pub(super) fn character(input: &ReportInput<'_>) -> String {
    let c = &input.character;
    let points = input.measured.points;
    let vertices = if points == c.vertices {
        count(c.vertices as u64)
    } else {
        format!(
            "{}, of which {} are told apart and baked",
            count(c.vertices as u64),
            count(points as u64)
        )
    };
    let morphs = if c.morphs > 0 {
        format!(", {}", plural(c.morphs, "morph target"))
    } else {
        String::new()
    };
    let own = input.model.parameters;
    let parameters = match c.parameters {
        all if all == own => own.to_string(),
        all => format!("{own}, of {all} in the data set"),
    };
    let entries = [
        ("Vertices", vertices),
        ("Triangles", count(c.triangles as u64)),
        ("Joints", format!("{}{morphs}", c.joints)),
        ("Pose parameters", parameters),
        ("Size", format!("{}\u{a0}m (diagonal of the rest pose)", number(f64::from(c.size_m), 3))),
        (
            "Training",
            format!(
                "{}, {} rays per point",
                plural(c.training_poses, "pose"),
                count(u64::from(c.rays))
            ),
        ),
        ("Ridge α", input.model.alpha.map_or_else(String::new, |a| number(a, 3))),
    ];
    let rows: String = c
        .clips
        .iter()
        .map(|clip| {
            let splits: Vec<&str> = clip.splits.iter().map(|s| s.name()).collect();
            format!(
                "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td class=\"text\">{}</td></tr>",
                escape(&clip.name),
                time(f64::from(clip.duration_s)),
                count(clip.poses as u64),
                splits.join(", "),
            )
        })
        .collect();
    let table = if rows.is_empty() {
        "<p>The scene holds no animation: one pose was baked, and the model is that pose.</p>"
            .to_owned()
    } else {
        format!(
            "<div class=\"scroll\" tabindex=\"0\"><table class=\"figures\"><thead><tr><th scope=\"col\">Clip</th><th scope=\"col\">Length</th><th scope=\"col\">Poses kept</th><th scope=\"col\" class=\"text\">Used for</th></tr></thead><tbody>{rows}</tbody></table></div>"
        )
    };
    list(&entries) + &table
}

/// Dropped degrees of freedom, near-repeats, notices of the importer.
pub(super) fn left_out(input: &ReportInput<'_>) -> String {
    let left = &input.left_out;
    let names = |heading: String, names: &[String]| {
        if names.is_empty() {
            return String::new();
        }
        let items: String = names.iter().map(|n| format!("<li>{}</li>", escape(n))).collect();
        let open = if names.len() <= 12 { " open=\"open\"" } else { "" };
        format!(
            "<details{open}><summary>{heading}</summary><ul class=\"names\">{items}</ul></details>"
        )
    };
    let mut out = String::new();
    if left.near_repeats > 0 {
        out.push_str(&format!(
            "<p>{} were dropped since they nearly repeat another (within {} in parameter units).</p>",
            plural(left.near_repeats, "pose"),
            left.near_repeat
        ));
    }
    if left.passed_over > 0 {
        let told = plural(left.passed_over, "training pose");
        out.push_str(&format!(
            "<p>{told} were not baked, which saved {} rays: those kept lie farthest apart.</p>",
            many(left.saved_rays)
        ));
    }
    let dropped = plural(left.dropped.len(), "degree");
    let dropped =
        dropped.replace("degrees", "degrees of freedom").replace("degree ", "degree of freedom ");
    out.push_str(&names(
        format!("{dropped} without variance in the training poses"),
        &left.dropped,
    ));
    out.push_str(&names(
        format!("{} of the importer", plural(left.notices.len(), "notice")),
        &left.notices,
    ));
    out
}

/// What the figures mean and how far they go.
pub(super) fn method(input: &ReportInput<'_>) -> String {
    let measured = input.measured;
    let rays = measured
        .reference_rays
        .map_or_else(String::new, |r| format!(", with {} rays per point", count(u64::from(r))));
    let ao = match measured.signal {
        Signal::Ao => "",
        Signal::Transfer => " Ambient occlusion is 2√π times the first coefficient.",
        Signal::Visibility => {
            " Ambient occlusion is the product with the clamped cosine, truncated at the order."
        }
    };
    let lights = if measured.lights.is_empty() {
        ""
    } else {
        " Lights are achromatic, fixed in the character’s root frame and scaled so that the \
         brightest white surface that nothing shades has radiance 1, which is the peak of the PSNR."
    };
    format!(
        "<p>Every pose was baked twice more{rays} that are independent of the training’s and of \
         each other’s. Squared errors are the mean of (m − r₁)(m − r₂), in which the references’ \
         noise cancels; where the truth is near zero such a mean may come out negative. Mean absolute \
         errors and percentiles are taken against (r₁ + r₂)/2 and contain its noise, which is stated \
         beside them: an error below it is not claimed.{ao}{lights}</p><p>{}</p>{}",
        blocks(measured),
        origin(input),
    )
}

/// Who made the page, and on what.
fn origin(input: &ReportInput<'_>) -> String {
    let known = [("Made by ", input.made_by), ("Times were taken on ", input.machine)];
    let known = known.iter().filter(|k| !k.1.is_empty());
    let known: Vec<String> = known.map(|(what, by)| format!("{what}{}.", escape(by))).collect();
    if known.is_empty() {
        String::new()
    } else {
        format!("<p class=\"note\">{}</p>", known.join(" "))
    }
}

fn blocks(measured: &Measured) -> String {
    let Some(split) = measured.headline.and_then(|s| measured.split(s)) else {
        return String::new();
    };
    let method = match split.block_method {
        BlockMethod::Clips => {
            "differences between whole clips, so they speak of other clips like these"
        }
        BlockMethod::Stretches => {
            "differences between stretches of time of the clips measured (fewer than three clips), \
             so they speak of these clips and not of others"
        }
    };
    let pairs = if split.frame_pairs > 0 {
        format!(
            " Flicker is taken over {} of consecutive frames.",
            plural(split.frame_pairs, "pair")
        )
    } else {
        " No consecutive frames were measured, so flicker is not known.".to_owned()
    };
    format!(
        "Standard errors (±, one) are from {}: {method}. Neighbouring frames and vertices are \
         nearly copies and do not count as independent.{pairs}",
        plural(split.blocks, "block"),
    )
}

/// Hashes and the resolved recipe.
pub(super) fn recipe(input: &ReportInput<'_>) -> String {
    let hashes: String = input
        .hashes
        .iter()
        .map(|(name, value)| {
            format!("<dt>{}</dt><dd><code>{}</code></dd>", escape(name), escape(value))
        })
        .collect();
    let hashes = if hashes.is_empty() { hashes } else { format!("<dl>{hashes}</dl>") };
    if input.recipe.is_empty() {
        return hashes;
    }
    let open = if input.recipe.lines().count() <= 40 { " open=\"open\"" } else { "" };
    format!(
        "{hashes}<details{open}><summary>Resolved recipe</summary><pre>{}</pre></details>",
        escape(input.recipe)
    )
}
