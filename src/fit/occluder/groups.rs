//! Which spheres a point sums up together.
//!
//! The bones fall into chains: limbs that part where the skeleton branches. A point sees the
//! spheres of its own bone, of the bone above and of the bones below as groups of their own, and
//! the rest by chains.

/// A branch with a smaller share of the spheres than this joins the chain that it leaves, such as
/// a finger the arm.
const LEAST_SHARE: f64 = 0.05;

/// Groups of a point's own surroundings: its bone, the one above, those below.
const NEAR: usize = 3;

/// `[bone, sphere]` and the number of groups.
pub(super) fn table(parents: &[Option<usize>], bone_of_sphere: &[usize]) -> (Vec<u8>, usize) {
    let chains = chains(parents, bone_of_sphere);
    let group = |bone: usize, sphere: usize| {
        let other = bone_of_sphere[sphere];
        if other == bone {
            0
        } else if parents[bone] == Some(other) {
            1
        } else if parents[other] == Some(bone) {
            2
        } else {
            NEAR + chains[other]
        }
    };
    let spheres = 0..bone_of_sphere.len();
    let pairs = (0..parents.len()).flat_map(|bone| spheres.clone().map(move |q| (bone, q)));
    let all: Vec<usize> = pairs.map(|(bone, sphere)| group(bone, sphere)).collect();
    let count = all.iter().max().map_or(0, |most| most + 1);
    // More chains than fit a byte share the last group.
    let most = usize::from(u8::MAX);
    (all.iter().map(|&group| group.min(most) as u8).collect(), count.min(most + 1))
}

/// Bone → chain, numbered without gaps in the order of the bones.
fn chains(parents: &[Option<usize>], bone_of_sphere: &[usize]) -> Vec<usize> {
    let mut below = vec![0.0; parents.len()];
    bone_of_sphere.iter().for_each(|&bone| below[bone] += 1.0);
    let total: f64 = bone_of_sphere.len() as f64;
    // Bones come after the one above them, as nodes do.
    for bone in (0..parents.len()).rev() {
        if let Some(parent) = parents[bone] {
            below[parent] += below[bone];
        }
    }
    let counts = |bone: usize| below[bone] >= LEAST_SHARE * total;
    let branches = |parent: usize| {
        (0..parents.len()).filter(|&b| parents[b] == Some(parent) && counts(b)).count()
    };
    let (mut chain, mut next) = (vec![0; parents.len()], 0);
    for bone in 0..parents.len() {
        chain[bone] = match parents[bone] {
            Some(parent) if !counts(bone) || branches(parent) == 1 => chain[parent],
            _ => {
                next += 1;
                next - 1
            }
        };
    }
    chain
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A trunk with two arms, one of which has a finger that is too small for a chain of its own:
    /// near bones are told apart, the far arm is one group whatever the bone in it.
    #[test]
    fn limbs_are_chains_and_neighbours_are_near() {
        // 0 trunk; 1-2 left arm, 3 its finger; 4-5 right arm.
        let parents = [None, Some(0), Some(1), Some(2), Some(0), Some(4)];
        let spheres: Vec<usize> = [(0, 20), (1, 10), (2, 10), (3, 1), (4, 10), (5, 10)]
            .into_iter()
            .flat_map(|(bone, count)| std::iter::repeat_n(bone, count))
            .collect();
        let (table, groups) = table(&parents, &spheres);
        let group = |bone: usize, other: usize| {
            let sphere = spheres.iter().position(|&b| b == other).unwrap();
            table[bone * spheres.len() + sphere]
        };
        assert_eq!([group(2, 2), group(2, 1), group(2, 3)], [0, 1, 2]);
        assert_eq!(group(2, 4), group(2, 5));
        assert_ne!(group(2, 4), group(2, 0));
        assert_eq!(group(5, 3), group(5, 1));
        assert_eq!(groups, NEAR + 3);
    }

    /// One bone, or none at all, still has a table.
    #[test]
    fn the_smallest_skeletons() {
        assert_eq!(table(&[None], &[0, 0]), (vec![0, 0], 1));
        assert_eq!(table(&[], &[]), (Vec::new(), 0));
    }
}
