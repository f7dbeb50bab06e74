"""Table of the formats of laboratories: what is read at first try, what is asked, what is left out.

    python -m scripts.documentation.lab_format_table

Each file of the corpus (tests/records/files/lab_formats.py) is made, read as it is, and compared with its truth.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from cutenv.records import RecordError
from cutenv.records.importers import OpenQuestions, look_at
from scripts import ROOT
from scripts.tables import markdown_table

sys.path.insert(0, str(ROOT / "tests" / "records" / "files"))
TOLERANCE = 0.01  # relative error of duration, peak and travel up to which a record is right


def markdown() -> str:
    """Return the table of all formats, and their numbers above it."""
    from lab_formats import FORMATS

    rows, kinds = [], Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        for given in FORMATS:
            path = Path(folder) / given.name
            path.write_bytes(given.content)
            kind, asked, left_out = outcome(path, given)
            kinds[kind] += 1
            rows.append((given.maker, given.about, kind, asked, left_out))
    counted = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    heads = ("written by", "format", "at first try", "asked", "left out")
    return f"{len(rows)} formats: {counted}.\n\n{markdown_table(heads, rows)}"


def outcome(path: Path, given: Any) -> tuple[str, str, str]:
    """Return whether a file is "right", "wrong", "asked" or "refused", the questions, and the rows left out."""
    try:
        found = look_at(path)
    except OpenQuestions as error:
        return "asked", _listed(question.text for question in error.asked.questions), ""
    except RecordError:
        return "refused", "", ""
    right = len(found.records) == len(given.truth)
    for trace, truth in zip(found.records, given.truth, strict=False):
        position = trace.position
        travel = None if position is None else 1e3 * float(position.max() - position.min())
        pairs = [(trace.duration, truth.duration_s), (float(trace.force.max()), truth.peak_N)]
        right &= (travel is None) == (truth.travel_mm is None)
        pairs += [(travel, truth.travel_mm)] if travel is not None and truth.travel_mm is not None else []
        right &= all(abs(got - true) <= TOLERANCE * true for got, true in pairs)
    count = sum(each.count for each in found.left_out)
    asked = _listed(question.text for question in found.questions)
    return "right" if right else "wrong", asked, str(count) if count else ""


def _listed(texts: Any) -> str:
    return " ".join(texts).replace("|", "/")


if __name__ == "__main__":
    print(markdown())
