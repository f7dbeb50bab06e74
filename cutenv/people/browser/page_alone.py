"""Page that cuts in a browser without a server.

Law, specimens, drawing and texts are in one file that fetches nothing. For a learning platform it is packed by
SCORM 1.2.
"""

from __future__ import annotations

import hashlib
import itertools
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cutenv._base.document import render
from cutenv._base.language_files import ENGLISH, languages, texts_by_key
from cutenv._base.output import atomic_write
from cutenv._base.validation import in_range, one_of
from cutenv.agents.policy import experts
from cutenv.display.report.page import write_text
from cutenv.envs.tissue_source import TissueSource
from cutenv.people.browser.page_data import PAGE_FOLDER, page_data, page_text, specimen_data
from cutenv.records.measurement.strokes import SHORTEST_STROKE, STANDSTILL_SPEED
from cutenv.records.scoring import points
from cutenv.records.scoring.cut_metrics import HASTE_RATE
from cutenv.sim import quantities
from cutenv.sim.tissue.drawn_lines import KINDS
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.sim.trace import SPEED_WINDOW
from cutenv.task.registry import TASKS, tasks_with

OFFERED = ("liver", "uniform", "vascular")
"""Classes of specimens that a page offers by default."""
OFFERED_LINES = ("arc", "s", "excision", "random")
"""Kinds of lines that a page offers by default."""
_PAGE = "cut.html"  # name of the page in a package
_DATE = (2000, 1, 1, 0, 0, 0)  # of every file there, so that the same page gives the same package
_MAP_POINTS = ("map_points", "map_cost", "map_missed")
_POINTS = (*_MAP_POINTS, "charged", "of_part", "per", "halved", "missed", "beyond_limit", "deadline")
_LIMITS = ("close", "overshoot_allowed", "layer_limit", "line_limit", "force_limit_per_depth", "shallowest")
_CHARGED = ("force_allowed", "lag_allowed", "lag_charged")


def write_page_alone(path: Path, **options: Any) -> int:
    """Write the page of :func:`page_alone` atomically; return its size [bytes].

    Parameters
    ----------
    **options
        Those of :func:`page_alone`.

    Raises
    ------
    OSError
        If the page cannot be written.
    """
    write_text(path, page_alone(**options))
    return path.stat().st_size


def page_alone(
    *,
    tasks: Sequence[str] = ("gentle",),
    lines: Sequence[str] = OFFERED_LINES,
    specimen_classes: Sequence[str] = OFFERED,
    tissue: str | Path | None = None,
    count: int = 4,
    seed: int = 0,
    language: str = "en",
    platform: Mapping[str, float | None] | None = None,
    expert: str | None = None,
) -> str:
    """Return a page that cuts, shows numbers and saves records.

    It offers ``count`` specimens of each task and class, episodes 0 to ``count`` - 1 of ``seed``; lines are those of a
    task along one, which its specimens have in turn. A ``tissue`` is a file, by default the measured pig liver. A
    ``platform`` is given for a page in a learning platform's package: "mark" is the score to pass with, or None. With
    ``expert``, one of the :func:`~cutenv.agents.policy.experts` of every task, a replay shows its way in the same
    specimen, too: seconds of work for each.
    """
    for each in tasks:
        one_of("task", each, tasks_with("hand"))
        if expert is not None:
            one_of("expert", expert, experts(each))
    for each in specimen_classes:
        one_of("specimen_class", each, CLASSES)
    for each in lines:
        one_of("line", each, KINDS)
    if not lines:
        raise ValueError(f"lines is empty. Give one or more of {', '.join(KINDS)}.")
    one_of("language", language, languages())
    in_range("seed", seed, 0, 2**53, "1", "Give a whole number from 0.")
    numbers = range(round(in_range("count", count, 1, 100, "1", "Give how many specimens of each class.")))
    tasks = tuple(dict.fromkeys(tasks))
    told = page_data(tasks, TissueSource(tissue).description) | {
        "language": language,
        "platform": platform,
        "scoring": scoring_data(),
        "specimens": [
            specimen_data(each, seed, k, task=task, line=_line(task, lines, k), expert=expert, tissue=tissue)
            for task, each, k in itertools.product(tasks, dict.fromkeys(specimen_classes), numbers)
        ],
    }
    return page_text("page_alone.html", told)


def _line(task: str, lines: Sequence[str], k: int) -> str | None:
    return lines[k % len(lines)] if TASKS[task].line else None


def scoring_data() -> dict[str, Any]:
    """Return the overall score's numbers for a page, in SI units."""
    of_points, of_limits, of_charges = (
        {name: getattr(module, name.upper()) for name in names}
        for module, names in ((points, _POINTS), (quantities, _LIMITS), (quantities, _CHARGED))
    )
    parts = ("way", "accuracy", "success", "control", "tissue", "time")
    return {
        "points": {"limits": points.LIMIT_POINTS} | {part: getattr(points, f"{part.upper()}_POINTS") for part in parts},
        **of_points,
        **of_limits,
        "standstill": STANDSTILL_SPEED,
        "speed_window": SPEED_WINDOW,
        "shortest_stroke": SHORTEST_STROKE,
        "haste_rate": HASTE_RATE,
        "stopping": 2.0 * quantities.DECELERATION * quantities.TIP_TOLERANCE,
        **of_charges,
    }


def write_scorm_package(path: Path, *, pass_mark: float | None = None, **options: Any) -> int:
    """Write a SCORM 1.2 package of the page atomically; return size [bytes].

    Parameters
    ----------
    pass_mark : float, optional
        Overall score with which the page reports "passed", 0 to 100; without one it reports "completed".
    **options
        Those of :func:`~cutenv.people.browser.page_alone.page_alone`.

    Raises
    ------
    ValueError
        If an argument is out of range.
    OSError
        If the package cannot be written.
    """
    if pass_mark is not None:
        in_range("pass_mark", pass_mark, 0.0, 100.0, "1", "The overall score is from 0 to 100.")
    page = page_alone(**options, platform={"mark": None if pass_mark is None else round(pass_mark, 1)})
    texts = texts_by_key(options.get("language", ENGLISH))
    identifier = hashlib.sha256(page.encode()).hexdigest()[:16]
    manifest = render(
        PAGE_FOLDER / "imsmanifest.xml", {"identifier": identifier, "page": _PAGE, "title": texts["title"]}
    )
    with atomic_write(path) as part, zipfile.ZipFile(part, "w") as package:
        for name, content in (("imsmanifest.xml", manifest), (_PAGE, page)):
            package.writestr(zipfile.ZipInfo(name, _DATE), content, zipfile.ZIP_DEFLATED)
    return path.stat().st_size
