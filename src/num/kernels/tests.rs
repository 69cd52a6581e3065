use super::*;

fn value(seed: usize, i: usize) -> f32 {
    ((i * 37 + seed * 101) % 1009) as f32 / 504.5 - 1.0
}

fn left(rows: usize, inner: usize) -> Panels {
    Panels::new(rows, inner, |row, j| value(1, row * inner + j))
}

fn right(inner: usize, columns: usize) -> Vec<f32> {
    (0..inner * columns).map(|i| value(2, i)).collect()
}

/// The product in f64.
fn oracle(rows: usize, inner: usize, columns: usize) -> Vec<f64> {
    let right = right(inner, columns);
    let entry = |row: usize, c: usize| {
        (0..inner)
            .map(|j| f64::from(value(1, row * inner + j)) * f64::from(right[j * columns + c]))
            .sum()
    };
    (0..rows)
        .flat_map(|row| (0..columns).map(move |c| (row, c)))
        .map(|(r, c)| entry(r, c))
        .collect()
}

/// Every instruction set that this machine has agrees with a product in f64, in both layouts, for
/// numbers of rows and columns around every boundary of panels and tiles.
#[test]
fn products_agree_with_f64() {
    for isa in Isa::available() {
        for rows in [1, 7, 31, 32, 33, 64, 101] {
            for columns in [1, 2, 3, 4, 9, 12, 16, 25, 27, 36, 49, 108] {
                for inner in [0, 1, 5, 22] {
                    let exact = oracle(rows, inner, columns);
                    let (a, b) = (left(rows, inner), right(inner, columns));
                    let mut out = vec![f32::NAN; rows * columns];
                    multiply(isa, &a, &b, columns, Layout::Rows, &mut out);
                    let mut planar = vec![f32::NAN; rows * columns];
                    multiply(isa, &a, &b, columns, Layout::Planar, &mut planar);
                    for row in 0..rows {
                        for c in 0..columns {
                            let found = out[row * columns + c];
                            let error = (f64::from(found) - exact[row * columns + c]).abs();
                            let place = (isa.name(), rows, columns, inner, row, c);
                            assert!(error < 1e-5, "{place:?}: {error}");
                            assert_eq!(found, planar[c * rows + row], "{place:?}");
                        }
                    }
                }
            }
        }
    }
}

/// A row's result does not depend on which other rows are computed with it, bit for bit.
#[test]
fn rows_are_independent() {
    for isa in Isa::available() {
        let (all, b) = (left(100, 22), right(22, 36));
        let mut whole = vec![0.0; 100 * 36];
        multiply(isa, &all, &b, 36, Layout::Rows, &mut whole);
        let chosen = [99, 3, 3, 40];
        let few = Panels::new(4, 22, |row, j| all.at(chosen[row], j));
        let mut part = vec![0.0; 4 * 36];
        multiply(isa, &few, &b, 36, Layout::Rows, &mut part);
        for (i, row) in chosen.into_iter().enumerate() {
            assert_eq!(part[i * 36..(i + 1) * 36], whole[row * 36..(row + 1) * 36]);
        }
    }
}

/// Grouped rows agree with separate products, whichever way the groups are mixed.
#[test]
fn groups_agree_with_separate_products() {
    let (rows, inner, groups) = (75, 9, 5);
    let a = left(rows, inner);
    let sides = right(inner, groups);
    let group_of_row: Vec<u16> = (0..rows).map(|row| (row * row % groups) as u16).collect();
    for isa in Isa::available() {
        let mut out = vec![f32::NAN; rows];
        multiply_grouped(isa, &a, &Groups::new(&group_of_row), &sides, &mut out);
        for group in 0..groups {
            let side = &sides[group * inner..(group + 1) * inner];
            let mut expected = vec![0.0; rows];
            multiply(isa, &a, side, 1, Layout::Rows, &mut expected);
            for row in (0..rows).filter(|&row| usize::from(group_of_row[row]) == group) {
                assert_eq!(out[row], expected[row], "{} {row}", isa.name());
            }
        }
    }
}
