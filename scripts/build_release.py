"""Build the files of a release in dist/: the documentation first, then sdist and wheels, which hold it.

    python -m scripts.build_release

One wheel is for any system, and requires Numba; for each system of scripts/build_kernels.py there is one with compiled
kernels, which pip prefers there.

Needs ``pip install -e '.[dev]'``. A person uploads the files; this program sends nothing anywhere.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from scripts import ROOT
from scripts.build_kernels import PACKAGE, TARGETS

SITE = ROOT / "assets" / "site"
DIST = ROOT / "dist"
BUILD = ("-m", "build", "--no-isolation", "--outdir", str(DIST))
PLATFORM = "CUTENV_WHEEL_PLATFORM"  # which scripts/kernels/wheel_hook.py reads
FIRST_PAGE = "cutenv/assets/site/index.html"


def run(*arguments: str, **environment: str) -> None:
    """Run a module of this Python in the checkout; SystemExit with its status if it fails."""
    done = subprocess.run([sys.executable, *arguments], cwd=ROOT, env=os.environ | environment, check=False)
    if done.returncode:
        raise SystemExit(done.returncode)


def main() -> None:
    """Build the pages, build the distributions, and check that the wheel holds the pages."""
    if sys.argv[1:]:
        raise SystemExit(__doc__)
    for folder in (SITE, DIST):
        shutil.rmtree(folder, ignore_errors=True)
    run("-m", "mkdocs", "build", "--strict", "--site-dir", str(SITE))
    run(*BUILD)
    with tempfile.TemporaryDirectory() as kernels:
        run("scripts/build_kernels.py", "--out", kernels)
        for name, target in TARGETS.items():
            library = PACKAGE / "_engine" / target.file
            shutil.copyfile(Path(kernels, name, target.file), library)
            try:
                run(*BUILD, "--wheel", **{PLATFORM: target.tag})
            finally:
                library.unlink()
    for wheel in DIST.glob("*.whl"):
        with zipfile.ZipFile(wheel) as archive:
            if FIRST_PAGE not in archive.namelist():
                raise SystemExit(f"{wheel.name} does not hold {FIRST_PAGE}: see [tool.hatch.build] in pyproject.toml.")
    for file in sorted(DIST.iterdir()):
        print(f"{file.relative_to(ROOT)}  {file.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
