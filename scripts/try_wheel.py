"""Try a wheel in an environment of its own: its size, the time of a first use, and its results beside this checkout's.

    python scripts/try_wheel.py dist/cutenv-0.1.0-cp311-abi3-manylinux_2_17_x86_64.whl

Installs the wheel alone, without extras; prints what it brings, how long every task takes from import to the end of the
first step in a new process, and whether the specimens of 1000 seeds are cut to the same bits as by Numba. Fails if not.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from cutenv.task.registry import TASKS

ROOT = Path(__file__).parents[1]
SEEDS, BATCH, TIMES = 1000, 64, 3
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
        packages = next(venv.glob("lib/python3*/site-packages"))
        for package in sorted(packages.iterdir(), key=_size, reverse=True)[:6]:
            print(f"{package.name:24} {_size(package) / 1e6:6.1f} MB")
        print(f"{'all':24} {_size(packages) / 1e6:6.1f} MB")
        for task in TASKS.values():
            for made in (f"make({task.id!r})", f"make_vec({task.id!r}, num_envs={BATCH})"):
                times = [float(_output(python, folder, "-c", USE.format(made=made))) for _ in range(TIMES)]
                print(f"{made:48} first {times[0]:.2f} s, then {min(times[1:]):.2f}", flush=True)
        same_bits = str(ROOT / "scripts" / "same_bits.py"), "--digests", str(SEEDS)
        built = json.loads(_output(python, folder, *same_bits))
        compiled = json.loads(_output(Path(sys.executable), str(ROOT), *same_bits, CUTENV_COMPILE="1"))
    for name, digest in built.items():
        print(f"{name:24} {digest}  {'the same bits' if compiled[name] == digest else 'OTHER BITS'}")
    return int(built != compiled)


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
