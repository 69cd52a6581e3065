"""Opens the data sets that tests/zarr_python.rs wrote, by zarr-python, by numpy.memmap and by
xarray, and compares every value with the formula that it was made by."""

import os
import pathlib
import re
import sys
import warnings

import numpy as np
import xarray
import zarr

warnings.simplefilter("error")

POSES, POINTS, VERTICES, TRIANGLES, COEFFICIENTS, PARAMETERS, BONES, BLOCK = 10, 5, 7, 5, 4, 3, 2, 4


def equal(found, expected, what):
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape, (what, found.shape, expected.shape)
    assert np.array_equal(found, expected), (what, found, expected)


def half(*shape):
    return (np.arange(np.prod(shape)) * 0.5).astype("f4").reshape(shape)


def tables():
    """Name → (dtype, dimension names, values) of everything but the blocks."""
    pose = np.arange(POSES)
    rotation = np.array([0, 0.6, 0, 0.8], "f4")
    i = np.arange(VERTICES, dtype="f4")
    corner = np.arange(TRIANGLES)[:, None] + np.arange(3)
    return {
        "parameters": ("f4", ("pose", "parameter"), half(POSES, PARAMETERS)),
        "clip": ("i4", ("pose",), pose % 3 - 1),
        "time_s": ("f4", ("pose",), half(POSES)),
        "split": ("u1", ("pose",), pose % 4),
        "root_rotation": ("f4", ("pose", "xyzw"), np.tile(rotation, (POSES, 1))),
        "root_translation": ("f4", ("pose", "xyz"), np.stack([pose, pose * 0 + 1, pose * 0 + 2], 1)),
        "bone_rotation": ("f4", ("pose", "bone", "xyzw"), np.tile(rotation, (POSES, BONES, 1))),
        "bone_of_point": ("i4", ("point",), np.arange(POINTS) % BONES),
        "vertex_of_point": ("i4", ("point",), np.arange(POINTS)),
        "point_of_vertex": ("i4", ("vertex",), np.arange(VERTICES) % POINTS),
        "position": ("f4", ("vertex", "xyz"), np.stack([i, i * 0 + 0.25, i * 0 - 1], 1)),
        "normal": ("f4", ("vertex", "xyz"), np.tile([0, 1, 0], (VERTICES, 1))),
        "vertices_of_triangle": ("i4", ("triangle", "corner"), corner),
    }


def blocks():
    """As tables(), for the arrays in blocks of poses."""
    count = POSES * POINTS * COEFFICIENTS
    coefficients = (np.arange(count) * 0.125).reshape(POSES, POINTS, 1, COEFFICIENTS)
    noise = (np.arange(POSES)[:, None] + np.arange(POINTS)) * 0.25
    rays = np.tile(500 + np.arange(POSES)[:, None], (1, POINTS))
    return {
        "coefficients": ("f4", ("pose", "point", "channel", "coefficient"), coefficients),
        "noise": ("f4", ("pose", "point"), noise),
        "rays": ("u4", ("pose", "point"), rays),
    }


def by_zarr(folder):
    group = zarr.open_group(folder, mode="r", zarr_format=3)
    arrays = {**tables(), **blocks()}
    assert set(group.array_keys()) == set(arrays), set(group.array_keys()) ^ set(arrays)
    assert set(group.group_keys()) == {"source", "reference"}
    for name, (dtype, dimensions, values) in arrays.items():
        array = group[name]
        assert array.dtype == np.dtype("<" + dtype), (name, array.dtype)
        assert tuple(array.metadata.dimension_names) == dimensions, name
        equal(array[:], values.astype(dtype), name)
    assert group["coefficients"].chunks == (BLOCK, POINTS, 1, COEFFICIENTS)
    attributes = group.attrs.asdict()
    assert attributes["format"] == "poselight-dataset"
    assert attributes["format_version"] == 1
    assert attributes["signal"] == "transfer" and attributes["order"] == 2
    assert attributes["clip_names"] == ["walk", "jump ↑"]
    assert attributes["split_names"][0] == "training"
    assert attributes["parameter_names"] == [f"joint.{i}" for i in range(PARAMETERS)]
    assert attributes["hashes"]["bake"] == "0123" and attributes["recipe"] == {"version": 1}
    assert "escapes" in attributes["conventions"]["polarity"]
    assert attributes["parts"][0]["vertices"] == VERTICES
    source = group["source"]
    assert source.attrs["files"][0] == {"name": "a.glb", "bytes": 256}
    assert source["file0"].attrs["name"] == "a.glb"
    equal(source["file0"][:], np.arange(256, dtype="u1"), "file0")
    assert source["file1"].shape == (0,)


def by_zarr_reference(folder):
    group = zarr.open_group(folder, mode="r", zarr_format=3)["reference"]
    assert group.attrs["seeds"] == [1, 2**64 - 1] and group.attrs["rays"] == 4000
    equal(group["pose"][:], [0, POSES - 1], "pose")
    expected = np.array([[0, 1], [10, 11]], "f4")[:, :, None, None, None]
    equal(
        group["coefficients"][:],
        np.broadcast_to(expected, (2, 2, POINTS, 1, COEFFICIENTS)),
        "reference",
    )
    assert tuple(group["noise"].metadata.dimension_names) == ("seed", "pose", "point")
    equal(group["noise"][:], np.full((2, 2, POINTS), 0.5), "reference noise")
    equal(group["normal"][:], np.tile([0, 0, 1], (2, POINTS, 1)), "reference normal")


def by_memmap(folder):
    for name, (dtype, dimensions, values) in blocks().items():
        for block in range(-(-POSES // BLOCK)):
            chunk = folder / name / ".".join(["c", str(block)] + ["0"] * (len(dimensions) - 1))
            shape = (BLOCK,) + values.shape[1:]
            mapped = np.memmap(chunk, dtype="<" + dtype, mode="r", shape=shape)
            own = values[block * BLOCK : (block + 1) * BLOCK].astype(dtype)
            equal(mapped[: len(own)], own, chunk)
            if dtype == "f4":
                assert np.isnan(mapped[len(own) :]).all(), chunk
            assert chunk.stat().st_size == mapped.nbytes
    for name, (dtype, _, values) in tables().items():
        chunk = folder / name / ".".join(["c"] + ["0"] * values.ndim)
        mapped = np.memmap(chunk, dtype="<" + dtype, mode="r", shape=values.shape)
        equal(mapped, values.astype(dtype), chunk)


def by_xarray(folder):
    data = xarray.open_zarr(folder, consolidated=False)
    assert dict(data.sizes)["pose"] == POSES
    equal(data["coefficients"].isel(pose=3, point=2), blocks()["coefficients"][2][3, 2], "xarray")
    equal(data["time_s"], half(POSES), "xarray")
    reference = xarray.open_zarr(folder, group="reference", consolidated=False)
    equal(reference["coefficients"].sel(pose=POSES - 1).isel(seed=1, point=0)[0], [11] * 4, "sel")


def example_of_the_documentation(folder):
    """Runs the Python block of proto/dataset.md as it stands."""
    text = (pathlib.Path(__file__).parent.parent / "proto/dataset.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", text, re.S)
    os.chdir(folder)
    names = {}
    exec(code, names)
    assert names["at_vertices"].shape == (VERTICES, 1, COEFFICIENTS)
    assert len(names["training"]) == 33


def main(folder):
    by_zarr(folder / "moving")
    by_zarr_reference(folder / "moving")
    by_memmap(folder / "moving")
    by_xarray(folder / "moving")
    example_of_the_documentation(folder)
    still = zarr.open_group(folder / "still", mode="r", zarr_format=3)
    assert still["parameters"].shape == (1, 0) and still["parameters"][:].size == 0
    equal(still["coefficients"][:].shape, (1, POINTS, 1, COEFFICIENTS), "still")
    unfinished = zarr.open_group(folder / "unfinished", mode="r", zarr_format=3)
    assert np.isnan(unfinished["coefficients"][:]).all()
    assert not unfinished["rays"][:].any()


main(pathlib.Path(sys.argv[1]))
