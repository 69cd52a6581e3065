//! What a bake has cast, and how noisy it still is.

use super::Error;
use crate::dataset::Dataset;

/// Poses that are looked at, at most: a data set may be far larger than is worth reading for it.
const MOST_POSES: usize = 64;

/// Means over points and some poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spent {
    /// Poses that were looked at, evenly spread over those that are baked.
    pub poses: usize,
    /// Rays of a point, pilots and all rounds included.
    pub rays_per_point: f64,
    /// The root mean square of the standard error of a coefficient.
    pub noise: f64,
}

/// Reads what is stored of rays and noise; nothing where no pose is baked yet.
///
/// # Errors
/// Blocks that cannot be read.
pub fn spent(dataset: &Dataset) -> Result<Option<Spent>, Error> {
    let layout = &dataset.header().layout;
    let missing = dataset.missing_blocks();
    let baked: Vec<usize> = (0..layout.blocks())
        .filter(|block| !missing.contains(block))
        .flat_map(|block| layout.poses_of(block))
        .collect();
    let poses = baked.len().min(MOST_POSES);
    if poses == 0 || layout.points == 0 {
        return Ok(None);
    }
    let (mut rays, mut noise) = (vec![0; layout.points], vec![0.0; layout.points]);
    let (mut sum, mut squares) = (0.0, 0.0);
    for step in 0..poses {
        let pose = baked[step * baked.len() / poses];
        dataset.read_rays(pose, &mut rays)?;
        dataset.read_noise(&[pose], 0..layout.points, &mut noise)?;
        sum += rays.iter().map(|&rays| f64::from(rays)).sum::<f64>();
        squares += noise.iter().map(|&noise| f64::from(noise).powi(2)).sum::<f64>();
    }
    let count = (poses * layout.points) as f64;
    Ok(Some(Spent { poses, rays_per_point: sum / count, noise: (squares / count).sqrt() }))
}
