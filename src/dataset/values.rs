//! Numbers to little-endian bytes and back, and their reading from chunk files.

use std::borrow::Cow;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

use bytemuck::{NoUninit, Pod, Zeroable};

use super::arrays::Array;
use super::{Error, files};

/// The little-endian bytes of values that are made of 4-byte numbers.
pub(super) fn bytes_of<T: NoUninit>(values: &[T]) -> Cow<'_, [u8]> {
    let bytes: &[u8] = bytemuck::cast_slice(values);
    if cfg!(target_endian = "little") {
        return Cow::Borrowed(bytes);
    }
    let mut swapped = bytes.to_vec();
    to_host(&mut swapped);
    Cow::Owned(swapped)
}

/// Turns little-endian 4-byte numbers into the machine's own, or back.
fn to_host(bytes: &mut [u8]) {
    if cfg!(target_endian = "big") {
        for number in bytes.chunks_exact_mut(4) {
            number.reverse();
        }
    }
}

/// Reads 4-byte numbers that start `offset` numbers into a chunk file.
pub(super) fn read_at<T: Pod>(
    file: &File,
    path: &Path,
    offset: u64,
    out: &mut [T],
) -> Result<(), Error> {
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(out);
    let end = offset * 4 + bytes.len() as u64;
    file.read_exact_at(bytes, offset * 4).map_err(|source| match source.kind() {
        // Its size was right when the data set was opened.
        io::ErrorKind::UnexpectedEof => Error::ChunkSize {
            path: path.to_path_buf(),
            expected: end,
            found: file.metadata().map_or(0, |metadata| metadata.len()),
        },
        _ => Error::io("read", path)(source),
    })?;
    to_host(bytes);
    Ok(())
}

/// The whole of an array of 4-byte numbers that is one chunk, after its size is found right.
pub(super) fn read_table<T: Pod + Zeroable>(root: &Path, array: &Array) -> Result<Vec<T>, Error> {
    let mut values = Vec::new();
    if let Some(file) = open_table(root, array)? {
        values.resize(array.chunk_values() as usize, T::zeroed());
        read_at(&file, &array.chunk_path(root, &[]), 0, &mut values)?;
    }
    Ok(values)
}

/// As [`read_table`], for single bytes.
pub(super) fn read_bytes(root: &Path, array: &Array) -> Result<Vec<u8>, Error> {
    let Some(file) = open_table(root, array)? else { return Ok(Vec::new()) };
    let mut bytes = vec![0; array.chunk_bytes() as usize];
    let path = array.chunk_path(root, &[]);
    file.read_exact_at(&mut bytes, 0).map_err(Error::io("read", path))?;
    Ok(bytes)
}

/// The one chunk of an array; `None` where the array is empty and so has none.
fn open_table(root: &Path, array: &Array) -> Result<Option<File>, Error> {
    if array.chunks() == 0 {
        return Ok(None);
    }
    check_table(root, array)?;
    let path = array.chunk_path(root, &[]);
    File::open(&path).map(Some).map_err(Error::io("read", path))
}

/// Whether the one chunk of an array is there and has its size.
pub(super) fn check_table(root: &Path, array: &Array) -> Result<(), Error> {
    if array.chunks() == 0 {
        return Ok(());
    }
    let path = array.chunk_path(root, &[]);
    match files::check_size(&path, array.chunk_bytes())? {
        Some(()) => Ok(()),
        None => Err(Error::ChunkMissing { path, remedy: root.to_path_buf() }),
    }
}
