"""Print generated blocks of the documentation: rewrite them on their pages, or check them.

    python -m scripts.update_docs parameters ladder   from the package, or from what a check has left in runs/
    python -m scripts.update_docs training results --runs runs/NAME ...
                                                      one run for each training seed
    python -m scripts.update_docs --check parameters  fails if a block is not what it would print
    python -m scripts.update_docs --list              every block, with its page and the command behind it

A block stands between ``<!-- NAME -->`` and ``<!-- /NAME -->`` on its page; ``scripts/checks.py`` has all of them.
"""

from __future__ import annotations

import argparse

from scripts import ROOT
from scripts.checks import BLOCKS
from scripts.documentation.page_blocks import replaced


def update(name: str, *runs: str, check: bool) -> None:
    """Write a block to its page; with ``check``, SystemExit where the page has another one."""
    page = ROOT / BLOCKS[name].page
    text = replaced(page, name, BLOCKS[name].text(*runs))
    if not check:
        page.write_text(text, encoding="utf-8")
    elif text != page.read_text(encoding="utf-8"):
        raise SystemExit(f"{BLOCKS[name].page}: not what python -m scripts.update_docs {name} prints")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("blocks", nargs="*", choices=[*BLOCKS, []], metavar="BLOCK", help=", ".join(BLOCKS))
    parser.add_argument("--runs", nargs="+", default=[], help="folders of the runs to quote, for training one a seed")
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    parser.add_argument("--list", action="store_true", help="print all blocks, and stop")
    arguments = parser.parse_args()
    for name, each in BLOCKS.items() if arguments.list else ():
        print(f"{name:<22} {each.page:<38} {each.command}")
    for name in arguments.blocks:
        update(name, *(arguments.runs if name == "training" else ()), check=arguments.check)
