//! NumPy arrays in and out.

use std::path::Path;

use anyhow::{Context, bail};
use npyz::WriterBuilder;

use crate::pipeline::files;

/// Parameters and lights are small; this bounds what is read.
const MOST_BYTES: u64 = 1 << 30;

/// An array of f32 or f64 numbers, as f32 in C order, with its shape.
pub(super) fn read_npy(path: &Path) -> anyhow::Result<(Vec<usize>, Vec<f32>)> {
    let bytes = files::read(path, MOST_BYTES)?;
    let place = || format!("{} as a NumPy array", path.display());
    let array = npyz::NpyFile::new(&bytes[..]).with_context(place)?;
    if array.order() != npyz::Order::C {
        bail!("{} is in Fortran order; save it with numpy.ascontiguousarray", path.display());
    }
    let shape = array.shape().iter().map(|&n| n as usize).collect();
    let values = match array.try_data::<f32>() {
        Ok(data) => data.collect::<Result<Vec<f32>, _>>().with_context(place)?,
        Err(array) => {
            let Ok(data) = array.try_data::<f64>() else {
                bail!("{} holds neither f32 nor f64 numbers", path.display());
            };
            data.map(|value| value.map(|v| v as f32))
                .collect::<Result<_, _>>()
                .with_context(place)?
        }
    };
    Ok((shape, values))
}

/// Writes an f32 array in C order.
pub(super) fn write_npy(path: &Path, shape: &[usize], values: &[f32]) -> anyhow::Result<()> {
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    let mut bytes = Vec::with_capacity(values.len() * 4 + 128);
    let mut writer =
        npyz::WriteOptions::new().default_dtype().shape(&shape).writer(&mut bytes).begin_nd()?;
    writer.extend(values.iter().copied())?;
    writer.finish()?;
    files::publish(path, &bytes)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is written reads back with its shape.
    #[test]
    fn arrays_survive_the_round_trip() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("a.npy");
        let values: Vec<f32> = (0..6).map(|i| i as f32 / 3.0).collect();
        write_npy(&path, &[2, 3], &values).expect("written");
        assert_eq!(read_npy(&path).expect("read"), (vec![2, 3], values));
    }

    /// Other files are refused by name.
    #[test]
    fn other_bytes_are_refused_by_name() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("b.npy");
        std::fs::write(&path, b"not an array").expect("written");
        let error = format!("{:#}", read_npy(&path).expect_err("no array"));
        assert!(error.contains("b.npy"), "{error}");
    }
}
