"""Run the examples, and write what they print into their pages of the documentation.

    python -m scripts.documentation.example_pages             all of them
    python -m scripts.documentation.example_pages NAME ...    some of them

Needed after a change of what an example prints; ``tests/examples`` compares the pages with what is printed.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile

from scripts import ROOT

TIMED = ("thousand_at_once", "train_sb3")
"""Examples that print what depends on the machine: a rate, or what PyTorch has learned."""


def main(names: list[str]) -> int:
    """Write the pages; return the exit status."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    for example in sorted((ROOT / "examples").glob("*.py")):
        if example.stem in TIMED or (names and example.stem not in names):
            continue
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run(
                [sys.executable, str(example)], cwd=folder, capture_output=True, text=True,
                env=os.environ | {"PYTHONPATH": path},
            )  # fmt: skip
        if done.returncode != 0:
            print(f"{example.name}: {done.stderr}", file=sys.stderr)
            return 1
        page = ROOT / "docs" / "examples" / f"{example.stem}.md"
        text = re.sub(r"\nIt prints\n\n```text\n.*?```\n", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        end = text.index("```\n", text.index("--8<--")) + len("```\n")
        printed = f"\nIt prints\n\n```text\n{done.stdout.rstrip()}\n```\n"
        page.write_text(text[:end] + printed + text[end:], encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
