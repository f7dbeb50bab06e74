"""Open the documentation in a browser, without a network.

It comes with the package. Installed from a checkout, the pages are built there first, if MkDocs is installed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import webbrowser
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

from cutenv._base import resources
from cutenv.commands.options import command_parser

# first page, below ``assets``: part of a released wheel, and of a checkout once the pages are built
PAGES = "site/index.html"
_BUILDING = ("mkdocs", "material", "mkdocstrings", "latex2mathml")


def main(argv: Sequence[str]) -> int:
    """Open or print the first page; return 1 without pages."""
    arguments = _parser().parse_args(argv)
    page = built_page() or _build()
    if page is None:
        return 1
    if arguments.print_path or not webbrowser.open(page.as_uri()):
        print(page)
    return 0


def built_page() -> Path | None:
    """Return the path of the built first page, or None."""
    try:
        return resources.path(PAGES)
    except FileNotFoundError:
        source = checkout()
        page = None if source is None else source / "assets" / PAGES
        return page if page is not None and page.is_file() else None


def checkout() -> Path | None:
    """Return the checkout of the installed package, or None."""
    places = [Path(resources.__file__).resolve().parents[2]]
    try:
        told = json.loads(distribution("cutenv").read_text("direct_url.json") or "{}").get("url", "")
        places += [Path(url2pathname(urlsplit(told).path))] if told.startswith("file:") else []
    except PackageNotFoundError:
        pass
    return next((place for place in places if (place / "mkdocs.yml").is_file()), None)


def _build() -> Path | None:
    """Build the pages in the checkout; print why if impossible."""
    source = checkout()
    if source is None:
        print(
            "cutenv docs: this wheel was built without its pages; install a release, or from a checkout, which has "
            "them in docs/",
            file=sys.stderr,
        )
        return None
    if any(find_spec(name) is None for name in _BUILDING):
        print(
            f"cutenv docs: the pages are not built yet; pip install '{source}[docs]', then this command builds them. "
            f"Their text is in {source / 'docs' / 'index.md'}",
            file=sys.stderr,
        )
        return None
    print("building the pages, once, for about a minute ...", file=sys.stderr, flush=True)
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--quiet"], cwd=source, capture_output=True, text=True, check=False
    )
    page = built_page()
    if built.returncode or page is None:
        why = (built.stderr.strip().splitlines() or ["it wrote no pages"])[-1]
        print(f"cutenv docs: 'python -m mkdocs build' in {source} failed: {why}", file=sys.stderr)
        return None
    return page


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("docs", __doc__, examples=("", "--print-path"))
    parser.option("--print-path", "print the path of the first page instead of opening it")
    return parser
