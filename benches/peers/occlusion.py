"""Occlusion rays per second of other tracers on a mesh, beside a poselight bake of the same mesh.

usage: occlusion.py MESH.obj [POSELIGHT] [RAYS_PER_VERTEX]
Every peer gets the same rays: from each vertex, cosine-weighted about its normal, vertex by vertex
as its users would call it, and once more with the directions of each vertex sorted by octant and
azimuth, as poselight sorts them. Blender (Cycles, on the path as `blender`) bakes ambient occlusion to the
vertices with as many samples of its own. A peer that is not installed is skipped, and said so. Rates are of
one run on one machine, so only their ratios mean something.
"""

import json
import subprocess
import sys
import tempfile
import time

try:
    import numpy as np
except ImportError:
    sys.exit("skipped: numpy is not installed, and every peer needs it")

mesh = sys.argv[1]
poselight = sys.argv[2] if len(sys.argv) > 2 else "target/release/poselight"
per_vertex = int(sys.argv[3]) if len(sys.argv) > 3 else 64


def read_obj(path):
    positions, faces = [], []
    for line in open(path, encoding="utf-8", errors="replace"):
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            positions.append([float(w) for w in words[1:4]])
        elif words[0] == "f":
            corners = [int(w.split("/")[0]) for w in words[1:]]
            corners = [c - 1 if c > 0 else len(positions) + c for c in corners]
            faces += [[corners[0], b, c] for b, c in zip(corners[1:], corners[2:])]
    return np.array(positions, np.float32), np.array(faces, np.uint32)


def rays(positions, faces, ordered):
    """Origins and directions, [vertex * ray, 3], float32."""
    p = positions.astype(np.float64)
    area = np.cross(p[faces[:, 1]] - p[faces[:, 0]], p[faces[:, 2]] - p[faces[:, 0]])
    normals = np.zeros_like(p)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], area)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    stream = np.random.default_rng(1)
    n = len(p)
    r, azimuth = np.sqrt(stream.random((n, per_vertex))), stream.random((n, per_vertex))
    if ordered:
        quadrant = np.floor(azimuth * 4)
        order = np.lexsort((r, azimuth, quadrant), axis=1)
        r, azimuth = (np.take_along_axis(a, order, 1) for a in (r, azimuth))
    local = np.stack([r * np.cos(2 * np.pi * azimuth), r * np.sin(2 * np.pi * azimuth)], -1)
    up = np.sqrt(np.maximum(0, 1 - r * r))
    helper = np.where(np.abs(normals[:, :1]) > 0.5, [[0, 1, 0]], [[1, 0, 0]])
    u = np.cross(helper, normals)
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-30)
    v = np.cross(normals, u)
    directions = local[..., :1] * u[:, None] + local[..., 1:] * v[:, None] + up[..., None] * normals[:, None]
    size = np.linalg.norm(p.max(0) - p.min(0))
    origins = np.repeat(p + 1e-4 * size * normals, per_vertex, 0)
    return origins.astype(np.float32), directions.reshape(-1, 3).astype(np.float32)


def mitsuba(positions, faces):
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    shape = mi.Mesh("mesh", len(positions), len(faces))
    parameters = mi.traverse(shape)
    parameters["vertex_positions"] = positions.ravel()
    parameters["faces"] = faces.ravel()
    parameters.update()
    scene = mi.load_dict({"type": "scene", "mesh": shape})

    def run(origins, directions):
        o, d = mi.Point3f(*origins.T.copy()), mi.Vector3f(*directions.T.copy())
        return np.array(scene.ray_test(mi.Ray3f(o, d))).sum()

    return run


def open3d(positions, faces):
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(positions), o3d.core.Tensor(faces))

    def run(origins, directions):
        both = o3d.core.Tensor(np.concatenate([origins, directions], 1))
        return scene.test_occlusions(both).numpy().sum()

    return run


def embreex(positions, faces):
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, positions, faces.astype(np.int32))

    def run(origins, directions):
        return (scene.run(origins, directions, query="OCCLUDED") >= 0).sum()

    return run


BLENDER = """
import sys, time
import bpy

path, samples = sys.argv[-2:]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.obj_import(filepath=path)
mesh = bpy.context.selected_objects[0]
bpy.context.view_layer.objects.active = mesh
mesh.data.color_attributes.new("ao", "FLOAT_COLOR", "POINT")
scene = bpy.context.scene
scene.world = bpy.data.worlds.new("world")
scene.world.light_settings.distance = 1e6
scene.render.engine = "CYCLES"
scene.cycles.samples = int(samples)
scene.cycles.use_adaptive_sampling = False
scene.render.bake.target = "VERTEX_COLORS"
start = time.perf_counter()
bpy.ops.object.bake(type="AO")
seconds = time.perf_counter() - start
values = [c.color[0] for c in mesh.data.color_attributes["ao"].data]
print("baked", len(values), seconds, sum(values) / len(values))
"""


def blender():
    """Samples per second and mean of a bake of ambient occlusion to vertices by Cycles."""
    script = ["--background", "--factory-startup", "--python-expr", BLENDER, "--", mesh, str(per_vertex)]
    out = subprocess.run(["blender", *script], capture_output=True, check=True, text=True).stdout
    words = [line.split() for line in out.splitlines() if line.startswith("baked ")][-1]
    return int(words[1]) * per_vertex / float(words[2]), float(words[3])


def own():
    """Rays per second of a bake of as many rays, sorting and harmonics included; the best of three."""
    def once():
        with tempfile.TemporaryDirectory() as folder:
            command = [poselight, "--json", "bake", mesh, "-o", f"{folder}/d.zarr", "--rays", str(per_vertex)]
            out = subprocess.run(command, capture_output=True, check=True).stdout
        return json.loads(out)["bake"]["rays_per_s"]

    return max(once() for _ in range(3))


positions, faces = read_obj(mesh)
print(f"{mesh}: {len(positions)} vertices, {len(faces)} triangles, {per_vertex} rays per vertex")
print("| tracer | rays | Mray/s | blocked |\n|---|---|---|---|")
try:
    print(f"| poselight bake, transfer of order 6 | its own | {own() / 1e6:.2f} | |")
except (OSError, subprocess.CalledProcessError) as fault:
    print(f"skipped: poselight did not run ({fault})")
for name, make in [("mitsuba", mitsuba), ("open3d", open3d), ("embreex", embreex)]:
    try:
        run = make(positions, faces)
    except ImportError as fault:
        print(f"skipped: {name} is not installed ({fault})")
        continue
    for ordered in (False, True):
        origins, directions = rays(positions, faces, ordered)
        best = float("inf")
        for _ in range(3):
            start = time.perf_counter()
            blocked = run(origins, directions)
            best = min(best, time.perf_counter() - start)
        kind = "sorted" if ordered else "as drawn"
        print(f"| {name} | {kind} | {len(origins) / best / 1e6:.2f} | {blocked / len(origins):.4f} |")
try:
    rate, mean = blender()
    print(f"| blender, Cycles to vertices | its own | {rate / 1e6:.3f} | {1 - mean:.4f} |")
except FileNotFoundError:
    print("skipped: blender is not installed")
except (subprocess.CalledProcessError, IndexError) as fault:
    print(f"skipped: blender did not bake ({fault})")
