"""Client of the Poselight service: one file, standard library only (numpy where it is there).

    from poselight_client import Client
    client = Client("http://127.0.0.1:7878")
    job = client.bake("hero.glb", {"version": 1, "bake": {"rays": 64}})
    model = job["result"]["model"]
    client.download(model, "hero.safetensors")
    shape, values = client.evaluate(model, {"poses": [{"joints": {}}]})
"""

from __future__ import annotations

import argparse
import array
import hashlib
import http.client
import json
import math
import os
import sys
import time
import urllib.parse
import uuid
from typing import Any, BinaryIO, Iterator, Mapping, Optional, Tuple, Union

Json = Mapping[str, Any]
FINAL = ("cancelled", "succeeded", "failed")


class Problem(Exception):
    """What the service refused, as it said it (RFC 9457)."""

    def __init__(self, document: Json):
        self.document = document
        pointers = [error.get("pointer", "") for error in document.get("errors", [])]
        detail = str(document.get("detail", "the service gave no reason"))
        self.pointer: Optional[str] = pointers[0] if pointers else None
        super().__init__(detail)


class Client:
    """One service. Safe to make anew at any time; holds no connection between calls."""

    def __init__(self, server: str = "http://127.0.0.1:7878", token: Optional[str] = None, timeout_s: float = 60.0):
        url = urllib.parse.urlsplit(server)
        if url.scheme not in ("http", "https") or not url.hostname:
            raise ValueError(f"{server!r} is no http address")
        self._url, self._token, self._timeout_s = url, token, timeout_s

    def _request(self, method: str, path: str, body: Union[bytes, BinaryIO, None] = None,
                 headers: Optional[Mapping[str, str]] = None) -> http.client.HTTPResponse:
        kind = http.client.HTTPSConnection if self._url.scheme == "https" else http.client.HTTPConnection
        connection = kind(self._url.hostname or "", self._url.port, timeout=self._timeout_s)
        own = dict(headers or {}, Connection="close")
        if self._token:
            own["Authorization"] = f"Bearer {self._token}"
        connection.request(method, self._url.path.rstrip("/") + path, body=body, headers=own)
        response = connection.getresponse()
        if response.status >= 400:
            raise Problem(_problem(response))
        return response

    def _json(self, method: str, path: str, document: Optional[Json] = None,
              headers: Optional[Mapping[str, str]] = None) -> Any:
        body = None if document is None else json.dumps(document, allow_nan=False).encode()
        with self._request(method, path, body, headers) as response:
            return json.load(response)

    def upload(self, path: str) -> str:
        """Uploads a file, unless the service has it; its SHA-256."""
        digest = hashlib.sha256()
        with open(path, "rb") as file:
            for chunk in iter(lambda: file.read(1 << 20), b""):
                digest.update(chunk)
            sha256 = digest.hexdigest()
            query = urllib.parse.urlencode({"name": os.path.basename(path)})
            try:
                with self._request("HEAD", f"/v1/assets/{sha256}") as response:
                    known = response.getheader("poselight-kind")
            except Problem:
                known = None
            if known is None:
                file.seek(0)
                size = str(os.fstat(file.fileno()).st_size)
                self._request("PUT", f"/v1/assets/{sha256}?{query}", file, {"Content-Length": size}).close()
        return sha256

    def scene(self, path: str) -> Tuple[Json, str]:
        """Uploads a scene with its files, as one file, a glTF with its buffers and images, or a zip of
        them: `assets` of a job, and which of them is the scene."""
        name, folder = os.path.basename(path), os.path.dirname(path)
        if name.lower().endswith(".zip"):
            return self._archive(path)
        assets = {name: self.upload(path)}
        if name.lower().endswith(".gltf"):
            with open(path, encoding="utf-8") as file:
                document = json.load(file)
            parts = [*document.get("buffers", []), *document.get("images", [])]
            uris = [part["uri"] for part in parts if not part.get("uri", "data:").startswith("data:")]
            for uri in map(urllib.parse.unquote, uris):
                assets[uri] = self.upload(os.path.join(folder, uri))
        return assets, name

    def _archive(self, path: str) -> Tuple[Json, str]:
        with open(path, "rb") as file:
            data = file.read()
        place = f"/v1/assets/{hashlib.sha256(data).hexdigest()}?name=scene.zip"
        with self._request("PUT", place, data) as response:
            assets = json.load(response)["files"]
        scenes = [name for name in assets if name.lower().endswith((".gltf", ".glb", ".obj", ".npz"))]
        if len(scenes) != 1:
            raise OSError(f"{path} has {len(scenes)} scenes: submit the one that is meant")
        return assets, scenes[0]

    def submit(self, assets: Mapping[str, str], recipe: Json, key: Optional[str] = None, priority: int = 0,
               kind: str = "run") -> Any:
        """Submits a job on a scene, `run` or `bake`; with a key it can be repeated safely."""
        return self.start(kind, recipe, key, priority=priority, assets=dict(assets))

    def start(self, kind: str, recipe: Json, key: Optional[str] = None, **fields: Any) -> Any:
        """Submits a job of any kind: `fit` and `tradeoff` on a `dataset`, `measure` on a `model`."""
        request = {"kind": kind, "recipe": recipe, **fields}
        return self._json("POST", "/v1/jobs", request, {"Idempotency-Key": key or uuid.uuid4().hex})

    def finish(self, job: str, progress: Any = None) -> Any:
        """Follows a job to its end; the finished job."""
        for event, data in self.follow(job):
            if progress and event == "progress":
                progress(data)
        done = self.job(job)
        if done["state"] != "succeeded":
            raise Problem(done.get("error") or {"detail": f"the job was {done['state']}"})
        return done

    def log(self, job: str) -> Any:
        """The lines of a job's log, each with `at_ms`, `level` and `text`."""
        return self._json("GET", f"/v1/jobs/{job}/log")["lines"]

    def file(self, job: str, name: str) -> bytes:
        """A file of a finished job's result."""
        with self._request("GET", f"/v1/jobs/{job}/files/{name}") as response:
            return response.read()

    def job(self, job: str) -> Any:
        """A job as it is now."""
        return self._json("GET", f"/v1/jobs/{job}")

    def cancel(self, job: str) -> Any:
        """Asks a job to stop."""
        return self._json("POST", f"/v1/jobs/{job}/cancel", {})

    def follow(self, job: str, patience_s: float = 600.0) -> Iterator[Any]:
        """Events of a job to its end, as (kind, data); goes on where a connection was cut."""
        last, alive = "0", time.monotonic()
        while True:
            try:
                with self._request("GET", f"/v1/jobs/{job}/events", None, {"Last-Event-ID": last}) as response:
                    for name, event_id, data in _events(response):
                        last, alive = event_id, time.monotonic()
                        yield name, data
                        if name == "state" and data["state"] in FINAL:
                            return
            except (OSError, http.client.HTTPException):
                if time.monotonic() - alive > patience_s:
                    raise
            if self._ended(job):
                return
            time.sleep(0.5)

    def _ended(self, job: str) -> bool:
        try:
            return self.job(job)["state"] in FINAL
        except (OSError, http.client.HTTPException):
            return False

    def bake(self, scene: str, recipe: Json, progress: Any = None) -> Any:
        """Uploads, submits and follows; the finished job."""
        assets, file = self.scene(scene)
        recipe = {**recipe, "scene": {**recipe.get("scene", {}), "file": file}}
        return self.finish(self.submit(assets, recipe)["id"], progress)

    def download(self, model: str, path: str) -> None:
        """Writes a model's blob to a file, which appears whole or not at all."""
        part = f"{path}.{uuid.uuid4().hex}.part"
        try:
            with self._request("GET", f"/v1/models/{model}/blob") as response, open(part, "wb") as file:
                digest = hashlib.sha256()
                for chunk in iter(lambda: response.read(1 << 20), b""):
                    digest.update(chunk)
                    file.write(chunk)
            if response.getheader("ETag") != f'"{digest.hexdigest()}"':
                raise OSError(f"the download of {model} is not whole")
            os.replace(part, path)
        finally:
            if os.path.exists(part):
                os.remove(part)

    def evaluate(self, model: str, request: Json) -> Tuple[Tuple[int, ...], Any]:
        """Values at poses: their shape, and the numbers as a numpy array where numpy is there."""
        body = json.dumps(request, allow_nan=False).encode()
        raw = {"Accept": "application/octet-stream"}
        with self._request("POST", f"/v1/models/{model}/evaluate", body, raw) as response:
            shape = tuple(int(n) for n in (response.getheader("poselight-shape") or "").split(","))
            data = response.read()
        if len(data) != 4 * math.prod(shape):
            raise OSError("the answer is not whole")
        try:
            import numpy
        except ImportError:
            values = array.array("f", data)
            if sys.byteorder == "big":
                values.byteswap()
            return shape, values
        return shape, numpy.frombuffer(data, "<f4").reshape(shape)


def _problem(response: http.client.HTTPResponse) -> Json:
    body = response.read()
    try:
        document = json.loads(body)
        if isinstance(document, dict):
            return document
    except ValueError:
        pass
    return {"status": response.status, "detail": f"{response.status} {response.reason}"}


def _events(response: http.client.HTTPResponse) -> Iterator[Tuple[str, str, Any]]:
    fields: dict = {}
    for line in iter(response.readline, b""):
        text = line.decode().rstrip("\r\n")
        if not text and "data" in fields:
            yield fields.get("event", "message"), fields.get("id", "0"), json.loads(fields["data"])
        if not text:
            fields = {}
        elif not text.startswith(":"):
            name, _, value = text.partition(":")
            fields[name] = value.removeprefix(" ")


def _show(progress: Json) -> None:
    rays = progress["rays_per_s"] / 1e6
    print(f"\r{progress['stage']:>10} {progress['done']}/{progress['total']} {rays:.1f} Mray/s ", end="", file=sys.stderr)


def _recipe(args: argparse.Namespace) -> Any:
    recipe: Any = {"version": 1}
    if args.recipe:
        with open(args.recipe, encoding="utf-8") as file:
            recipe = json.load(file)
    if args.rays is not None:
        recipe.setdefault("bake", {})["rays"] = args.rays
    return recipe


def _bake(client: Client, args: argparse.Namespace) -> None:
    job = client.bake(args.scene, _recipe(args), _show if sys.stderr.isatty() else None)
    model = job["result"]["model"]
    client.download(model, args.output)
    if args.clip:
        times = [frame / 30.0 for frame in range(args.frames)]
        assets, file = client.scene(args.scene)
        clip = {"assets": assets, "file": file, "name": args.clip, "times_s": times}
        shape, values = client.evaluate(model, {"clip": clip})
        with open(args.values, "wb") as file:
            file.write(values.tobytes())
        print(f"{args.values} {list(shape)}")
    print(f"{args.output} {model}")


def main() -> int:
    parser = argparse.ArgumentParser(prog="poselight_client", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--server", default=os.environ.get("POSELIGHT_SERVER", "http://127.0.0.1:7878"))
    commands = parser.add_subparsers(required=True)
    bake = commands.add_parser("bake", help="upload a scene, follow its job, download the model")
    bake.add_argument("scene")
    bake.add_argument("-o", "--output", required=True, metavar="FILE.safetensors")
    bake.add_argument("--recipe", metavar="FILE.json")
    bake.add_argument("--rays", type=int)
    bake.add_argument("--clip", help="also evaluate this clip")
    bake.add_argument("--frames", type=int, default=1, help="frames of the clip, 30 a second")
    bake.add_argument("--values", default="values.f32", help="where the clip's values go, raw f32")
    args = parser.parse_args()
    try:
        # A token comes by the environment, where no list of processes shows it.
        _bake(Client(args.server, os.environ.get("POSELIGHT_TOKEN")), args)
    except (Problem, OSError, http.client.HTTPException) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
