//! `poselight brdf`: a reflectance as an operator that a frame can run.

use anyhow::{Context, bail, ensure};
use serde_json::json;

use crate::cli::Answer;
use crate::cli::light_args::BrdfArgs;
use crate::cli::units;
use crate::pipeline::files;
use crate::sh::Order;
use crate::shade::{Brdf, Examination, Factored, Merl, Reflectance, Reflector, examine, factor};

/// A MERL file has 35 MB.
const MOST_BYTES: u64 = 64 << 20;

/// Elevations of the integrals, where only the difference of azimuths counts and where not.
const NODES: [usize; 2] = [96, 32];

/// Elevations by which energy is examined.
const EXAMINED_NODES: usize = 48;

/// A reflectance from words or from a file.
enum Source {
    Analytic(Brdf),
    Measured(Box<Merl>),
}

impl Reflectance for Source {
    fn reflect(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Analytic(brdf) => brdf.reflect(incoming, outgoing),
            Self::Measured(merl) => merl.reflect(incoming, outgoing),
        }
    }

    fn is_isotropic(&self) -> bool {
        match self {
            Self::Analytic(brdf) => brdf.is_isotropic(),
            Self::Measured(merl) => merl.is_isotropic(),
        }
    }
}

pub(in crate::cli) fn brdf(args: &BrdfArgs) -> anyhow::Result<Answer> {
    let order = Order::new(args.order)?;
    let source = read(&args.source)?;
    let found = examine(&source, EXAMINED_NODES);
    let mut notices = found.warnings();
    if let Source::Measured(merl) = &source
        && merl.missing() > 0
    {
        notices.push(format!("{} cells of the table hold no measurement", merl.missing()));
    }
    for notice in &notices {
        tracing::warn!("{notice}");
    }
    let nodes = NODES[usize::from(!source.is_isotropic())];
    let factored = factor(&source, order, nodes)?;
    let most = factored[0].most_terms();
    ensure!(
        (1..=most).contains(&args.terms),
        "--terms is {}; order {} has 1 to {most}",
        args.terms,
        args.order
    );
    let operators = factored.each_ref().map(|colour| colour.operator(args.terms));
    let errors = factored.each_ref().map(|colour| colour.error(args.terms));
    let reflector = Reflector::new(&args.source, &operators, errors);
    let bytes = reflector.to_bytes()?;
    files::publish(&args.output, &bytes)?;
    let curve = if args.curve { curve(&source, nodes)? } else { Vec::new() };
    Ok(answer(args, &reflector, (&found, curve), &notices))
}

fn answer(
    args: &BrdfArgs,
    reflector: &Reflector,
    (found, curve): (&Examination, Vec<serde_json::Value>),
    notices: &[String],
) -> Answer {
    let header = reflector.header();
    let worst = header.errors.iter().copied().fold(0.0, f64::max);
    let mut text = format!(
        "{}: {} terms of order {}, {}, {} of coefficients; the factored reflectance is off by {:.1} % (L², worst colour)",
        args.output.display(),
        header.terms,
        header.order,
        if header.channels == 1 { "one colour" } else { "three colours" },
        units::bytes(reflector.bytes() as u64),
        100.0 * worst
    );
    for row in &curve {
        text = format!("{text}\n{row}");
    }
    let json = json!({
        "output": args.output,
        "source": args.source,
        "order": header.order,
        "terms": header.terms,
        "channels": header.channels,
        "bytes": reflector.bytes(),
        "relative_error": header.errors,
        "largest_albedo": found.largest_albedo,
        "reciprocity_error": found.reciprocity_error,
        "curve": curve,
        "notices": notices,
    });
    Answer::new(text, json)
}

/// The error of every number of terms, for every order; of the worst colour.
fn curve(source: &Source, nodes: usize) -> anyhow::Result<Vec<serde_json::Value>> {
    (1..=10)
        .map(|bands| {
            let factored = factor(source, Order::new(bands)?, nodes)?;
            let most = factored[0].most_terms().min(16);
            let worst =
                |k: usize| factored.iter().map(|f: &Factored| f.error(k)).fold(0.0, f64::max);
            let errors: Vec<f64> = (1..=most).map(worst).collect();
            Ok(json!({ "order": bands, "relative_error_by_terms": errors }))
        })
        .collect()
}

/// Reads `lambert:ALBEDO`, `phong:DIFFUSE,SPECULAR,EXPONENT`, `ggx:F0,ALPHA` or with a second alpha
/// along the bitangent, `ashikhmin-shirley:DIFFUSE,SPECULAR,NU,NV`, or a MERL file of that name.
fn read(source: &str) -> anyhow::Result<Source> {
    let Some((name, numbers)) = source.split_once(':') else { return measured(source) };
    if !["lambert", "phong", "ggx", "ashikhmin-shirley"].contains(&name) {
        return measured(source);
    }
    let numbers: Vec<f64> = numbers
        .split(',')
        .map(|part| part.trim().parse().with_context(|| format!("`{part}` in `{source}`")))
        .collect::<anyhow::Result<_>>()?;
    let brdf = match (name, numbers.as_slice()) {
        ("lambert", &[albedo]) => Brdf::Lambert { albedo: [albedo; 3] },
        ("lambert", &[r, g, b]) => Brdf::Lambert { albedo: [r, g, b] },
        ("phong", &[diffuse, specular, exponent]) => {
            Brdf::Phong { diffuse: [diffuse; 3], specular: [specular; 3], exponent }
        }
        ("ggx", &[f0, alpha]) => Brdf::Ggx { normal_reflectance: [f0; 3], alpha: [alpha; 2] },
        ("ggx", &[f0, along, across]) => {
            Brdf::Ggx { normal_reflectance: [f0; 3], alpha: [along, across] }
        }
        ("ashikhmin-shirley", &[diffuse, specular, nu, nv]) => Brdf::AshikhminShirley {
            diffuse: [diffuse; 3],
            specular: [specular; 3],
            exponents: [nu, nv],
        },
        _ => bail!(
            "`{source}` has {} numbers; it is lambert:ALBEDO, phong:DIFFUSE,SPECULAR,EXPONENT, \
             ggx:F0,ALPHA or ggx:F0,ALPHA,ALPHA, or ashikhmin-shirley:DIFFUSE,SPECULAR,NU,NV",
            numbers.len()
        ),
    };
    Ok(Source::Analytic(brdf.checked()?))
}

/// A reflectance in closed form.
pub(super) fn read_analytic(source: &str) -> anyhow::Result<Brdf> {
    match read(source)? {
        Source::Analytic(brdf) => Ok(brdf),
        Source::Measured(_) => bail!("`{source}` is measured; a still takes closed forms"),
    }
}

fn measured(path: &str) -> anyhow::Result<Source> {
    let bytes = files::read(path.as_ref(), MOST_BYTES)?;
    let merl = Merl::from_bytes(&bytes).with_context(|| path.to_owned())?;
    Ok(Source::Measured(Box::new(merl)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every closed form is read; wrong counts, wrong numbers and missing files are told apart.
    #[test]
    fn reflectances_are_read() {
        for source in [
            "lambert:0.5",
            "lambert:0.1,0.2,0.3",
            "phong:0.4,0.4,12",
            "ggx:0.04,0.3",
            "ggx:0.9,0.2,0.5",
        ] {
            assert!(matches!(read(source), Ok(Source::Analytic(_))), "{source}");
        }
        assert!(read("ashikhmin-shirley:0.3,0.2,10,100").is_ok_and(|s| !s.is_isotropic()));
        for (source, word) in [
            ("lambert:0.5,0.5", "2 numbers"),
            ("lambert:x", "`x`"),
            ("lambert:1.5", "albedo"),
            ("ggx:0.5,0", "alpha"),
            ("nickel.binary", "nickel.binary"),
            ("disney:1", "disney:1"),
        ] {
            let error = read(source).err().map(|error| format!("{error:#}")).unwrap_or_default();
            assert!(error.contains(word), "{source}: {error}");
        }
    }
}
