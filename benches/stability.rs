//! `cargo bench --bench stability`: the page of the numerical-stability suite, a table for each
//! kind of extreme. `tests/stability.rs` holds the same cases to the same bounds.

#![expect(clippy::print_stdout, reason = "a benchmark's table is its output")]

#[path = "../tests/stability/fixture.rs"]
mod fixture;
#[path = "../tests/stability/occluders.rs"]
mod occluders;
#[path = "../tests/stability/oracle.rs"]
mod oracle;
#[path = "../tests/stability/proxies.rs"]
mod proxies;
#[path = "../tests/stability/stored.rs"]
mod stored;
#[path = "../tests/stability/suite.rs"]
mod suite;
#[path = "../tests/stability/values.rs"]
mod values;

fn main() {
    let areas = suite::areas();
    let count: usize = areas.iter().map(|(_, rows)| rows.len()).sum();
    let broken = areas.iter().flat_map(|(_, rows)| rows).filter(|row| !row.passes()).count();
    println!("# Numerical stability\n");
    println!("{count} cases, {broken} above their bounds; `cargo bench --bench stability`.");
    for (area, rows) in areas {
        println!("\n## {area}\n");
        println!("| case | what | figure | bound | |");
        println!("|---|---|---|---|---|");
        for row in rows {
            let mark = if row.passes() { "" } else { "**above**" };
            let suite::Row { case, what, figure, bound } = row;
            println!("| {case} | {what} | {figure:.2e} | {bound:.1e} | {mark} |");
        }
    }
}
