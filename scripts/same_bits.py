"""Check that other machines would compute the same bits: cuts with kernels, NumPy and BLAS for other processors.

    python scripts/same_bits.py

Each setting runs in a separate process: specimens of every class are sampled and cut by random actions for 4 seconds in
192 environments.  Fails if kernels, NumPy or BLAS for the plainest processor of the kind give other observations or
rewards than those for this one.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile

import numpy as np
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

_KERNELS = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
_NUMPY = {"NPY_DISABLE_CPU_FEATURES": " ".join(name for name in __cpu_dispatch__ if __cpu_features__[name])}
SETTINGS = {
    "this processor": {},
    "kernels for the plainest": _KERNELS,
    "NumPy for the plainest": _NUMPY,
    "OpenBLAS for the plainest": {"OPENBLAS_CORETYPE": "Prescott"},
}
STEPS = 200


def digest() -> str:
    """Return the hash of every observation and reward."""
    from cutenv.envs.vector import GentleCutVectorEnv

    content = hashlib.sha256()
    for specimen_class in ("liver", "mixed", "vascular"):
        envs = GentleCutVectorEnv(64, specimen_class=specimen_class)
        content.update(envs.reset(seed=5)[0].tobytes())
        rng = np.random.default_rng(0)
        for _ in range(STEPS):
            actions = rng.uniform(-1.0, 1.0, (64, 2)).astype(np.float32)
            actions[:, 0] = np.abs(actions[:, 0])  # forward
            observations, rewards, *_ = envs.step(actions)
            content.update(observations.tobytes() + rewards.tobytes())
    return content.hexdigest()[:16]


def main() -> int:
    """Compare every setting with the first."""
    found: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as kept:
        for number, (name, setting) in enumerate(SETTINGS.items()):
            environment = os.environ | setting | {"NUMBA_CACHE_DIR": f"{kept}/{number}"}
            command = [sys.executable, __file__, "--digest"]
            done = subprocess.run(command, env=environment, capture_output=True, text=True)
            found[name] = done.stdout.strip() if done.returncode == 0 else done.stderr.strip()[-200:]
            same = found[name] == found["this processor"]
            print(f"{name:26} {found[name]}  {'the same bits' if same else 'other bits'}", flush=True)
    return int(len(set(found.values())) > 1)


if __name__ == "__main__":
    if sys.argv[1:] == ["--digest"]:
        print(digest())
    else:
        sys.exit(main())
