//! `poselight brdf`: a reflectance as an operator that a frame can run.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, bail, ensure};
use serde_json::{Value, json};

use crate::cli::Answer;
use crate::cli::light_args::{BrdfArgs, ColoursArg, CosineArg};
use crate::cli::units;
use crate::pipeline::{Finish, files, has_terms};
use crate::sh::Order;
use crate::shade::{
    BRDF_WORDS, Colours, Cosine, Examination, Factored, Factoring, Material, Merl, Reflector,
    brdf_of_words, examine, factor_by,
};

/// A MERL file has 35 MB, the largest operator 121.
const MOST_BYTES: u64 = 128 << 20;

pub(in crate::cli) fn brdf(args: &BrdfArgs) -> anyhow::Result<Answer> {
    let order = Order::new(args.order)?;
    let source = read(&args.source)?;
    let found = examine(&source, source.nodes());
    let mut notices = source.warnings();
    for notice in &notices {
        tracing::warn!("{notice}");
    }
    let way = Factoring {
        cosine: match args.cosine {
            CosineArg::Inside => Cosine::Inside,
            CosineArg::Matrix => Cosine::Matrix,
        },
        colours: match args.colours {
            ColoursArg::Together => Colours::Together,
            ColoursArg::Apart => Colours::Apart,
        },
    };
    let factored = factor_by(&source, order, source.nodes(), way)?;
    let most = factored[0].most_terms();
    ensure!(
        has_terms(order, args.terms),
        "--terms is {}; order {} has 1 to {most}",
        args.terms,
        args.order
    );
    let rank = factored[0].rank();
    if args.terms > rank {
        let told = format!("the reflectance has {rank} terms at this order; the others would be 0");
        tracing::warn!("{told}");
        notices.push(told);
    }
    let operators = factored.each_ref().map(|colour| colour.operator(args.terms));
    let errors = factored.each_ref().map(|colour| colour.error(args.terms));
    let reflector = Reflector::new(&args.source, &operators, errors);
    let bytes = reflector.to_bytes()?;
    files::publish(&args.output, &bytes)?;
    let rows = if args.curve { curve(&source, way)? } else { Vec::new() };
    let worst = Errors::of(&factored, args.terms);
    Ok(answer(args, &reflector, (&found, worst, &rows), &notices))
}

/// How far a factored reflectance is off, the worst colour of each.
#[derive(Clone, Copy)]
struct Errors {
    /// Over all pairs of directions.
    all: f64,
    /// What of it no number of terms mends.
    bands: f64,
    /// Over what a light of these bands shows.
    lit: f64,
}

impl Errors {
    fn of(factored: &[Factored; 3], terms: usize) -> Self {
        let worst = |of: &dyn Fn(&Factored) -> f64| factored.iter().map(of).fold(0.0, f64::max);
        Self {
            all: worst(&|f| f.error(terms)),
            bands: worst(&Factored::band_limit),
            lit: worst(&|f| f.lit_error(terms)),
        }
    }

    /// In a sentence, with what would help where something would.
    fn explained(self, terms: usize, order: u8) -> String {
        let percent = |error: f64| format!("{:.1} %", 100.0 * error);
        // Errors are lengths at right angles: their squares add up.
        let cut = (self.all.powi(2) - self.bands.powi(2)).max(0.0).sqrt();
        let mut told = format!(
            "the factored reflectance is off by {} (L² over all pairs of directions): {} is detail \
             finer than {order} bands hold, {} what {terms} terms leave out (squares add up); of what a \
             light of these bands can show it is off by {}",
            percent(self.all),
            percent(self.bands),
            percent(cut),
            percent(self.lit)
        );
        if cut > self.bands && cut > 0.05 {
            told += "; more --terms would help";
        } else if self.bands > 0.05 {
            told += "; only a higher --order would help, no number of terms";
        }
        told
    }
}

fn answer(
    args: &BrdfArgs,
    reflector: &Reflector,
    (found, worst, curve): (&Examination, Errors, &[CurveRow]),
    notices: &[String],
) -> Answer {
    let header = reflector.header();
    let mut text = format!(
        "{}: {} terms of order {}, {}, {} of coefficients\n{}",
        args.output.display(),
        header.terms,
        header.order,
        if header.channels == 1 { "one colour" } else { "three colours" },
        units::bytes(reflector.bytes() as u64),
        worst.explained(header.terms, header.order)
    );
    for row in curve {
        text = format!("{text}\n{}", row.text());
    }
    let json = json!({
        "output": args.output,
        "source": args.source,
        "order": header.order,
        "terms": header.terms,
        "channels": header.channels,
        "bytes": reflector.bytes(),
        "relative_error": header.errors,
        "band_limit_error": worst.bands,
        "lit_error": worst.lit,
        "largest_albedo": found.largest_albedo,
        "reciprocity_error": found.reciprocity_error,
        "curve": curve.iter().map(CurveRow::json).collect::<Vec<_>>(),
        "notices": notices,
    });
    Answer::new(text, json)
}

/// Errors of every number of terms at one order, the worst colour of each.
struct CurveRow {
    order: u8,
    by_terms: Vec<f64>,
    lit_by_terms: Vec<f64>,
    bands: f64,
}

impl CurveRow {
    fn text(&self) -> String {
        let percent = |error: &f64| format!("{:.1}", 100.0 * error);
        let row: Vec<String> = self.by_terms.iter().map(percent).collect();
        let bands = percent(&self.bands);
        format!("order {:2}: at least {bands} %; by terms {}", self.order, row.join(" "))
    }

    fn json(&self) -> Value {
        json!({
            "order": self.order,
            "relative_error_by_terms": self.by_terms,
            "lit_error_by_terms": self.lit_by_terms,
            "band_limit_error": self.bands,
        })
    }
}

/// The errors of up to 16 terms, for every order.
fn curve(source: &Material, way: Factoring) -> anyhow::Result<Vec<CurveRow>> {
    (1..=10)
        .map(|order| {
            let factored = factor_by(source, Order::new(order)?, source.nodes(), way)?;
            let most = factored[0].most_terms().min(16);
            let errors: Vec<Errors> = (1..=most).map(|k| Errors::of(&factored, k)).collect();
            Ok(CurveRow {
                order,
                by_terms: errors.iter().map(|errors| errors.all).collect(),
                lit_by_terms: errors.iter().map(|errors| errors.lit).collect(),
                bands: errors[0].bands,
            })
        })
        .collect()
}

/// What light is reflected by: a reflectance in words, or the MERL file or the operator of that name.
/// What is to be said against it is logged, and joins the notices.
pub(super) fn finish(source: &str, notices: &mut Vec<String>) -> anyhow::Result<Finish> {
    let finish = match brdf_of_words(source) {
        Some(brdf) => Finish::from(brdf.with_context(|| format!("`{source}`"))?),
        None => Finish::from_bytes(&bytes_of(source)?).with_context(|| source.to_owned())?,
    };
    let told = finish.warnings();
    told.iter().for_each(|notice| tracing::warn!("{source}: {notice}"));
    notices.extend(told);
    Ok(finish)
}

/// A reflectance in words, or a MERL file of that name.
fn read(source: &str) -> anyhow::Result<Material> {
    if let Some(brdf) = brdf_of_words(source) {
        return Ok(Material::Analytic(brdf.with_context(|| format!("`{source}`"))?));
    }
    let merl = Merl::from_bytes(&bytes_of(source)?).with_context(|| source.to_owned())?;
    Ok(Material::Measured(Arc::new(merl)))
}

fn bytes_of(source: &str) -> anyhow::Result<Vec<u8>> {
    if !Path::new(source).exists() {
        bail!("`{source}` is no file, and none of {BRDF_WORDS}");
    }
    Ok(files::read(source.as_ref(), MOST_BYTES)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Words and files are told apart, and each fault is told with its source.
    #[test]
    fn reflectances_are_read() {
        assert!(matches!(read("ggx:0.04,0.3"), Ok(Material::Analytic(_))));
        for (source, word) in [
            ("lambert:0.5,0.5", "`lambert:0.5,0.5`: has 2 numbers"),
            ("nickel.binary", "`nickel.binary` is no file, and none of lambert"),
            ("disney:1", "`disney:1` is no file"),
            ("Cargo.toml", "Cargo.toml"),
        ] {
            let error = read(source).err().map(|error| format!("{error:#}")).unwrap_or_default();
            assert!(error.contains(word), "{source}: {error}");
        }
    }

    /// The parts of an error are told in shares of energy that add up, with what would help.
    #[test]
    fn errors_are_explained() {
        let narrow = Errors { all: 0.65, bands: 0.64, lit: 0.3 };
        let told = narrow.explained(8, 4);
        assert!(
            told.contains("65.0 %") && told.contains("64.0 %") && told.contains("30.0 %"),
            "{told}"
        );
        assert!(told.contains("a higher --order"), "{told}");
        let few = Errors { all: 0.5, bands: 0.1, lit: 0.5 }.explained(1, 4);
        assert!(few.contains("more --terms"), "{few}");
        let exact = Errors { all: 0.01, bands: 0.01, lit: 0.01 }.explained(1, 4);
        assert!(!exact.contains("--"), "{exact}");
    }
}
