"""Build the files of a release in dist/: the documentation first, then sdist and wheel, which hold it.

    python scripts/build_release.py

Needs ``pip install -e '.[dev]'``. A person uploads the files; this program sends nothing anywhere.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
SITE = ROOT / "assets" / "site"
DIST = ROOT / "dist"
FIRST_PAGE = "cutenv/assets/site/index.html"


def run(*arguments: str) -> None:
    """Run a module of this Python in the checkout; SystemExit with its status if it fails."""
    done = subprocess.run([sys.executable, "-m", *arguments], cwd=ROOT, check=False)
    if done.returncode:
        raise SystemExit(done.returncode)


def main() -> None:
    """Build the pages, build the distributions, and check that the wheel holds the pages."""
    if sys.argv[1:]:
        raise SystemExit(__doc__)
    for folder in (SITE, DIST):
        shutil.rmtree(folder, ignore_errors=True)
    run("mkdocs", "build", "--strict", "--site-dir", str(SITE))
    run("build", "--no-isolation", "--outdir", str(DIST))
    (wheel,) = DIST.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        if FIRST_PAGE not in archive.namelist():
            raise SystemExit(f"{wheel.name} does not hold {FIRST_PAGE}: see [tool.hatch.build] in pyproject.toml.")
    for file in sorted(DIST.iterdir()):
        print(f"{file.relative_to(ROOT)}  {file.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
