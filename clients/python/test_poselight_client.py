"""Proves what the client makes of a service that puts it off, breaks off or is none: by one whose answers
are written down here. What a real one answers is tested with it."""

import http.server
import io
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path
from unittest import mock

import poselight_client
from poselight_client import Client, Problem

EVENTS = 'id: 1\nevent: state\ndata: {"state": "running"}\n\n'
END = 'id: 2\nevent: state\ndata: {"state": "succeeded"}\n\n'
DONE = {"id": "j", "state": "succeeded", "result": {"model": "m"}}


def refusal(status, wait=None, **fields):
    headers = {} if wait is None else {"Retry-After": str(wait)}
    return status, {"detail": "not now", **fields}, headers


class Script:
    """Answers requests by their path, each with the next of its answers, the last one for ever."""

    def __init__(self, answers):
        script, self.seen = self, []
        answers = {path: list(list_) for path, list_ in answers.items()}

        class Handler(http.server.BaseHTTPRequestHandler):
            def answer(self):
                path = self.path.split("?")[0]
                self.rfile.read(int(self.headers.get("Content-Length") or 0))
                script.seen.append((time.monotonic(), self.command, path, dict(self.headers)))
                left = answers[path]
                status, body, headers = left.pop(0) if len(left) > 1 else left[0]
                body = body.encode() if isinstance(body, str) else json.dumps(body).encode()
                self.send_response(status)
                for name, value in headers.items():
                    self.send_header(name, value)
                self.end_headers()
                self.wfile.write(body)

            do_GET = do_POST = do_PUT = do_HEAD = answer

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"
        threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True).start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.server.shutdown()
        self.server.server_close()


def run(*words):
    """The command line in this process: its status and what it said."""
    said = io.StringIO()
    with mock.patch.object(sys, "argv", ["poselight_client", *words]):
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            try:
                status = poselight_client.main()
            except SystemExit as end:
                status = end.code
    return status, said.getvalue()


class Patience(unittest.TestCase):
    def test_a_job_is_followed_through_refusals_and_cuts(self):
        """Put off with and without a time, cut off, and put off again: each event comes once."""
        events = [refusal(503), (200, EVENTS, {}), refusal(429, 0), (200, EVENTS[:20], {}), (200, END, {})]
        jobs = [refusal(503, 0), (200, {"state": "running"}, {})]
        with Script({"/v1/jobs/j/events": events, "/v1/jobs/j": jobs}) as script:
            told = list(Client(script.url).follow("j"))
            self.assertEqual([data["state"] for _, data in told], ["running", "succeeded"])
            last = [headers["Last-Event-ID"] for _, _, path, headers in script.seen if path.endswith("events")]
            self.assertEqual((last[0], last[-1]), ("0", "1"))

    def test_silence_is_no_outage(self):
        """A job that tells nothing for longer than the patience, and then a cut: it is followed on."""
        events = [(200, EVENTS + ": alive\n\n", {}), refusal(503, 0), (200, END, {})]
        with Script({"/v1/jobs/j/events": events, "/v1/jobs/j": [(200, {"state": "running"}, {})]}) as script:
            # Between two looks passes half a second.
            told = list(Client(script.url, patience_s=0).follow("j", patience_s=0.3))
            self.assertEqual([data["state"] for _, data in told], ["running", "succeeded"])

    def test_an_outage_is_not_waited_out_for_ever(self):
        events = [(200, EVENTS, {}), refusal(503, 0)]
        with Script({"/v1/jobs/j/events": events, "/v1/jobs/j": [refusal(503, 0)]}) as script:
            with self.assertRaises(Problem):
                list(Client(script.url, patience_s=0).follow("j", patience_s=0.3))
            self.assertEqual(sum(path.endswith("events") for _, _, path, _ in script.seen), 3)

    def test_a_refused_upload_says_why(self):
        """The service's own sentence, though the first request is one whose answer has no body."""
        with tempfile.NamedTemporaryFile(suffix=".obj") as file:
            import hashlib
            path = "/v1/assets/" + hashlib.sha256(b"").hexdigest()
            with Script({path: [refusal(401, detail="the token is unknown or has expired")]}) as script:
                with self.assertRaises(Problem) as caught:
                    Client(script.url, "psl_0").upload(file.name)
                self.assertEqual(str(caught.exception), "the token is unknown or has expired")
                self.assertEqual(caught.exception.status, 401)
                self.assertNotIn("PUT", [method for _, method, *_ in script.seen])

    def test_the_time_that_is_told_is_waited(self):
        with Script({"/v1/jobs/j": [refusal(429, 1), (200, DONE, {})]}) as script:
            self.assertEqual(Client(script.url).job("j"), DONE)
            first, second = (at for at, *_ in script.seen)
            self.assertGreaterEqual(second - first, 1.0)

    def test_patience_ends(self):
        with Script({"/v1/jobs/j": [refusal(503, 30)]}) as script:
            with self.assertRaises(Problem) as caught:
                Client(script.url, patience_s=1.0).job("j")
            self.assertEqual((caught.exception.status, caught.exception.retry_after_s), (503, 30.0))
            self.assertEqual(len(script.seen), 1)

    def test_what_is_refused_for_good_is_told_at_once(self):
        with Script({"/v1/jobs/j/events": [refusal(404)], "/v1/jobs/j": [refusal(404)]}) as script:
            with self.assertRaises(Problem):
                list(Client(script.url).follow("j"))
            self.assertEqual(len(script.seen), 1)

    def test_an_upload_that_is_put_off_is_sent_whole(self):
        with tempfile.NamedTemporaryFile(suffix=".obj") as file:
            file.write(b"v 0 0 0\n" * 100)
            file.flush()
            import hashlib
            path = "/v1/assets/" + hashlib.sha256(b"v 0 0 0\n" * 100).hexdigest()
            with Script({path: [refusal(404), refusal(503, 0), (201, {}, {})]}) as script:
                Client(script.url).upload(file.name)
                self.assertEqual([method for _, method, *_ in script.seen], ["HEAD", "PUT", "PUT"])
                self.assertEqual(script.seen[-1][3]["Content-Length"], "800")


class CommandLine(unittest.TestCase):
    """Every fault is a sentence and a status, none of them a traceback."""

    def test_faults_are_sentences(self):
        with tempfile.TemporaryDirectory() as folder:
            scene, bad, odd = (Path(folder) / name for name in ("a.obj", "bad.json", "odd.json"))
            scene.write_text("v 0 0 0")
            bad.write_text("{")
            odd.write_text("[]")
            for words, said in [
                (["--server", "ftp://a", "bake", str(scene), "-o", "x"], "is no address"),
                (["--server", "http://a:port", "bake", str(scene), "-o", "x"], "is no address"),
                (["--server", "http://127.0.0.1:1", "bake", str(scene), "-o", "x"], "does not answer"),
                (["bake", str(scene), "-o", "x", "--recipe", str(bad)], "is no JSON"),
                (["bake", str(scene), "-o", "x", "--recipe", str(odd)], "is no JSON object"),
                (["--server", "http://127.0.0.1:1", "bake", "nowhere.glb", "-o", "x"], "nowhere.glb"),
            ]:
                status, text = run(*words)
                self.assertEqual(status, 1, text)
                self.assertIn(said, text)
                self.assertNotIn("Traceback", text)
            self.assertEqual(run("bake", str(scene))[0], 2)
            self.assertEqual(run()[0], 2)

    def test_a_plan_is_in_words(self):
        plan = {"poses": 2, "points": 3, "rays": 4, "rays_per_s": 675539.0, "bake_s": 12.4, "disk_bytes": 2**20}
        with tempfile.TemporaryDirectory() as folder:
            scene = Path(folder) / "a.obj"
            scene.write_text("v 0 0 0")
            import hashlib
            asset = "/v1/assets/" + hashlib.sha256(b"v 0 0 0").hexdigest()
            known = [(200, "", {"poselight-kind": "scene"})]
            with Script({asset: known, "/v1/jobs": [(200, plan, {})]}) as script:
                status, text = run("--server", script.url, "bake", str(scene), "--dry-run")
            self.assertEqual(status, 0, text)
            for line in ("bake: about 12 s", "disk: 1 MiB", "rays: about 0.7 million a second"):
                self.assertIn(line, text.splitlines())
            self.assertNotIn("rays_per", text)

    def test_another_server_is_recognised(self):
        with Script({"/v1/jobs/j/cancel": [(200, "<html>", {})]}) as script:
            status, text = run("--server", script.url, "cancel", "j")
            self.assertEqual(status, 1)
            self.assertIn("no JSON", text)

    def test_ctrl_c_says_how_to_go_on(self):
        """The process is started as a user starts it and interrupted while it follows a job."""
        events = [(200, EVENTS, {})]
        with Script({"/v1/jobs/j/events": events, "/v1/jobs/j": [(200, {"state": "running"}, {})]}) as script:
            words = [sys.executable, "-m", "poselight_client", "--server", script.url, "watch", "j"]
            folder = Path(poselight_client.__file__).parent
            # What runs in the background of a shell has Ctrl-C ignored, and so have its children.
            heard = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)
            process = subprocess.Popen(words, cwd=folder, stderr=subprocess.PIPE, text=True, preexec_fn=heard)
            self.addCleanup(process.kill)
            start = time.monotonic()
            while not script.seen and time.monotonic() - start < 30:
                time.sleep(0.05)
            time.sleep(0.2)
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=30)
            self.assertEqual(process.returncode, 130, said)
            self.assertIn("poselight_client cancel j", said)
            self.assertNotIn("Traceback", said)

    def test_a_cancel_is_sent(self):
        with Script({"/v1/jobs/j/cancel": [(202, {"state": "cancelling"}, {})]}) as script:
            status, text = run("--server", script.url, "cancel", "j")
            self.assertEqual((status, text), (0, "j is cancelling\n"))


if __name__ == "__main__":
    os.chdir(Path(__file__).parent)
    unittest.main()
