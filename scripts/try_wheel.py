"""Try a wheel in an environment of its own: its size, the time of a first use, speed and results beside Numba's.

    python -m scripts.try_wheel dist/cutenv-0.1.0-cp311-abi3-manylinux_2_17_x86_64.whl

Installs the wheel alone, without extras. Prints what it brings; how long every task takes from import to the end of the
first step in a new process; how fast its batches are beside those that this checkout compiles, in turns; and whether
the specimens of 1000 seeds are cut to the same bits. Fails if not. Keeps what it prints in runs/wheel.txt.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from cutenv._base.output import atomic_write
from cutenv.task.registry import TASKS

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "runs" / "wheel.txt"
SEEDS, BATCH, MANY, TIMES, TURNS = 1000, 64, 1024, 3, 7
USE = """
import time
start = time.perf_counter()
import gymnasium, cutenv
env = gymnasium.{made}
env.reset(seed=0)
env.step(env.action_space.sample())
print(time.perf_counter() - start)
import sys
assert "numba" not in sys.modules
"""
SPEED = """
import time, gymnasium, numpy as np, cutenv
env = gymnasium.make_vec({task!r}, num_envs={count})
env.reset(seed=0)
actions = np.full(env.action_space.shape, 0.3, np.float32)
times = []
for _ in range(120):
    start = time.perf_counter()
    env.step(actions)
    times.append(time.perf_counter() - start)
print(1e6 * min(times))
"""


def main() -> int:
    """Install, measure and compare; return 1 if a result differs."""
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    with tempfile.TemporaryDirectory() as folder:
        venv = Path(folder, "venv")
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True)
        python = venv / "bin" / "python"
        install = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-compile"]
        subprocess.run([*install, "--constraint", ROOT / "constraints.txt", Path(sys.argv[1]).resolve()], check=True)
        lines, same = [], True
        parts = _sizes(venv), _first_uses(python, folder), _speeds(python, folder), _bits(python, folder)
        for line, good in chain.from_iterable(parts):
            print(line, flush=True)
            lines.append(line)
            same &= good
    KEPT.parent.mkdir(exist_ok=True)
    with atomic_write(KEPT) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return int(not same)


Line = tuple[str, bool]  # a line, and whether it tells of nothing wrong


def _sizes(venv: Path) -> Iterator[Line]:
    """Yield the sizes of the largest packages, and of all."""
    packages = next(venv.glob("lib/python3*/site-packages"))
    for package in sorted(packages.iterdir(), key=_size, reverse=True)[:6]:
        yield f"{package.name:24} {_size(package) / 1e6:6.1f} MB", True
    yield f"{'all that is installed':24} {_size(packages) / 1e6:6.1f} MB", True


def _first_uses(python: Path, folder: str) -> Iterator[Line]:
    """Yield the times from import to the end of the first step."""
    for task in TASKS.values():
        for made in (f"make({task.id!r})", f"make_vec({task.id!r}, num_envs={BATCH})"):
            times = [float(_output(python, folder, "-c", USE.format(made=made))) for _ in range(TIMES)]
            yield f"{made:48} first step after {times[0]:.2f} s, in the next process {min(times[1:]):.2f} s", True


def _speeds(python: Path, folder: str) -> Iterator[Line]:
    """Yield how long a step of a batch takes, beside one with kernels that Numba has compiled here."""
    for name in ("gentle", "depth", "path"):
        program = SPEED.format(task=TASKS[name].id, count=MANY)
        built, compiled = [], []
        for _ in range(TURNS):
            built.append(float(_output(python, folder, "-c", program)))
            compiled.append(float(_output(Path(sys.executable), str(ROOT), "-c", program, CUTENV_COMPILE="1")))
        ratio = min(compiled) / min(built)
        times = f"{min(built):.0f} us, by Numba {min(compiled):.0f}"
        yield f"{name}: a step of a batch of {MANY} takes {times}; {ratio:.2f} of its speed", True


def _bits(python: Path, folder: str) -> Iterator[Line]:
    """Yield whether results are equal to those of Numba."""
    command = str(ROOT / "scripts/validation/physics/same_bits.py"), "--digests", str(SEEDS)
    built = json.loads(_output(python, folder, *command))
    compiled = json.loads(_output(Path(sys.executable), str(ROOT), *command, CUTENV_COMPILE="1"))
    for name, digest in built.items():
        same = compiled[name] == digest
        yield f"{name:24} {digest}  {'the same bits' if same else 'OTHER BITS'}", same


def kept() -> str:
    """Return what the last trial printed, for a page; SystemExit if there was none."""
    if not KEPT.is_file():
        raise SystemExit(f"{KEPT} is missing; run 'python -m scripts.try_wheel WHEEL' first.")
    return f"```\n{KEPT.read_text(encoding='utf-8').rstrip()}\n```"


def _size(path: Path) -> int:
    """Return the bytes of a file, or of all in a folder."""
    return path.stat().st_size if path.is_file() else sum(each.stat().st_size for each in path.rglob("*.*"))


def _output(python: Path, folder: str, *command: str, **environment: str) -> str:
    done = subprocess.run(
        [python, *command], cwd=folder, env=os.environ | environment, stdout=subprocess.PIPE, text=True, check=True
    )
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
