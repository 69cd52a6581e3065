"""What would instances of the tracer save? Many copies of one mesh, by EXT_mesh_gpu_instancing.

usage: instances.py [POSELIGHT] [COPIES ...]
Bakes ambient occlusion of so many copies of a sphere of 512 triangles (64 rays a point), and of a plane
beneath that many which only block (`--occluders`), and prints peak memory and rays per second of the process.
poselight gives every copy its own triangles. Beside it, where Mitsuba 3 is installed (its LLVM variant traces
by Embree too), the same spheres once as triangles of their own and once as instances of one: memory of the
scene, and rays per second of the same rays.
"""

import json
import os
import struct
import subprocess
import sys
import tempfile
import time

poselight = sys.argv[1] if len(sys.argv) > 1 else "target/release/poselight"
counts = [int(word) for word in sys.argv[2:] if word.isdigit()] or [100, 1000]


def sphere(levels=3):
    positions = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)]
    faces = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    for _ in range(levels):
        middles, finer = {}, []

        def middle(a, b):
            key = (min(a, b), max(a, b))
            if key not in middles:
                p = [(x + y) / 2 for x, y in zip(positions[a], positions[b])]
                length = sum(x * x for x in p) ** 0.5
                middles[key] = len(positions)
                positions.append(tuple(x / length for x in p))
            return middles[key]

        for a, b, c in faces:
            d, e, f = middle(a, b), middle(b, c), middle(c, a)
            finer += [(a, d, f), (d, b, e), (f, e, c), (d, e, f)]
        faces = finer
    return positions, faces


def places(count):
    """Centres on a jittered grid, so that copies nearly touch."""
    side = max(1, round(count ** 0.5 + 0.49))
    return [(2.2 * (i % side), 1.1 + 0.3 * (i * 7 % 5), 2.2 * (i // side)) for i in range(count)]


def write(path, positions, normals, faces, translations=None):
    """A GLB of one mesh, once or at every translation."""
    blob, views, accessors = b"", [], []

    def add(rows, code, component, kind):
        nonlocal blob
        flat = [x for row in rows for x in row] if kind != "SCALAR" else rows
        data = struct.pack(f"<{len(flat)}{code}", *flat)
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": len(rows), "type": kind})
        if kind == "VEC3":
            columns = list(zip(*rows))
            accessors[-1] |= {"min": [min(c) for c in columns], "max": [max(c) for c in columns]}
        blob += data
        return len(accessors) - 1

    attributes = {"POSITION": add(positions, "f", 5126, "VEC3"), "NORMAL": add(normals, "f", 5126, "VEC3")}
    indices = add([i for face in faces for i in face], "I", 5125, "SCALAR")
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
    }
    if translations:
        held = {"attributes": {"TRANSLATION": add(translations, "f", 5126, "VEC3")}}
        document["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": held}
        document["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    document |= {"accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(blob)}]}
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    with open(path, "wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(blob)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(blob), b"BIN\0") + blob)


def run(*words):
    """What a command answers, its error output, and its peak memory in bytes."""
    process = subprocess.Popen([poselight, "--json", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    out, err = process.stdout.read(), process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, out, err.decode(), usage.ru_maxrss * 1024


def bake(*words):
    code, out, err, peak = run("bake", *words, "--signal", "ao", "--rays", "64")
    if code != 0:
        return f"refused: {err.strip().splitlines()[-1]} |  "
    return f"{peak / 1e6:.0f} MB | {json.loads(out)['bake']['rays_per_s'] / 1e6:.1f}"


def resident():
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def mitsuba(positions, faces, centres, instanced):
    """Bytes of a scene and rays per second."""
    import mitsuba as mi
    import numpy as np

    mi.set_variant("llvm_ad_rgb")

    def mesh(p, f):
        shape = mi.Mesh("mesh", len(p), len(f))
        parameters = mi.traverse(shape)
        parameters["vertex_positions"], parameters["faces"] = p.ravel(), f.ravel()
        parameters.update()
        return shape

    p, f = np.array(positions, np.float32), np.array(faces, np.uint32)
    before = resident()
    if instanced:
        parts = {"type": "scene", "group": {"type": "shapegroup", "mesh": mesh(p, f)}}
        for i, centre in enumerate(centres):
            place = mi.ScalarTransform4f().translate(list(centre))
            parts[f"i{i}"] = {"type": "instance", "to_world": place, "of": {"type": "ref", "id": "group"}}
    else:
        all_p = np.concatenate([p + np.array(c, np.float32) for c in centres])
        all_f = np.concatenate([f + np.uint32(i * len(p)) for i in range(len(centres))])
        parts = {"type": "scene", "mesh": mesh(all_p, all_f)}
    scene = mi.load_dict(parts)
    stream = np.random.default_rng(1)
    n = 1_000_000
    at = np.array(centres, np.float32)[stream.integers(len(centres), size=n)]
    d = stream.normal(size=(n, 3)).astype(np.float32)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    o = at + 1.001 * d
    d = (d + 0.99 * np.roll(d, 1, 0)).astype(np.float32)
    ray = mi.Ray3f(mi.Point3f(*o.T.copy()), mi.Vector3f(*d.T.copy()))
    best = float("inf")
    for _ in range(4):
        start = time.perf_counter()
        np.array(scene.ray_test(ray)).sum()
        best = min(best, time.perf_counter() - start)
    return resident() - before, n / best


if len(sys.argv) > 1 and sys.argv[1] == "--mitsuba":
    centres = places(int(sys.argv[2]))
    memory, rate = mitsuba(*sphere(), centres, sys.argv[3] == "instances")
    print(memory, rate)
    sys.exit(0)

positions, faces = sphere()
print("| copies | triangles | all lit: peak | Mray/s | all block: peak | Mray/s |\n|---|---|---|---|---|---|")
with tempfile.TemporaryDirectory() as folder:
    plane = f"{folder}/plane.glb"
    n = 40
    grid = [(2.2 * i, 0.0, 2.2 * j) for i in range(n) for j in range(n)]
    cells = [(i * n + j, i * n + j + 1, i * n + n + j) for i in range(n - 1) for j in range(n - 1)]
    write(plane, grid, [(0.0, 1.0, 0.0)] * len(grid), cells)
    for count in counts:
        scene = f"{folder}/copies.glb"
        write(scene, positions, positions, faces, places(count))
        lit = bake(scene, "-o", f"{folder}/lit{count}.zarr")
        block = bake(plane, "-o", f"{folder}/block{count}.zarr", "--occluders", scene)
        print(f"| {count:,} | {count * len(faces):,} | {lit} | {block} |", flush=True)
print("\n| Mitsuba's scene | copies | memory | Mray/s |\n|---|---|---|---|")
for count in [count for count in counts if count <= 10_000]:
    for kind in ["triangles", "instances"]:
        command = [sys.executable, __file__, "--mitsuba", str(count), kind]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            print(f"skipped: mitsuba did not run ({done.stderr.strip().splitlines()[-1]})")
            sys.exit(0)
        memory, rate = done.stdout.split()[-2:]
        print(f"| {kind} | {count:,} | {int(memory) / 1e6:.0f} MB | {float(rate) / 1e6:.1f} |", flush=True)
