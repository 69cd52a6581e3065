"""Drives the running service from its own OpenAPI document with schemathesis: no answer may be a
failure of the service, and every answer must be of a status, kind and form that the document declares.

usage: fuzz.py POSELIGHT [EXAMPLES [SEED]]

The service is started in a temporary folder that holds a scene, a finished job and its model, so that
requests reach beyond "there is no such thing"; what deletes is left to ids of its own making.
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "clients" / "python"))
from poselight_client import Client  # noqa: E402

RECIPE = {
    "version": 1,
    "poses": {"rate_hz": 2},
    "bake": {"signal": "transfer", "order": 2, "rays": 1},
    "target": {"reference_poses": 1},
}

# Statuses are held against the document by the tests of the service; here a request that schemathesis
# thinks sound may well be refused, such as a model that is not there.
CHECKS = "not_a_server_error,status_code_conformance,content_type_conformance,response_schema_conformance"


def start(binary: str, folder: pathlib.Path) -> "tuple[subprocess.Popen, str]":
    log = folder / "log"
    command = [binary, "serve", "--data", "data", "--listen", "127.0.0.1:0", "--max-asset-mib", "4"]
    with open(log, "wb") as out:
        service = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=out)
    for _ in range(600):
        text = log.read_text(encoding="utf-8", errors="replace")
        if "address=" in text:
            return service, "http://" + text.split("address=")[1].split()[0]
        if service.poll() is not None:
            break
        time.sleep(0.1)
    raise SystemExit(f"the service does not start: {log.read_text(encoding='utf-8')}")


def settings(job: str, model: str, asset: str) -> str:
    """What is known, where it is only read."""
    known = {"/v1/jobs/{id}": job, "/v1/models/{id}": model}
    lines = []
    for path, identity in known.items():
        lines += ["[[operations]]", f'include-path-regex = "^{path.split("{")[0]}.*"',
                  'exclude-method = "DELETE"', f'parameters = {{ "path.id" = "{identity}" }}', ""]
    lines += ["[[operations]]", 'include-path = "/v1/assets/{sha256}"', 'include-method = "GET"',
              f'parameters = {{ "path.sha256" = "{asset}" }}', ""]
    return "\n".join(lines)


def main() -> int:
    binary = os.path.abspath(sys.argv[1])
    examples = sys.argv[2] if len(sys.argv) > 2 else "100"
    seed = sys.argv[3] if len(sys.argv) > 3 else "1"
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        subprocess.run([binary, "sample", "figure", "-o", "figure.glb"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        service, url = start(binary, folder)
        try:
            client = Client(url)
            job = client.bake(str(folder / "figure.glb"), RECIPE)
            asset = client.upload(str(folder / "figure.glb"))
            (folder / "schemathesis.toml").write_text(settings(job["id"], job["result"]["model"], asset))
            command = [os.path.join(os.path.dirname(sys.executable), "st"), "--config-file", "schemathesis.toml",
                       "run", url + "/openapi.json", "--checks", CHECKS, "--max-examples", examples,
                       "--seed", seed, "--phases", "examples,coverage,fuzzing", "--suppress-health-check", "all",
                       "--request-timeout", "30", "--continue-on-failure", "--warnings", "off"]
            status = subprocess.run(command, cwd=folder, check=False).returncode
            if service.poll() is not None:
                print(f"the service has ended with {service.returncode}", file=sys.stderr)
                return 1
            return status
        finally:
            service.terminate()
            service.wait()
            log = (folder / "log").read_text(encoding="utf-8", errors="replace")
            for line in log.splitlines():
                if "ERROR" in line or "panicked" in line:
                    print(line, file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
