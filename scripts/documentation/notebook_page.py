"""Run the notebook, and write its page of the documentation: text, code, what was printed, and its figures.

    python -m scripts.documentation.notebook_page  writes docs/how-to/notebook.md and assets/pictures/notebook-1.svg

The cells are plain Python, and run without Jupyter, one after the other in one namespace.
"""

from __future__ import annotations

import contextlib
import io
import json
from typing import Any

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt

from scripts import ROOT
from scripts.drawings.concepts import STYLE

NOTEBOOK = ROOT / "docs" / "how-to" / "first_cut.ipynb"
PAGE = ROOT / "docs" / "how-to" / "notebook.md"
PICTURES = ROOT / "assets" / "pictures"
ABOUT = """<!-- Written by scripts/documentation/notebook_page.py. -->

!!! note "A notebook"
    This page is the notebook [first_cut.ipynb](first_cut.ipynb), with what it prints. Download it and open it
    in Jupyter: `pip install 'cutenv[view]' jupyterlab`, then `jupyter lab first_cut.ipynb`.
"""


def source(cell: dict[str, Any]) -> str:
    """Return the text of a cell."""
    return "".join(cell["source"]).strip()


def run(notebook: dict[str, Any]) -> tuple[str, list[plt.Figure]]:
    """Run a notebook; return its page in Markdown, and its figures in order."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    title, parts, figures = "", [], []
    for number, cell in enumerate(notebook["cells"]):
        if cell["cell_type"] == "markdown":
            parts.append(source(cell))
            continue
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), plt.rc_context(STYLE):
            exec(compile(source(cell), f"{NOTEBOOK.name}, cell {number}", "exec"), namespace)
        parts.append(
            f"<!-- not run: it is a cell of the notebook, and runs with it -->\n```python\n{source(cell)}\n```"
        )
        if printed.getvalue():
            parts.append(f"```text\n{printed.getvalue().strip()}\n```")
        for each in plt.get_fignums():
            figures.append(plt.figure(each))
            parts.append(f"![Figure {len(figures)} of the notebook](../pictures/notebook-{len(figures)}.svg)")
        for figure in figures:
            plt.close(figure)
    title, _, first = parts[0].partition("\n\n")
    return "\n\n".join([title, ABOUT.strip(), first, *parts[1:]]) + "\n", figures


if __name__ == "__main__":
    page, figures = run(json.loads(NOTEBOOK.read_text(encoding="utf-8")))
    PAGE.write_text(page, encoding="utf-8")
    for number, figure in enumerate(figures, 1):
        figure.savefig(PICTURES / f"notebook-{number}.svg", metadata={"Date": None, "Creator": None}, transparent=True)
