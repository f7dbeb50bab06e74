"""Open the documentation, which comes with the package, in a browser; nothing is fetched from a network."""

from __future__ import annotations

import argparse
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path

from cutenv._base import resources
from cutenv.commands.options import command_parser

PAGES = "site/index.html"
"""First page, below ``assets``: part of the wheel, and of a checkout once the pages are built."""
BUILD = "python -m mkdocs build --strict"


def main(argv: Sequence[str]) -> int:
    """Open the first page or print its path; 1 if the pages are not built."""
    arguments = _parser().parse_args(argv)
    page = built_page()
    if page is None:
        print(
            "cutenv docs: the pages are not built here. In a checkout, build them by: "
            f"pip install -e '.[docs]' && {BUILD}",
            file=sys.stderr,
        )
        return 1
    if arguments.print_path or not webbrowser.open(page.as_uri()):
        print(page)
    return 0


def built_page() -> Path | None:
    """Return the path of the first page, or None where the pages are not built."""
    try:
        return resources.path(PAGES)
    except FileNotFoundError:
        return None


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("docs", __doc__, examples=("", "--print-path"))
    parser.add_argument(
        "--print-path", action="store_true", help="print the path of the first page instead of opening it"
    )
    return parser
