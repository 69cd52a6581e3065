//! `cargo bench --bench papers -- [SCENE.glb…] [--fps 4] [--rays 64] [--factor 8] [--poses 10]
//! [--order 4] [--folder DIR] [--output DIR] [--part tables,quarter,studies,frames,equal]`: the published
//! methods on our own characters, laid out as their papers print them, the papers' studies as
//! plots, P(8,22) in a quarter of its bytes, and the automatic choice beside the best published
//! method at equal bytes. Without a scene the bundled character. Ambient occlusion, transfer and
//! visibility are baked once each for every scene, with references for every split.
//!
//! Everything is reduced beside the papers, and the first lines say to what: poses per second, rays,
//! the order of the harmonics, reference poses. `--folder` keeps the bakes; `--output` takes the page
//! and its pictures, else only the page is printed.

#![expect(clippy::print_stdout, reason = "a benchmark prints its tables")]

mod equal;
mod frames;
mod quarter;
mod settings;
mod studies;
mod tables;

use settings::{Bakes, Options, Page, Result};

fn main() -> Result<()> {
    let options = Options::parse()?;
    let temporary = tempfile::tempdir()?;
    let mut page = Page::new(&options);
    for scene in options.scenes(temporary.path())? {
        let folder = options.folder.clone().unwrap_or_else(|| temporary.path().to_path_buf());
        let bakes = Bakes::new(&scene, &options, &folder)?;
        page.scene(&bakes);
        let part = |name: &str| options.parts.iter().any(|part| part == name);
        if part("tables") {
            tables::all(&bakes, &mut page)?;
        }
        if part("quarter") {
            quarter::table(&bakes, &mut page)?;
        }
        if part("studies") {
            studies::all(&bakes, &mut page)?;
        }
        if part("frames") {
            frames::table(&bakes, &mut page)?;
        }
        if part("equal") {
            equal::table(&bakes, &mut page)?;
        }
        page.write(options.output.as_deref())?;
    }
    println!("{}", page.text);
    Ok(())
}
