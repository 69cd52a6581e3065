//! Gauss–Legendre quadrature, which makes every table of this module exact: products of
//! harmonics are polynomials.

/// Nodes and weights on [-1, 1] that integrate polynomials of degree 2·`count`−1 exactly.
///
/// Newton's method on the Legendre recurrence, to f64 round-off; nodes ascend.
///
/// # Panics
/// If `count` is zero.
#[must_use]
pub fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    assert!(count > 0, "a quadrature needs a node");
    let n = count as f64;
    (0..count)
        .map(|i| {
            // Tricomi's estimate is good enough that Newton converges to the i-th root.
            let mut x = -(std::f64::consts::PI * (i as f64 + 0.75) / (n + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..8 {
                let (value, derivative) = legendre(count, x);
                slope = derivative;
                x -= value / derivative;
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// P_n(x) and its derivative, for |x| < 1.
fn legendre(n: usize, x: f64) -> (f64, f64) {
    let (mut previous, mut current) = (1.0, x);
    for k in 2..=n {
        let k = k as f64;
        let next = ((2.0 * k - 1.0) * x * current - (k - 1.0) * previous) / k;
        (previous, current) = (current, next);
    }
    (current, n as f64 * (x * current - previous) / (x * x - 1.0))
}

/// Directions and weights that integrate polynomials of degree 2·`count`−1 over the part of the
/// sphere with z in `[low, high]`.
pub(super) fn zone(count: usize, low: f64, high: f64) -> Vec<([f64; 3], f64)> {
    let turns = 2 * count;
    let (half, middle) = ((high - low) / 2.0, f64::midpoint(high, low));
    let mut nodes = Vec::with_capacity(count * turns);
    for (x, weight) in gauss_legendre(count) {
        let z = middle + half * x;
        let radius = (1.0 - z * z).max(0.0).sqrt();
        for k in 0..turns {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / turns as f64).sin_cos();
            let solid_angle = weight * half * std::f64::consts::TAU / turns as f64;
            nodes.push(([radius * cos, radius * sin, z], solid_angle));
        }
    }
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Monomials up to the promised degree integrate to 2/(k+1) (even k) or 0 (odd k).
    #[test]
    fn gauss_legendre_is_exact_for_polynomials() {
        for count in 1..=24 {
            let nodes = gauss_legendre(count);
            for k in 0..2 * count {
                let sum: f64 = nodes.iter().map(|(x, w)| w * x.powi(k as i32)).sum();
                let exact = if k % 2 == 0 { 2.0 / (k as f64 + 1.0) } else { 0.0 };
                assert!((sum - exact).abs() < 1e-13, "count {count}, degree {k}: {sum} {exact}");
            }
        }
    }

    /// The weights of a zone add up to its area 2π(high − low).
    #[test]
    fn zone_weights_are_its_area() {
        let area: f64 = zone(10, 0.25, 1.0).iter().map(|(_, w)| w).sum();
        assert!((area - std::f64::consts::TAU * 0.75).abs() < 1e-13);
    }
}
