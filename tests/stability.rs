//! Every case of the numerical-stability suite keeps its bound. `cargo bench --bench stability`
//! prints the figures.

#[path = "stability/fixture.rs"]
mod fixture;
#[path = "stability/occluders.rs"]
mod occluders;
#[path = "stability/oracle.rs"]
mod oracle;
#[path = "stability/proxies.rs"]
mod proxies;
#[path = "stability/stored.rs"]
mod stored;
#[path = "stability/suite.rs"]
mod suite;
#[path = "stability/values.rs"]
mod values;

/// Proves that at the extremes of data and sizes single precision stays with f64, what has a known
/// answer gives it, and what makes no sense is refused.
#[test]
fn every_case_keeps_its_bound() {
    let mut broken = Vec::new();
    for (area, rows) in suite::areas() {
        assert!(!rows.is_empty(), "{area}");
        for row in rows.iter().filter(|row| !row.passes()) {
            let suite::Row { case, what, figure, bound } = row;
            broken.push(format!("{area}: {case}: {what}: {figure:.3e} is above {bound:.1e}"));
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}
