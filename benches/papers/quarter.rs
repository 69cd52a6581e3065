//! P(8,22)'s error in a quarter of its bytes, by precision and rank.

use poselight::pipeline::recipe::OnName;

use crate::settings::{Bakes, Page, Result, candidate, measured, point, rms, unseen};

/// Output dimensions that are tried.
const OUTPUTS: [u32; 8] = [22, 21, 20, 18, 15, 11, 8, 5];

pub(crate) fn table(bakes: &Bakes, page: &mut Page) -> Result<()> {
    let dataset = &bakes.transfer;
    let candidates: Result<Vec<_>> = OUTPUTS
        .iter()
        .map(|&outputs| {
            candidate(dataset, format!("P(8,{outputs})"), OnName::Novel, |fit| {
                (fit.inputs, fit.outputs) = (Some(8), Some(outputs));
            })
        })
        .collect();
    let found = measured(dataset, &candidates?)?;
    page.head(
        "P(8,22) in a quarter of its bytes",
        "Transfer; bytes of tensors with their scales and of the whole blob, over P(8,22) in f32; errors \
         over its errors. The smallest of each precision that is within a hundredth of its error on \
         every split, and the best within a quarter of the tensors' bytes.",
    );
    let Some(full) = point(&found, "P(8,22)", "f32") else { return Ok(()) };
    page.header(&["model", "tensors", "blob", "training", "interpolated", "unseen"]);
    let splits = ["training", "interpolated", unseen(&found)];
    for outputs in OUTPUTS {
        for precision in ["f32", "f16", "i8"] {
            let Some(p) = point(&found, &format!("P(8,{outputs})"), precision) else { continue };
            let mut cells = vec![
                format!("P(8,{outputs}) {precision}"),
                format!("{:.3}", p.tensor_bytes as f64 / full.tensor_bytes as f64),
                format!("{:.3}", p.bytes as f64 / full.bytes as f64),
            ];
            cells.extend(splits.map(|split| format!("{:.4}", rms(p, split) / rms(full, split))));
            page.row(&cells);
        }
    }
    Ok(())
}
