//! Limited-memory BFGS: minimises a smooth function from its gradients (Nocedal and Wright,
//! *Numerical Optimization*, algorithms 7.4 and 7.5).

/// Pairs of steps and gradient changes that are remembered.
const MEMORY: usize = 12;

/// Armijo's fraction of the decrease that the gradient promises.
const DECREASE: f64 = 1e-4;

/// Halvings of a step before the search gives up.
const HALVINGS: usize = 40;

/// What a minimisation ends with.
#[derive(Debug, Clone, PartialEq)]
pub struct Minimum {
    /// The best point found.
    pub x: Vec<f64>,
    /// The function there; never above the start's.
    pub value: f64,
    /// Steps taken.
    pub steps: usize,
}

/// Minimises `f`, which gives its value and writes its gradient, from `start` in at most `budget`
/// steps. It stops where the gradient is 1e-10, or that part of a first one below 1 (a bad start has
/// a large one, which says nothing of the minimum), or where no step along it lowers the value.
pub fn minimise(
    start: Vec<f64>,
    budget: usize,
    mut f: impl FnMut(&[f64], &mut [f64]) -> f64,
) -> Minimum {
    let n = start.len();
    let mut x = start;
    let mut gradient = vec![0.0; n];
    let mut value = f(&x, &mut gradient);
    let small = 1e-20 * dot(&gradient, &gradient).min(1.0);
    let mut history: Vec<(Vec<f64>, Vec<f64>, f64)> = Vec::new();
    let (mut trial, mut trial_gradient) = (vec![0.0; n], vec![0.0; n]);
    let mut steps = 0;
    while steps < budget && dot(&gradient, &gradient) > small {
        let mut direction = two_loops(&history, &gradient);
        let mut slope = dot(&direction, &gradient);
        if slope >= 0.0 {
            history.clear();
            direction = gradient.iter().map(|g| -g).collect();
            slope = dot(&direction, &gradient);
        }
        // Without curvature yet, a step of the length of one unit is a guess that can be halved.
        let mut step = if history.is_empty() { 1.0 / slope.abs().sqrt().max(1.0) } else { 1.0 };
        let mut found = None;
        for _ in 0..HALVINGS {
            for ((t, x), d) in trial.iter_mut().zip(&x).zip(&direction) {
                *t = x + step * d;
            }
            let at = f(&trial, &mut trial_gradient);
            if at <= value + DECREASE * step * slope {
                found = Some(at);
                break;
            }
            step *= 0.5;
        }
        let Some(at) = found else {
            if history.is_empty() {
                break;
            }
            history.clear();
            continue;
        };
        let moved: Vec<f64> = trial.iter().zip(&x).map(|(t, x)| t - x).collect();
        let change: Vec<f64> = trial_gradient.iter().zip(&gradient).map(|(t, g)| t - g).collect();
        let curvature = dot(&moved, &change);
        if curvature > 1e-12 * dot(&change, &change).sqrt() * dot(&moved, &moved).sqrt() {
            if history.len() == MEMORY {
                history.remove(0);
            }
            history.push((moved, change, curvature));
        }
        std::mem::swap(&mut x, &mut trial);
        std::mem::swap(&mut gradient, &mut trial_gradient);
        value = at;
        steps += 1;
    }
    Minimum { x, value, steps }
}

/// −H·g with the remembered approximation H of the inverse Hessian.
fn two_loops(history: &[(Vec<f64>, Vec<f64>, f64)], gradient: &[f64]) -> Vec<f64> {
    let mut q: Vec<f64> = gradient.iter().map(|g| -g).collect();
    let mut shares = vec![0.0; history.len()];
    for ((moved, change, curvature), share) in history.iter().zip(&mut shares).rev() {
        *share = dot(moved, &q) / curvature;
        q.iter_mut().zip(change).for_each(|(q, y)| *q -= *share * y);
    }
    if let Some((_, change, curvature)) = history.last() {
        let scale = curvature / dot(change, change);
        q.iter_mut().for_each(|q| *q *= scale);
    }
    for ((moved, change, curvature), share) in history.iter().zip(&shares) {
        let back = dot(change, &q) / curvature;
        q.iter_mut().zip(moved).for_each(|(q, s)| *q += (share - back) * s);
    }
    q
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rosenbrock(x: &[f64], gradient: &mut [f64]) -> f64 {
        let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
        gradient[0] = -2.0 * a - 400.0 * x[0] * b;
        gradient[1] = 200.0 * b;
        a * a + 100.0 * b * b
    }

    /// The curved valley that gradient descent crawls along is left behind in few steps, also from
    /// a bad start.
    #[test]
    fn rosenbrock_is_solved() {
        for start in [vec![-1.2, 1.0], vec![30.0, -50.0]] {
            let minimum = minimise(start, 300, rosenbrock);
            assert!(
                (minimum.x[0] - 1.0).abs() < 1e-6 && (minimum.x[1] - 1.0).abs() < 1e-6,
                "{minimum:?}"
            );
        }
    }

    /// The value never rises, whatever the budget; 0 steps give the start, one step is better.
    #[test]
    fn any_budget_is_an_improvement() {
        let start = vec![-1.2, 1.0];
        let mut last = f64::INFINITY;
        for budget in [0, 1, 2, 5, 10, 20] {
            let minimum = minimise(start.clone(), budget, rosenbrock);
            assert!(minimum.value <= last && minimum.steps <= budget, "{budget}: {minimum:?}");
            last = minimum.value;
        }
        assert_eq!(minimise(start.clone(), 0, rosenbrock).x, start);
    }

    /// A function that is infinite or NaN beyond a wall is minimised within it.
    #[test]
    fn walls_are_respected() {
        let minimum = minimise(vec![0.5], 100, |x, g| {
            g[0] = 1.0 - 1.0 / x[0];
            if x[0] > 0.0 { x[0] - x[0].ln() } else { f64::NAN }
        });
        assert!((minimum.x[0] - 1.0).abs() < 1e-6, "{minimum:?}");
    }
}
