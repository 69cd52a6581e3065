#!/usr/bin/env python3
"""An independent glTF deformer: reads a file and prints deformed vertices, all in float64.

Shares no code with the crate and needs nothing but Python 3. It follows the glTF 2.0 text
literally: samplers (appendix C), local and global transforms, morph targets before skinning,
linear blend skinning with the node transform of a skinned mesh ignored, and normals by the
inverse transpose of the blended matrix.

    skinning_oracle.py FILE CLIP TIME...

CLIP is the animation's index, or "rest". Prints one JSON object: "poses" has one entry per TIME
with "positions" and "normals", lists of [x, y, z] in the scene's space, in the order node,
primitive, vertex.
"""

import base64
import json
import math
import os
import struct
import sys

COMPONENTS = {
    5120: ("b", 1, 127.0), 5121: ("B", 1, 255.0), 5122: ("h", 2, 32767.0),
    5123: ("H", 2, 65535.0), 5125: ("I", 4, 1.0), 5126: ("f", 4, 1.0),
}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class File:
    """The JSON of a .glb or .gltf and the bytes of its buffers."""

    def __init__(self, path):
        with open(path, "rb") as file:
            data = file.read()
        binary = b""
        if data[:4] == b"glTF":
            at, total = 12, struct.unpack_from("<I", data, 8)[0]
            while at < total:
                size, kind = struct.unpack_from("<I4s", data, at)
                chunk = data[at + 8:at + 8 + size]
                if kind == b"JSON":
                    self.json = json.loads(chunk)
                elif kind == b"BIN\0":
                    binary = chunk
                at += 8 + size
        else:
            self.json = json.loads(data)
        self.buffers = [
            self.external(path, buffer["uri"]) if "uri" in buffer else binary
            for buffer in self.list("buffers")
        ]

    @staticmethod
    def external(path, uri):
        if uri.startswith("data:"):
            return base64.b64decode(uri.split(",", 1)[1])
        with open(os.path.join(os.path.dirname(path), uri), "rb") as file:
            return file.read()

    def list(self, name):
        return self.json.get(name, [])

    def raw(self, view, offset, code, size, width, count):
        """`count` tuples of `width` numbers from a buffer view."""
        view = self.json["bufferViews"][view]
        start = view.get("byteOffset", 0) + offset
        stride = view.get("byteStride", width * size)
        unpack = struct.Struct("<%d%s" % (width, code)).unpack_from
        buffer = self.buffers[view["buffer"]]
        return [unpack(buffer, start + i * stride) for i in range(count)]

    def accessor(self, index, floats=True):
        accessor = self.json["accessors"][index]
        code, size, scale = COMPONENTS[accessor["componentType"]]
        width, count = WIDTHS[accessor["type"]], accessor["count"]
        if "bufferView" in accessor:
            offset = accessor.get("byteOffset", 0)
            rows = self.raw(accessor["bufferView"], offset, code, size, width, count)
        else:
            rows = [(0,) * width] * count
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            where, what = sparse["indices"], sparse["values"]
            kind, bytes_each, _ = COMPONENTS[where["componentType"]]
            places = self.raw(where["bufferView"], where.get("byteOffset", 0), kind, bytes_each,
                              1, sparse["count"])
            values = self.raw(what["bufferView"], what.get("byteOffset", 0), code, size, width,
                              sparse["count"])
            for (place,), value in zip(places, values):
                rows[place] = value
        if floats and accessor.get("normalized"):
            rows = [tuple(max(x / scale, -1.0) for x in row) for row in rows]
        return rows


def multiply(a, b):
    """Product of two affine maps, each three rows of four."""
    return [
        [sum(a[i][k] * b[k][j] for k in range(3)) + (a[i][3] if j == 3 else 0.0) for j in range(4)]
        for i in range(3)
    ]


def from_columns(m):
    return [[m[4 * column + row] for column in range(4)] for row in range(3)]


def normalized(v):
    length = math.sqrt(sum(x * x for x in v))
    return [x / length for x in v]


def from_trs(t, q, s):
    x, y, z, w = normalized(q)
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return [[rotation[i][j] * s[j] for j in range(3)] + [t[i]] for i in range(3)]


def slerp(a, b, t):
    a, b = normalized(a), normalized(b)
    dot = sum(x * y for x, y in zip(a, b))
    sign = -1.0 if dot < 0 else 1.0
    angle = math.acos(min(1.0, abs(dot)))
    if angle < 1e-6:
        first, second = 1.0 - t, t
    else:
        first = math.sin((1.0 - t) * angle) / math.sin(angle)
        second = math.sin(t * angle) / math.sin(angle)
    return [first * x + sign * second * y for x, y in zip(a, b)]


def sample(times, values, width, mode, rotation, time):
    """The value of a sampler; `values` is a flat list of numbers."""
    cubic = mode == "CUBICSPLINE"
    rows = 3 if cubic else 1

    def at(key, row):
        start = (key * rows + row) * width
        return values[start:start + width]

    middle = 1 if cubic else 0
    if time <= times[0]:
        return at(0, middle)
    if time >= times[-1]:
        return at(len(times) - 1, middle)
    key = max(k for k in range(len(times)) if times[k] <= time)
    step = times[key + 1] - times[key]
    t = (time - times[key]) / step
    if mode == "STEP":
        return at(key, 0)
    if not cubic:
        if rotation:
            return slerp(at(key, 0), at(key + 1, 0), t)
        return [(1 - t) * a + t * b for a, b in zip(at(key, 0), at(key + 1, 0))]
    a, leaving, b, entering = at(key, 1), at(key, 2), at(key + 1, 1), at(key + 1, 0)
    return [
        (2 * t**3 - 3 * t**2 + 1) * a[i] + step * (t**3 - 2 * t**2 + t) * leaving[i]
        + (-2 * t**3 + 3 * t**2) * b[i] + step * (t**3 - t**2) * entering[i]
        for i in range(width)
    ]


class Character:
    """What does not depend on time, decoded once."""

    def __init__(self, file):
        self.file = file
        self.nodes = file.list("nodes")
        self.parents = {}
        for index, node in enumerate(self.nodes):
            for child in node.get("children", []):
                self.parents[child] = index
        scene = file.list("scenes")[file.json.get("scene", 0)]
        self.shown, todo = set(), list(scene["nodes"])
        while todo:
            node = todo.pop()
            self.shown.add(node)
            todo += self.nodes[node].get("children", [])
        self.skins = [
            (skin["joints"], [from_columns(m) for m in file.accessor(skin["inverseBindMatrices"])]
             if "inverseBindMatrices" in skin else None)
            for skin in file.list("skins")
        ]
        self.primitives = {
            index: [self.primitive(p) for p in mesh["primitives"]]
            for index, mesh in enumerate(file.list("meshes"))
        }

    def primitive(self, primitive):
        names = primitive["attributes"]
        influences = None
        if "JOINTS_0" in names:
            count = len(self.file.accessor(names["JOINTS_0"]))
            influences = [[] for _ in range(count)]
            for group in range(8):
                if "JOINTS_%d" % group not in names:
                    break
                joints = self.file.accessor(names["JOINTS_%d" % group], floats=False)
                weights = self.file.accessor(names["WEIGHTS_%d" % group])
                for v in range(count):
                    influences[v] += [(j, w) for j, w in zip(joints[v], weights[v]) if w > 0]
            for v, pairs in enumerate(influences):
                total = sum(w for _, w in pairs)
                influences[v] = [(j, w / total) for j, w in pairs]
        targets = []
        for target in primitive.get("targets", []):
            targets.append({
                name: {v: d for v, d in enumerate(self.file.accessor(target[name])) if any(d)}
                for name in ("POSITION", "NORMAL") if name in target
            })
        return {
            "POSITION": self.file.accessor(names["POSITION"]),
            "NORMAL": self.file.accessor(names["NORMAL"]) if "NORMAL" in names else None,
            "influences": influences,
            "targets": targets,
        }

    def animated(self, clip, time):
        """(node, path) → value."""
        values = {}
        if clip is None:
            return values
        animation = self.file.list("animations")[clip]
        for channel in animation["channels"]:
            sampler, target = animation["samplers"][channel["sampler"]], channel["target"]
            if "node" not in target:
                continue
            times = [row[0] for row in self.file.accessor(sampler["input"])]
            flat = [x for row in self.file.accessor(sampler["output"]) for x in row]
            mode = sampler.get("interpolation", "LINEAR")
            width = len(flat) // len(times) // (3 if mode == "CUBICSPLINE" else 1)
            path = target["path"]
            values[(target["node"], path)] = sample(times, flat, width, mode,
                                                    path == "rotation", time)
        return values

    def globals(self, values):
        done = {}

        def of(index):
            if index in done:
                return done[index]
            node = self.nodes[index]
            if "matrix" in node:
                local = from_columns(node["matrix"])
            else:
                defaults = (("translation", [0, 0, 0]), ("rotation", [0, 0, 0, 1]),
                            ("scale", [1, 1, 1]))
                local = from_trs(*(values.get((index, path), node.get(path, default))
                                   for path, default in defaults))
            if index in self.parents:
                local = multiply(of(self.parents[index]), local)
            done[index] = local
            return local

        return [of(index) for index in range(len(self.nodes))]

    def pose(self, clip, time):
        values = self.animated(clip, time)
        matrices = self.globals(values)
        positions, normals = [], []
        for index, node in enumerate(self.nodes):
            if "mesh" not in node or index not in self.shown:
                continue
            mesh = self.file.list("meshes")[node["mesh"]]
            primitives = self.primitives[node["mesh"]]
            count = max((len(p["targets"]) for p in primitives), default=0)
            weights = values.get((index, "weights"),
                                 node.get("weights", mesh.get("weights", [0.0] * count)))
            bones = None
            if "skin" in node:
                joints, binds = self.skins[node["skin"]]
                bones = [matrices[j] if binds is None else multiply(matrices[j], binds[k])
                         for k, j in enumerate(joints)]
            for primitive in primitives:
                self.deform(primitive, weights, bones, matrices[index], positions, normals)
        return {"positions": positions, "normals": normals}

    @staticmethod
    def deform(primitive, weights, bones, own, positions, normals):
        for v, position in enumerate(primitive["POSITION"]):
            normal = primitive["NORMAL"][v] if primitive["NORMAL"] else None
            for target, weight in zip(primitive["targets"], weights):
                if weight and v in target.get("POSITION", ()):
                    position = [x + weight * d for x, d in zip(position, target["POSITION"][v])]
                if weight and normal and v in target.get("NORMAL", ()):
                    normal = [x + weight * d for x, d in zip(normal, target["NORMAL"][v])]
            matrix = own
            if bones is not None and primitive["influences"]:
                matrix = [[0.0] * 4 for _ in range(3)]
                for joint, weight in primitive["influences"][v]:
                    for row, other in zip(matrix, bones[joint]):
                        for k in range(4):
                            row[k] += weight * other[k]
            x, y, z = position
            positions.append([r[0] * x + r[1] * y + r[2] * z + r[3] for r in matrix])
            normals.append(transform_normal(matrix, normal) if normal else None)


def transform_normal(m, n):
    """The inverse transpose by Cramer's rule, normalised; None where the matrix is singular."""
    a, b, c = ([row[k] for row in m] for k in range(3))

    def cross(u, v):
        return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]

    columns = (cross(b, c), cross(c, a), cross(a, b))
    determinant = sum(x * y for x, y in zip(a, columns[0]))
    if determinant == 0.0:
        return None
    out = [sum(columns[k][i] * n[k] for k in range(3)) / determinant for i in range(3)]
    return normalized(out) if any(out) else None


def main():
    path, clip, times = sys.argv[1], sys.argv[2], [float(t) for t in sys.argv[3:]]
    character = Character(File(path))
    clip = None if clip == "rest" else int(clip)
    json.dump({"poses": [character.pose(clip, time) for time in times]}, sys.stdout)


if __name__ == "__main__":
    main()
