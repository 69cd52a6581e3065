"""Does the plan of a large bake hold? A skinned tube of 100,000 vertices, order 6.

usage: large.py [POSELIGHT] [POSES] [RAYS]
Prints what `bake --dry-run` says of 2,000 poses at 500 rays (29 GB of coefficients), then bakes and
fits the same tube at POSES poses (default 60) and RAYS rays (default 16), and prints its plan beside
what the processes used: peak memory, bytes on disk, seconds. Blocks are as large in both jobs, so the
memory of the bake is bounded by the same code; poses, rays, time and disk are what is reduced.
"""

import json
import math
import os
import struct
import subprocess
import sys
import tempfile
import time

poselight = sys.argv[1] if len(sys.argv) > 1 else "target/release/poselight"
poses = int(sys.argv[2]) if len(sys.argv) > 2 else 60
rays = int(sys.argv[3]) if len(sys.argv) > 3 else 16
RINGS, SEGMENTS, JOINTS, SECONDS = 500, 200, 5, 66.6


def tube():
    """A GLB: rings about Y with a groove, five joints in a row, one clip of SECONDS at 30 Hz."""
    position, normal, joints, weights, index = [], [], [], [], []
    for ring in range(RINGS):
        y = 2.0 * ring / (RINGS - 1)
        radius = 0.25 + 0.05 * math.sin(20 * y)
        along = min(y / 2.0 * (JOINTS - 1), JOINTS - 1 - 1e-6)
        low = int(along)
        for segment in range(SEGMENTS):
            angle = 2 * math.pi * segment / SEGMENTS
            c, s = math.cos(angle), math.sin(angle)
            slope = -math.cos(20 * y)
            length = math.sqrt(1 + slope * slope)
            position += [radius * c, y, radius * s]
            normal += [c / length, slope / length, s / length]
            joints += [low, low + 1, 0, 0]
            weights += [1 - along + low, along - low, 0.0, 0.0]
    for ring in range(RINGS - 1):
        for segment in range(SEGMENTS):
            a, b = ring * SEGMENTS + segment, ring * SEGMENTS + (segment + 1) % SEGMENTS
            index += [a, a + SEGMENTS, b, b, a + SEGMENTS, b + SEGMENTS]
    keys = 200
    times = [SECONDS * key / (keys - 1) for key in range(keys)]
    turns = []
    for joint in range(1, JOINTS):
        half = [0.35 * math.sin(0.9 * joint * t + joint) / 2 for t in times]
        turns.append([x for h in half for x in (0.0, 0.0, math.sin(h), math.cos(h))])
    binds = []
    for joint in range(JOINTS):
        binds += [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -2.0 * joint / (JOINTS - 1), 0, 1]
    blob, views, accessors = b"", [], []

    def add(values, code, component, kind, width, bounds=False):
        nonlocal blob
        data = struct.pack(f"<{len(values)}{code}", *values)
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        accessor = {"bufferView": len(views) - 1, "componentType": component, "type": kind}
        accessor["count"] = len(values) // width
        if bounds:
            accessor["min"] = [min(values[axis::width]) for axis in range(width)]
            accessor["max"] = [max(values[axis::width]) for axis in range(width)]
        accessors.append(accessor)
        blob += data + b"\0" * (-len(data) % 4)
        return len(accessors) - 1

    as_f32 = lambda values: list(struct.unpack(f"<{len(values)}f", struct.pack(f"<{len(values)}f", *values)))
    attributes = {
        "POSITION": add(as_f32(position), "f", 5126, "VEC3", 3, True),
        "NORMAL": add(normal, "f", 5126, "VEC3", 3),
        "JOINTS_0": add(joints, "B", 5121, "VEC4", 4),
        "WEIGHTS_0": add(weights, "f", 5126, "VEC4", 4),
    }
    indices = add(index, "I", 5125, "SCALAR", 1)
    inverse = add(binds, "f", 5126, "MAT4", 16)
    clock = add(as_f32(times), "f", 5126, "SCALAR", 1, True)
    samplers = [{"input": clock, "output": add(turn, "f", 5126, "VEC4", 4)} for turn in turns]
    nodes = []
    for joint in range(JOINTS):
        step = 2.0 / (JOINTS - 1) if joint else 0.0
        node = {"name": f"joint{joint}", "translation": [0, step, 0]}
        nodes.append(node | ({"children": [joint + 1]} if joint + 1 < JOINTS else {}))
    nodes.append({"name": "tube", "mesh": 0, "skin": 0})
    channels = [
        {"sampler": at, "target": {"node": at + 1, "path": "rotation"}} for at in range(len(turns))
    ]
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, JOINTS]}],
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
        "skins": [{"joints": list(range(JOINTS)), "inverseBindMatrices": inverse}],
        "animations": [{"name": "sway", "samplers": samplers, "channels": channels}],
        "buffers": [{"byteLength": len(blob)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    whole = 12 + 8 + len(text) + 8 + len(blob)
    head = struct.pack("<4sII", b"glTF", 2, whole) + struct.pack("<I4s", len(text), b"JSON")
    return head + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob


def plan(scene, folder, flags):
    command = [poselight, "--json", "bake", scene, "-o", f"{folder}/plan.zarr", "--dry-run", *flags]
    return json.loads(subprocess.run(command, capture_output=True, check=True).stdout)


def measured(command):
    """Seconds and peak resident bytes of a process."""
    start = time.perf_counter()
    quiet = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
    pid = os.posix_spawnp(command[0], command, os.environ, file_actions=quiet)
    _, status, usage = os.wait4(pid, 0)
    if status:
        sys.exit(f"{command[1:3]} failed")
    return time.perf_counter() - start, usage.ru_maxrss * 1024


def row(name, planned, used, unit):
    print(f"| {name} | {planned:.2f} | {used:.2f} | {unit} | {used / planned:.2f} |")


with tempfile.TemporaryDirectory() as folder:
    scene = f"{folder}/tube.glb"
    with open(scene, "wb") as out:
        out.write(tube())
    same = ["--order", "6", "--near-repeat", "0"]
    full = plan(scene, folder, [*same, "--fps", "30", "--rays", "500"])
    points, all_poses = full["points"], full["poses"]
    print(f"The whole job: {points} points, {all_poses} poses, 500 rays, order 6")
    print(f"plan: {full['memory_bytes'] / 1e9:.2f} GB memory, {full['disk_bytes'] / 1e9:.2f} GB disk, "
          f"{full['bake_s'] / 3600:.2f} h at {full['rays_per_s'] / 1e6:.1f} Mray/s\n")
    flags = [*same, "--fps", str(poses / SECONDS), "--rays", str(rays)]
    small = plan(scene, folder, flags)
    data = f"{folder}/data.zarr"
    seconds, peak = measured([poselight, "--json", "bake", scene, "-o", data, *flags])
    disk = sum(os.path.getsize(os.path.join(at, name)) for at, _, names in os.walk(data) for name in names)
    print(f"Reduced to {small['poses']} poses and {rays} rays:\n")
    print("| bake | planned | used | | used / planned |\n|---|---|---|---|---|")
    row("peak memory", small["memory_bytes"] / 1e9, peak / 1e9, "GB")
    row("disk", small["disk_bytes"] / 1e9, disk / 1e9, "GB")
    row("time", small["bake_s"], seconds, "s")
    fit = [poselight, "--json", "fit", data, "-o", f"{folder}/m.safetensors", "--family", "pca-linear"]
    seconds, peak = measured([*fit, "--inputs", "4", "--outputs", "22"])
    print(f"\nfit of P(4,22): {seconds:.1f} s, peak {peak / 1e9:.2f} GB")
    print(f"memory planned for the whole over that for the reduced job: "
          f"{full['memory_bytes'] / small['memory_bytes']:.3f}")
