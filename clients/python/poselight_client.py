"""Client of the Poselight service: one file, standard library only (numpy where it is there).

    from poselight_client import Client
    client = Client("http://127.0.0.1:7878")
    job = client.bake("hero.glb", {"version": 1, "bake": {"rays": 64}})
    model = job["result"]["model"]
    client.download(model, "hero.safetensors")
    shape, values = client.evaluate(model, {"poses": [{"joints": {}}]})

What the service puts off (429, 503) is asked for again when it says; what it refuses is a `Problem`,
what does not reach it an `OSError`.
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


# Answers that another attempt may change: the rate, the queue, or a service that is about to be ready.
LATER = (429, 502, 503, 504)


class Problem(Exception):
    """What the service refused, as it said it (RFC 9457)."""

    def __init__(self, document: Json, retry_after_s: Optional[float] = None):
        self.document = document
        self.status = int(document.get("status") or 0)
        self.retry_after_s = retry_after_s
        pointers = [error.get("pointer", "") for error in document.get("errors", [])]
        detail = str(document.get("detail", "the service gave no reason"))
        self.pointer: Optional[str] = pointers[0] if pointers else None
        super().__init__(detail)

    @property
    def is_for_later(self) -> bool:
        """Whether the same request may succeed when it is sent again."""
        return self.status in LATER or self.document.get("type") == "/problems/key-in-use"


class Client:
    """One service. Safe to make anew at any time; holds no connection between calls. What the service
    puts off is tried again for `patience_s`."""

    def __init__(self, server: str = "http://127.0.0.1:7878", token: Optional[str] = None,
                 timeout_s: float = 60.0, patience_s: float = 120.0):
        fault = ValueError(f"{server!r} is no address such as http://127.0.0.1:7878")
        try:
            url = urllib.parse.urlsplit(server)
            sound = url.scheme in ("http", "https") and url.hostname and url.port != 0
        except ValueError:
            raise fault from None
        if not sound:
            raise fault
        self._url, self._token, self._timeout_s, self._patience_s = url, token, timeout_s, patience_s

    def _request(self, method: str, path: str, body: Union[bytes, BinaryIO, None] = None,
                 headers: Optional[Mapping[str, str]] = None) -> http.client.HTTPResponse:
        start, pause_s = time.monotonic(), 0.5
        while True:
            try:
                return self._attempt(method, path, body, headers)
            except Problem as problem:
                wait_s = problem.retry_after_s if problem.retry_after_s is not None else pause_s
                late = time.monotonic() + wait_s - start > self._patience_s
                if late or not problem.is_for_later:
                    raise
            time.sleep(wait_s)
            pause_s = min(2 * pause_s, 10.0)
            if body is not None and not isinstance(body, bytes):
                body.seek(0)

    def _attempt(self, method: str, path: str, body: Union[bytes, BinaryIO, None],
                 headers: Optional[Mapping[str, str]]) -> http.client.HTTPResponse:
        kind = http.client.HTTPSConnection if self._url.scheme == "https" else http.client.HTTPConnection
        connection = kind(self._url.hostname or "", self._url.port, timeout=self._timeout_s)
        own = dict(headers or {}, Connection="close")
        if self._token:
            own["Authorization"] = f"Bearer {self._token}"
        try:
            connection.connect()
        except (OSError, UnicodeError) as error:
            raise ConnectionError(f"{self._url.geturl()} does not answer: {error}") from error
        try:
            connection.request(method, self._url.path.rstrip("/") + path, body=body, headers=own)
        except ConnectionError:
            # A body that is refused by its length is not read to its end, but it is answered.
            pass
        response = connection.getresponse()
        if response.status >= 400:
            raise _problem(response)
        return response

    def _json(self, method: str, path: str, document: Optional[Json] = None,
              headers: Optional[Mapping[str, str]] = None) -> Any:
        body = None if document is None else json.dumps(document, allow_nan=False).encode()
        with self._request(method, path, body, headers) as response:
            return _read_json(response)

    def upload(self, path: str) -> str:
        """Uploads a file, unless the service has it; its SHA-256."""
        digest = hashlib.sha256()
        with open(path, "rb") as file:
            for chunk in iter(lambda: file.read(1 << 20), b""):
                digest.update(chunk)
            sha256 = digest.hexdigest()
            query = urllib.parse.urlencode({"name": os.path.basename(path)})
            known = self._kind(sha256)
            if known is None:
                file.seek(0)
                size = str(os.fstat(file.fileno()).st_size)
                self._request("PUT", f"/v1/assets/{sha256}?{query}", file, {"Content-Length": size}).close()
        return sha256

    def forget(self, sha256: str) -> None:
        """Deletes an asset, which makes room for others; a job that has not ended may not need it."""
        self._request("DELETE", f"/v1/assets/{sha256}").close()

    def _kind(self, sha256: str) -> Optional[str]:
        """The kind of an asset that the service has."""
        place = f"/v1/assets/{sha256}"
        try:
            with self._request("HEAD", place) as response:
                return response.getheader("poselight-kind")
        except Problem as problem:
            if problem.status == 404:
                return None
            # A refusal of `HEAD` has no sentence; that of the first byte has.
            self._request("GET", place, None, {"Range": "bytes=0-0"}).close()
            raise

    def scene(self, path: str) -> Tuple[Json, str]:
        """Uploads a scene with its files, as one file, a glTF with its buffers and images, or a zip of
        them: `assets` of a job, and which of them is the scene."""
        name, folder = os.path.basename(path), os.path.dirname(path)
        if name.lower().endswith(".zip"):
            return self._archive(path)
        assets = {name: self.upload(path)}
        if name.lower().endswith(".gltf"):
            document = _load(path)
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
            assets = _read_json(response)["files"]
        scenes = [name for name in assets if name.lower().endswith((".gltf", ".glb", ".obj", ".npz"))]
        if len(scenes) != 1:
            raise OSError(f"{path} has {len(scenes)} scenes: submit the one that is meant")
        return assets, scenes[0]

    def submit(self, assets: Mapping[str, str], recipe: Json, key: Optional[str] = None, priority: int = 0,
               kind: str = "run") -> Any:
        """Submits a job on a scene, `run` or `bake`; with a key it can be repeated safely."""
        return self.start(kind, recipe, key, priority=priority, assets=dict(assets))

    def plan(self, assets: Mapping[str, str], recipe: Json, kind: str = "run") -> Any:
        """What a job on a scene would cost: rays, memory, disk and time. Nothing is submitted."""
        request = {"kind": kind, "recipe": recipe, "assets": dict(assets)}
        return self._json("POST", "/v1/jobs?dry_run=true", request)

    def start(self, kind: str, recipe: Json, key: Optional[str] = None, **fields: Any) -> Any:
        """Submits a job of any kind: `fit`, `tradeoff` and `effort` on a `dataset`, `measure` on a `model`."""
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
        """Events of a job to its end, as (kind, data); goes on where a connection was cut. However long
        the job is silent, it gives up only when the service did not answer for `patience_s`."""
        last = "0"
        lost: Optional[float] = None
        while True:
            try:
                with self._request("GET", f"/v1/jobs/{job}/events", None, {"Last-Event-ID": last}) as response:
                    lost = None
                    for name, event_id, data in _events(response):
                        last = event_id
                        yield name, data
                        if name == "state" and data["state"] in FINAL:
                            return
            except (Problem, OSError, http.client.HTTPException) as error:
                # From the first attempt in vain: what was heard before it is no part of the outage.
                lost = time.monotonic() if lost is None else lost
                if not _may_pass(error) or time.monotonic() - lost > patience_s:
                    raise
            if self._ended(job):
                return
            time.sleep(0.5)

    def _ended(self, job: str) -> bool:
        try:
            return self.job(job)["state"] in FINAL
        except (Problem, OSError, http.client.HTTPException) as error:
            if not _may_pass(error):
                raise
            return False

    def bake(self, scene: str, recipe: Json, progress: Any = None) -> Any:
        """Uploads, submits and follows; the finished job."""
        assets, recipe = self.prepare(scene, recipe)
        return self.finish(self.submit(assets, recipe)["id"], progress)

    def prepare(self, scene: str, recipe: Json) -> Tuple[Json, Json]:
        """Uploads a scene; its files, and the recipe that names the main one."""
        assets, file = self.scene(scene)
        return assets, {**recipe, "scene": {**recipe.get("scene", {}), "file": file}}

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


def _problem(response: http.client.HTTPResponse) -> Problem:
    body = response.read()
    document: Any = None
    try:
        document = json.loads(body)
    except ValueError:
        pass
    if not isinstance(document, dict):
        document = {"detail": f"{response.status} {response.reason}"}
    wait = response.getheader("Retry-After") or ""
    seconds = float(wait) if wait.isascii() and wait.isdigit() else None
    return Problem({"status": response.status, **document}, seconds)


def _read_json(response: http.client.HTTPResponse) -> Any:
    try:
        return json.load(response)
    except ValueError:
        raise OSError("the answer is no JSON: is it Poselight that answers there?") from None


def _load(path: str) -> Any:
    """A JSON object from a file."""
    try:
        with open(path, encoding="utf-8") as file:
            document = json.load(file)
    except ValueError as error:
        raise ValueError(f"{path} is no JSON: {error}") from None
    if not isinstance(document, dict):
        raise ValueError(f"{path} is no JSON object")
    return document


def _may_pass(error: Exception) -> bool:
    """Whether a fault may be gone at the next attempt: all but what the service refused for good."""
    return error.is_for_later if isinstance(error, Problem) else True


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
    recipe: Any = _load(args.recipe) if args.recipe else {"version": 1}
    for part, field, value in (
        ("bake", "rays", args.rays),
        ("poses", "rate_hz", args.fps),
        ("poses", "hold_out", args.hold_out),
        ("target", "reference_poses", args.reference_poses),
    ):
        if value is not None:
            recipe.setdefault(part, {})[field] = value
    return recipe


def _show_plan(plan: Json) -> None:
    print(f"{plan['poses']} poses of {plan['points']} points, {plan['rays']} rays")
    for name, value in plan.items():
        if name.endswith("_bytes"):
            print(f"{name[:-6]}: {value / 2**20:.0f} MiB")
        elif name.endswith("_per_s"):
            print(f"{name[:-6]}: about {value / 1e6:.1f} million a second")
        elif name.endswith("_s"):
            print(f"{name[:-2]}: about {value:.0f} s")
    for notice in plan.get("notices", []):
        print(f"note: {notice}")


def _follow(client: Client, job: str) -> Any:
    """Follows a job to its end; who stops looking is told that it goes on."""
    shown = sys.stderr.isatty()
    try:
        return client.finish(job, _show if shown else None)
    except KeyboardInterrupt:
        print(f"\nthe job goes on; to look again or to end it:\n  {_COMMAND} watch {job}\n"
              f"  {_COMMAND} cancel {job}", file=sys.stderr)
        raise
    finally:
        if shown:
            print(file=sys.stderr)


def _bake(client: Client, args: argparse.Namespace) -> None:
    assets, recipe = client.prepare(args.scene, _recipe(args))
    if args.dry_run:
        return _show_plan(client.plan(assets, recipe))
    job = client.submit(assets, recipe)["id"]
    print(f"job {job}", file=sys.stderr)
    model = _follow(client, job)["result"]["model"]
    client.download(model, args.output)
    if args.clip:
        times = [frame / (args.fps or 30.0) for frame in range(args.frames)]
        file = recipe["scene"]["file"]
        clip = {"assets": assets, "file": file, "name": args.clip, "times_s": times}
        shape, values = client.evaluate(model, {"clip": clip})
        with open(args.values, "wb") as out:
            out.write(values.tobytes())
        print(f"{args.values} {list(shape)}")
    print(f"{args.output} {model}")


def _watch(client: Client, args: argparse.Namespace) -> None:
    print(json.dumps(_follow(client, args.job)["result"]))


def _cancel(client: Client, args: argparse.Namespace) -> None:
    print(f"{args.job} is {client.cancel(args.job)['state']}")


_COMMAND = "python -m poselight_client"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=_COMMAND, description=(__doc__ or "").splitlines()[0],
                                     epilog="A token comes by the environment: POSELIGHT_TOKEN.")
    parser.add_argument("--server", default=os.environ.get("POSELIGHT_SERVER", "http://127.0.0.1:7878"),
                        help="where the service is; or the environment's POSELIGHT_SERVER")
    commands = parser.add_subparsers(required=True, dest="command", metavar="COMMAND")
    bake = commands.add_parser("bake", help="upload a scene, follow its job, download the model")
    bake.add_argument("scene", help="a .glb, .gltf, .obj or .npz, or a zip of one with its files")
    bake.add_argument("-o", "--output", metavar="FILE.safetensors")
    bake.add_argument("--recipe", metavar="FILE.json", help="what the flags below do not say")
    bake.add_argument("--rays", type=int, help="rays per vertex and pose")
    bake.add_argument("--fps", type=float, help="poses per second of clip; also frames of --clip")
    bake.add_argument("--hold-out", action="append", metavar="CLIP", help="keep a clip from training")
    bake.add_argument("--reference-poses", type=int, metavar="N", help="poses that measure the model")
    bake.add_argument("--dry-run", action="store_true", help="only say what it would cost")
    bake.add_argument("--clip", help="also evaluate this clip")
    bake.add_argument("--frames", type=int, default=1, help="frames of the clip, --fps or 30 a second")
    bake.add_argument("--values", default="values.f32", help="where the clip's values go, raw f32")
    bake.set_defaults(run=_bake)
    for name, run, what in (("watch", _watch, "follow a job to its end; print its result"),
                            ("cancel", _cancel, "ask a job to stop")):
        command = commands.add_parser(name, help=what)
        command.add_argument("job")
        command.set_defaults(run=run)
    return parser


def main() -> int:
    """The command line; its exit status."""
    parser = _parser()
    args = parser.parse_args()
    if args.command == "bake" and not (args.output or args.dry_run):
        parser.error("bake needs -o FILE.safetensors, or --dry-run")
    try:
        # A token comes by the environment, where no list of processes shows it.
        args.run(Client(args.server, os.environ.get("POSELIGHT_TOKEN")), args)
    except (Problem, OSError, ValueError, http.client.HTTPException) as error:
        print(f"error: {error or type(error).__name__}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
