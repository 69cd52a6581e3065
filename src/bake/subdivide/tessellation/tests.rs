//! Splits keep surfaces whole and are counted beforehand.

use std::collections::BTreeMap;

use proptest::prelude::*;

use super::*;

/// How many triangles are at each edge, by welds.
fn faces(all: &Tessellation, triangles: &[(usize, Leaf)]) -> BTreeMap<[u32; 2], usize> {
    let mut faces = BTreeMap::new();
    for pair in triangles.iter().flat_map(|(_, leaf)| leaf.sides()).map(|side| all.welded(side)) {
        *faces.entry(pair).or_default() += 1;
    }
    faces
}

/// An octahedron with a seam: the vertex at the top is there twice, for two triangles each.
fn seamed() -> Tessellation {
    let triangles =
        [[0, 2, 3], [0, 3, 4], [6, 4, 5], [6, 5, 2], [1, 3, 2], [1, 4, 3], [1, 5, 4], [1, 2, 5]];
    Tessellation::new(&triangles, vec![0, 1, 2, 3, 4, 5, 0])
}

proptest! {
    /// However a closed surface is split: every edge of the result has its two triangles, the
    /// count is what was foretold, and the parts of each input triangle make up its area.
    #[test]
    fn splitting_keeps_a_closed_surface(choices in prop::collection::vec(0_usize..1000, 0..40)) {
        let mut all = seamed();
        for choice in choices {
            let open: Vec<usize> = all.leaves().collect();
            all.split(open[choice % open.len()]);
        }
        let foretold = (all.count(), all.used());
        let result = all.conforming();
        let used: HashSet<u32> = result.iter().flat_map(|(_, leaf)| leaf.corners).collect();
        prop_assert_eq!((result.len(), used.len()), foretold);
        prop_assert!(faces(&all, &result).values().all(|&count| count == 2));
        let mut areas = [0.0; 8];
        for (_, leaf) in &result {
            areas[leaf.root as usize] += leaf.share();
        }
        prop_assert_eq!(areas, [1.0; 8]);
    }

    /// A vertex between two others lies in their middle, seen from either side of the edge.
    #[test]
    fn vertices_lie_where_they_should(choices in prop::collection::vec(0_usize..1000, 1..30)) {
        let mut all = seamed();
        let corners: [[f32; 3]; 7] = [
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0],
        ];
        let roots: Vec<[u32; 3]> = all.leaves().map(|leaf| all.leaf(leaf).corners).collect();
        for choice in choices {
            let open: Vec<usize> = all.leaves().collect();
            all.split(open[choice % open.len()]);
        }
        let result = all.conforming();
        let mix = |root: u32, at: [f32; 3]| {
            let ends = roots[root as usize].map(|vertex| corners[vertex as usize]);
            [0, 1, 2].map(|axis| (0..3).map(|i| at[i] * ends[i][axis]).sum::<f32>())
        };
        for (_, leaf) in &result {
            for (&vertex, at) in leaf.corners.iter().zip(leaf.at) {
                let here = mix(leaf.root, at);
                let there = match (vertex as usize) < all.given() {
                    true => corners[vertex as usize],
                    false => mix(all.place(vertex).triangle, all.place(vertex).weights),
                };
                prop_assert_eq!(here, there);
            }
        }
    }
}

/// Two layers of one square, with vertices of their own: whatever is split on either, the count
/// holds.
#[test]
fn layers_are_counted() {
    let triangles = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]];
    for order in [[0, 2, 1, 3], [0, 4, 2, 3], [0, 7, 2, 1], [2, 0, 4, 8]] {
        let mut all = Tessellation::new(&triangles, vec![0, 1, 2, 3, 0, 1, 2, 3]);
        for index in order {
            if all.leaves[index].is_some() {
                all.split(index);
            }
        }
        let foretold = (all.count(), all.used());
        let result = all.conforming();
        let used: HashSet<u32> = result.iter().flat_map(|(_, leaf)| leaf.corners).collect();
        assert_eq!((result.len(), used.len()), foretold, "{order:?}");
    }
}

/// Split in the order that the balance asks for, no side of any triangle has more than one vertex
/// within it, however often one corner is refined.
#[test]
fn a_balance_leaves_one_vertex_on_a_side() {
    let mut all = seamed();
    fn ahead(all: &mut Tessellation, index: usize) {
        for coarser in all.coarser(index) {
            if all.is_leaf(coarser) {
                ahead(all, coarser);
            }
        }
        all.split(index);
    }
    for _ in 0..7 {
        // The finest at the top of the octahedron.
        let top = |&index: &usize| all.leaf(index).corners.contains(&0);
        let finest = all.leaves().filter(top).max_by_key(|&index| all.leaf(index).depth);
        ahead(&mut all, finest.unwrap());
    }
    assert!(all.leaves().any(|index| all.leaf(index).depth == 7));
    for index in all.leaves() {
        for side in all.leaf(index).sides() {
            let pair = all.welded(side);
            let halves =
                if all.edges[&pair].split { all.halves(pair).to_vec() } else { Vec::new() };
            assert!(halves.iter().all(|half| !all.edges[half].split), "{side:?} of {index}");
        }
    }
    assert_eq!(all.conforming().len(), all.count());
}

/// Stiff edges and triangles stay whole, and what lies beside them is bisected alone; a triangle that is
/// kept gets no vertex at all, and is not counted with any.
#[test]
fn stiff_and_kept_triangles_stay() {
    let triangles = [[0, 1, 2], [2, 1, 3], [1, 4, 2]];
    let weld = vec![0, 1, 2, 3, 1];
    let mut all = Tessellation::keeping(&triangles, weld, HashSet::from([2]));
    all.split(0);
    let foretold = (all.count(), all.used());
    let result = all.conforming();
    assert_eq!((result.len(), foretold), (4 + 2 + 1, (7, 5 + 3)));
    assert_eq!(result.iter().filter(|(_, leaf)| leaf.root == 2).count(), 1);
    let mut all = Tessellation::new(&triangles[..2], vec![0, 1, 2, 3]);
    all.stiffen(&[[2, 1]], &[]);
    assert!(!all.can_split(&all.leaf(0)) && !all.can_split(&all.leaf(1)));
    let mut all = Tessellation::new(&triangles[..2], vec![0, 1, 2, 3]);
    all.stiffen(&[], &[1]);
    assert!(all.can_split(&all.leaf(0)) && !all.can_split(&all.leaf(1)));
}

/// A triangle whose corners share a place cannot be split, and is bisected with its neighbour.
#[test]
fn a_flat_triangle_follows_its_neighbour() {
    let mut all = Tessellation::new(&[[0, 1, 2], [2, 1, 3]], vec![0, 1, 2, 1]);
    let flat = all.leaf(1);
    assert!(!all.can_split(&flat));
    let whole = all.leaf(0);
    assert_eq!(all.growth(&whole), 1 + 3 + 1);
    all.split(0);
    assert_eq!(all.conforming().len(), all.count());
}
