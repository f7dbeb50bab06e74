"""Paths of the measured data beside or inside the package; the checkout's commit."""

from __future__ import annotations

import subprocess
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
_PACKAGED = _PACKAGE / "assets"
_CHECKOUT = _PACKAGE.parent / "assets"


def path(name: str) -> Path:
    """Return the absolute path of the data file or folder ``name``.

    The name is below ``assets/``, with forward slashes, as ``"tables/table_5_6.csv"``; in a wheel it lies below
    ``cutenv/assets``, in a checkout (also an editable install) below ``assets`` beside the package.  ValueError for a
    name that is empty or leads out of the folder, FileNotFoundError if there is no such file, or no data at all.
    """
    if not isinstance(name, str):
        raise TypeError(f"name must be a string such as 'tables/table_5_6.csv', got {name!r}")
    # The packaged folder comes first: beside an installed package, a folder "assets" belongs to somebody else.
    assets = _PACKAGED if _PACKAGED.is_dir() else _CHECKOUT
    if not assets.is_dir():
        raise FileNotFoundError(
            f"The data of cutenv are missing: looked for the folders {_PACKAGED} and {_CHECKOUT}. "
            "Reinstall cutenv, or run it from a complete checkout."
        )
    root = assets.resolve()
    found = (root / name).resolve()
    if found == root or not found.is_relative_to(root):
        raise ValueError(f"name must name something inside {root}, got {name!r}. Give a path below assets/.")
    if not found.exists():
        raise FileNotFoundError(
            f"No data file {name!r}: looked for {found}. Check the name; if it is right, reinstall cutenv."
        )
    return found


def git(*arguments: str) -> str | None:
    """Return git's output about this checkout, or None if installed."""
    checkout = _CHECKOUT.parent
    if not (checkout / "pyproject.toml").is_file():  # in site-packages: a repository around it is somebody else's
        return None
    done = subprocess.run(["git", *arguments], cwd=checkout, capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else None


def described_version(version: str) -> str:
    """Return a version with commit and change mark, if a checkout."""
    commit = git("rev-parse", "--short=12", "HEAD")
    if commit is None:
        return version
    return f"{version}+{commit}{'.changed' if git('status', '--porcelain', '--untracked-files=no') else ''}"
