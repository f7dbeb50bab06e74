#!/usr/bin/env python3
"""Set up cutenv in .venv, then train an agent or run the tests. Needs nothing but Python.

usage: python3 scripts/start.py COMMAND [--torch-index URL] [--accept-cuda] [--fast | --long] [ARGUMENT ...]

  train   set up what training needs, then run "cutenv train" with the arguments; without any, or with --quick
          (about two minutes), for two tasks side by side
  test    set up everything, and Ray in .venv-ray, then run pytest with the arguments
  setup   set up everything but Ray, and stop

  --fast              with "test": run for about two minutes what concerns a change (scripts/fast_tests.py)
  --long              with "test": run the checks that take hours (scripts/long_checks.py) and go on where they stopped

  --torch-index URL   at the first set-up, take torch from this package index (of CPU builds, for instance)
  --accept-cuda       let pip download CUDA packages on a machine without an NVIDIA driver
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROGRAMS = {"train": ["-m", "cutenv", "train"], "test": ["-m", "pytest", "-n", "2", "--dist", "worksteal"], "setup": []}
TWO_TASKS = ["--task", "gentle", "excision"]
SOONER = ["--timesteps", "3500000"]  # half of what excisions are trained for by default: enough to see them learned
EXTRAS = {"train": "rl", "test": "dev", "setup": "dev"}
"""Extra of pyproject.toml that a command needs; dev holds the others but distributed."""
RAY = "distributed"  # an extra that wants another Gymnasium, and so an environment of its own
CONSTRAINTS = {RAY: "constraints-distributed.txt"}
"""Tested versions of an extra, if they are not those of constraints.txt."""
PYTHON = f"{sys.version_info[0]}.{sys.version_info[1]}"
# Measured with a CPU build of torch: 1.7 GB of .venv, 0.4 GB of downloads that pip holds twice while it works.
DISK_BYTES = 3_000_000_000
UNPACKED = 3  # times its download: what a CUDA package takes in pip's cache, while it is fetched, and unpacked
INTERRUPTED = "installing"

UNREACHABLE = re.compile(
    r"Failed to establish|[Cc]onnection (broken|refused|reset|aborted|error)|[Nn]ame.?[Rr]esolution|timed out"
    r"|ProxyError|SSLError|requirement pip|Cannot install pip "  # every index has pip: no pip is no index
)


class Refusal(Exception):
    """Set-up cannot continue; the message has the reason and the cure."""


def supported_pythons(pyproject: str) -> list[str]:
    """Read the Pythons that work, such as "3.11", from the classifiers: the one place that lists them."""
    return re.findall(r'"Programming Language :: Python :: (3\.\d+)"', pyproject)


def check_python(version: str, implementation: str, supported: list[str]) -> None:
    """Refuse a Python for which a dependency has no wheel."""
    if implementation != "cpython" or version not in supported:
        raise Refusal(
            f"This is {implementation} {version}; all that cutenv needs has wheels for CPython "
            f"{', '.join(supported)}.\n"
            f"Cure: run this script with one of those, such as 'python{supported[0]} scripts/start.py'."
        )


def check_venv_module() -> None:
    """Refuse a Python that cannot make virtual environments, as Debian ships it."""
    if not (importlib.util.find_spec("venv") and importlib.util.find_spec("ensurepip")):
        raise Refusal(
            "This Python has no working 'venv' module.\nCure: on Debian or Ubuntu 'apt install "
            f"python{PYTHON}-venv'; elsewhere, install Python with its whole standard library."
        )


def check_writable(folder: Path) -> None:
    """Refuse a folder in which .venv cannot be made."""
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise Refusal(
            f"{folder} cannot be written to ({error.strerror}).\n"
            "Cure: copy the project to a folder of your own and start there."
        ) from None


def check_disk(free_bytes: int, needed_bytes: int) -> None:
    """Refuse a disk that the installation would fill."""
    if free_bytes < needed_bytes:
        raise Refusal(
            f"Set-up needs {needed_bytes / 1e9:.1f} GB on the disk of {ROOT}; "
            f"{free_bytes / 1e9:.1f} GB are free.\n"
            "Cure: free some space, or move the project to a larger disk."
        )


def fingerprint(root: Path, python: str, constraints: str = "constraints.txt") -> str:
    """Name what an installation depends on: what is asked for, where, and the Python."""
    parts = [(root / name).read_bytes() for name in ("pyproject.toml", constraints)]
    return hashlib.sha256(b"\0".join([*parts, str(root).encode(), python.encode()])).hexdigest()


def python_of(venv: Path) -> str:
    """Return the path of a virtual environment's Python."""
    return str(venv / ("Scripts/python.exe" if os.name == "nt" else "bin/python"))


def state_of(venv: Path, wanted: str, extra: str) -> str:
    """Return whether ``venv`` is "ready", "stale" (install over it) or "broken" (make it again, as if missing)."""
    stamp = venv / "cutenv-setup.txt"
    stamped = stamp.read_text() if stamp.is_file() else ""
    probe = [python_of(venv), "-c", "import pip, sys; print(sys.version)"]
    try:
        answer = subprocess.run(probe, capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return "broken"
    if answer.returncode != 0 or answer.stdout.strip() != sys.version.strip() or stamped == INTERRUPTED:
        return "broken"
    found, _, installed = stamped.partition(" ")
    return "ready" if found == wanted and installed in (extra, "dev") else "stale"


def is_ready(venv: Path, extra: str) -> bool:
    """Return whether ``venv`` is there and has an extra as this checkout asks for it."""
    if not (venv / "cutenv-setup.txt").is_file():
        return False
    wanted = fingerprint(ROOT, sys.version, CONSTRAINTS.get(extra, "constraints.txt"))
    return state_of(venv, wanted, extra) == "ready"


def cure_for(errors: str) -> str:
    """Turn what pip complained of into what the reader can do."""
    if re.search(r"No space left|Errno 28|not enough space", errors):
        return "The disk is full. Cure: free some space, or point TMPDIR and PIP_CACHE_DIR to a larger disk."
    if UNREACHABLE.search(errors):
        return (
            "The package index cannot be reached. Cure: connect to the network and run this again; behind a "
            "proxy or with a mirror, set HTTPS_PROXY or PIP_INDEX_URL."
        )
    missing = re.search(r"No matching distribution found for (\S+)", errors)
    if missing:
        return (
            f"The index has no wheel of {missing[1]} for Python {PYTHON} on this machine. Cure: take another "
            "of the Pythons in pyproject.toml's classifiers, in its 64-bit build, or another index."
        )
    return "pip failed; its own messages are above. Unfinished steps are repeated at the next run."


def pip(venv: Path, *arguments: str) -> None:
    """Run the environment's pip; its errors are shown, with the cure, only if it fails."""
    command = [python_of(venv), "-m", "pip", "--no-input", "--disable-pip-version-check", *arguments]
    done = subprocess.run(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    if done.returncode != 0:
        raise Refusal("\n".join(done.stderr.strip().splitlines()[-12:]) + f"\n\n{cure_for(done.stderr)}")


def cuda_wheels(report: dict) -> list[str]:
    """Return the addresses of the wheels in pip's plan that only an NVIDIA GPU can use, and of torch with them."""
    urls = {item["metadata"]["name"].lower(): item["download_info"]["url"] for item in report["install"]}
    cuda = [name for name in urls if name.startswith(("nvidia-", "cuda-")) or name == "triton"]
    return [urls[name] for name in (*cuda, "torch") if name in urls] if cuda else []


def download_bytes(url: str) -> int:
    """Ask how long the file at ``url`` is, without fetching it."""
    with urllib.request.urlopen(urllib.request.Request(url, method="HEAD"), timeout=20) as answer:
        return int(answer.headers["Content-Length"])


def total_bytes(urls: list[str]) -> int | None:
    """Add up the downloads [bytes]; None if the index does not give their sizes."""
    try:
        with ThreadPoolExecutor(8) as pool:
            return sum(pool.map(download_bytes, urls))
    except (OSError, TypeError, ValueError):
        return None


def check_cuda(report: dict, accepted: bool) -> None:
    """Refuse to download gigabytes for a GPU that is not there, unless that was accepted."""
    driver = Path("/proc/driver/nvidia/version").exists() or shutil.which("nvidia-smi")
    wheels = cuda_wheels(report)
    if not wheels or driver or sys.platform != "linux":
        return
    size = total_bytes(wheels)
    if not accepted:
        shown = f"{size / 1e9:.1f} GB" if size else "gigabytes; the index does not give the size"
        raise Refusal(
            f"This machine has no NVIDIA driver, yet pip would download CUDA packages for torch ({shown}).\n"
            "Cure: add '--torch-index URL' with the address of an index of torch's CPU builds (PyTorch's "
            "page 'Get started' shows it for 'CPU'), or '--accept-cuda' to download them all the same."
        )
    check_disk(shutil.disk_usage(ROOT).free, DISK_BYTES + UNPACKED * (size or 0))


def make_venv(venv: Path) -> None:
    """Make ``venv`` again, with only pip in it."""
    check_disk(shutil.disk_usage(ROOT).free, DISK_BYTES)
    if Path(sys.prefix) == venv:
        raise Refusal(f"{venv.name} is broken and in use. Cure: run this with the Python that it was made from.")
    print(f"cutenv: making {venv.name} with Python {PYTHON}", flush=True)
    command = [sys.executable, "-m", "venv", "--clear", str(venv)]
    made = subprocess.run(command, capture_output=True, text=True)
    if made.returncode != 0:
        raise Refusal(f"{made.stdout}{made.stderr}\n{cure_for(made.stdout + made.stderr)}")


def set_up(venv: Path, extra: str, torch_index: str | None, accept_cuda: bool) -> None:
    """Install cutenv with an extra into ``venv``, as pyproject.toml and the constraints ask; nothing if it is there."""
    constraints = CONSTRAINTS.get(extra, "constraints.txt")
    wanted = fingerprint(ROOT, sys.version, constraints)
    state = state_of(venv, wanted, extra)
    if state == "ready":
        return
    check_venv_module()
    check_writable(ROOT)
    if state == "broken":
        make_venv(venv)
    stamp, plan = venv / "cutenv-setup.txt", venv / "cutenv-plan.json"
    install = ["install", "-c", constraints]
    chosen = ["--only-binary", ":all:", *(["pytest"] if extra == RAY else []), "-e", f".[{extra}]"]
    print("cutenv: asking the package index what is needed", flush=True)
    pip(venv, *install, "--quiet", "pip")  # a Python's own pip may be too old to plan without downloading
    if torch_index:
        stamp.write_text(INTERRUPTED)
        pip(venv, *install, "--no-deps", "--index-url", torch_index, "torch")
    dry_run = ["--quiet", "--dry-run", "--use-feature", "fast-deps", "--report", str(plan)]
    pip(venv, *install, *dry_run, *chosen)
    report = json.loads(plan.read_text(encoding="utf-8"))
    check_cuda(report, accept_cuda)
    print(f"cutenv: installing {len(report['install'])} packages", flush=True)
    stamp.write_text(INTERRUPTED)
    pip(venv, *install, *chosen)
    stamp.write_text(f"{wanted} {extra}")


def main(argv: list[str]) -> int:
    """Set up, then become the program that was asked for."""
    if not argv or argv[0] in ("-h", "--help"):
        print(__doc__)
        return 0
    parser = argparse.ArgumentParser(prog="start.py", add_help=False, allow_abbrev=False)
    parser.add_argument("command", choices=PROGRAMS)
    parser.add_argument("--torch-index", metavar="URL")
    parser.add_argument("--accept-cuda", action="store_true")
    parser.add_argument("--fast", action="append_const", dest="instead", const="scripts.fast_tests")
    parser.add_argument("--long", action="append_const", dest="instead", const="scripts.long_checks")
    options, passed_on = parser.parse_known_args(argv)
    if options.instead and (options.command != "test" or len(options.instead) > 1):
        parser.error("--fast or --long is for the command 'test'")
    venv = ROOT / ".venv"
    explained = bool({"-h", "--help"} & set(passed_on))
    if explained and not is_ready(venv, EXTRAS[options.command]):
        print(f"{__doc__}\nThe options of '{options.command}' itself: the same line again, after 'setup'.")
        return 0
    try:
        supported = supported_pythons((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
        check_python(PYTHON, sys.implementation.name, supported)
        if not explained:
            set_up(venv, EXTRAS[options.command], options.torch_index, options.accept_cuda)
        if options.command == "test" and not explained:
            set_up(ROOT / ".venv-ray", RAY, options.torch_index, options.accept_cuda)
    except Refusal as refusal:
        print(f"\ncutenv: {refusal}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ncutenv: interrupted; the same command starts again", file=sys.stderr)
        return 130
    if options.command == "setup":
        print(f"cutenv: {venv} is ready")
        return 0
    program = ["-m", *options.instead] if options.instead else PROGRAMS[options.command]
    if options.command == "train" and set(passed_on) <= {"--quick"}:
        passed_on = [*(passed_on or SOONER), *TWO_TASKS]
    command = [python_of(venv), *program, *passed_on]
    os.chdir(ROOT)
    sys.stdout.flush()
    if os.name == "nt":
        return subprocess.call(command)
    os.execv(command[0], command)  # become it: an interrupt reaches the program, and nothing is left behind


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
