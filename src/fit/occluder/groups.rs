//! Which spheres a point sums up together, at the finest.
//!
//! The spheres of every bone are a group, as long as there are few enough bones. Else the bones fall into chains: limbs, and fingers, that part where the skeleton branches. A point sees the
//! spheres of its own bone, of the bone above and of the bones below as groups of their own, and
//! the rest by chains.

/// Groups of a point's own surroundings: its bone, the one above, those below.
const NEAR: usize = 3;
/// Groups, at most.
const MOST: usize = 64;

/// `[bone, sphere]` and the number of groups, before any are merged.
pub(super) fn finest(parents: &[Option<usize>], bone_of_sphere: &[usize]) -> (Vec<u8>, usize) {
    let mut bones = bone_of_sphere.to_vec();
    bones.sort_unstable();
    bones.dedup();
    if bones.len() > MOST {
        return table(parents, bone_of_sphere);
    }
    let row = bone_of_sphere.iter().map(|&bone| bones.partition_point(|&b| b < bone) as u8);
    let row: Vec<u8> = row.collect();
    (row.repeat(parents.len()), bones.len())
}

/// `[bone, sphere]` and the number of groups.
fn table(parents: &[Option<usize>], bone_of_sphere: &[usize]) -> (Vec<u8>, usize) {
    let chains = chains(parents);
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
    // Chains beyond the last share its group.
    (all.iter().map(|&group| group.min(MOST - 1) as u8).collect(), count.min(MOST))
}

/// Bone → chain, numbered without gaps in the order of the bones.
fn chains(parents: &[Option<usize>]) -> Vec<usize> {
    let below = |parent: usize| parents.iter().filter(|&&p| p == Some(parent)).count();
    let (mut chain, mut next) = (vec![0; parents.len()], 0);
    // Bones come after the one above them, as nodes do.
    for bone in 0..parents.len() {
        chain[bone] = match parents[bone] {
            Some(parent) if below(parent) == 1 => chain[parent],
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

    /// A trunk with two arms, one of which ends in two fingers: near bones are told apart, the far
    /// arm is one group whatever the bone in it, and a finger is one, too.
    #[test]
    fn limbs_are_chains_and_neighbours_are_near() {
        // 0 trunk; 1-2 left arm, 3 and 4 its fingers; 5-6 right arm.
        let parents = [None, Some(0), Some(1), Some(2), Some(2), Some(0), Some(5)];
        let spheres = [0, 1, 2, 3, 4, 5, 6, 6];
        let (table, groups) = table(&parents, &spheres);
        let group = |bone: usize, sphere: usize| table[bone * spheres.len() + sphere];
        assert_eq!([group(2, 2), group(2, 1), group(2, 3), group(2, 4)], [0, 1, 2, 2]);
        assert_eq!([group(2, 5), group(2, 5)], [group(2, 6), group(2, 7)]);
        assert_ne!(group(2, 5), group(2, 0));
        assert_ne!(group(6, 3), group(6, 4));
        assert_eq!(group(6, 1), group(6, 2));
        assert_eq!(groups, NEAR + 5);
    }

    /// One bone, or none at all, still has a table.
    #[test]
    fn the_smallest_skeletons() {
        assert_eq!(table(&[None], &[0, 0]), (vec![0, 0], 1));
        assert_eq!(table(&[], &[]), (Vec::new(), 0));
        assert_eq!(finest(&[None], &[0, 0]), (vec![0, 0], 1));
        assert_eq!(finest(&[], &[]), (Vec::new(), 0));
    }

    /// Every bone that has spheres is a group, seen alike from everywhere; too many bones are
    /// chains.
    #[test]
    fn bones_are_groups_while_they_are_few() {
        assert_eq!(finest(&[None, Some(0), Some(1)], &[0, 2, 2]), ([0, 1, 1].repeat(3), 2));
        let star: Vec<Option<usize>> = (0..200).map(|i| (i > 0).then_some(0)).collect();
        let (table, groups) = finest(&star, &(0..200).collect::<Vec<_>>());
        assert_eq!((table.len(), groups), (200 * 200, MOST));
        assert!(table.iter().all(|&group| usize::from(group) < groups));
    }
}
