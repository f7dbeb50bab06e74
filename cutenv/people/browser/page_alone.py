"""Page that cuts in a browser without a server.

Law, specimens, drawing and texts are in one file that fetches nothing. For a learning platform it is packed by
SCORM 1.2.
"""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import itertools
import json
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import cutenv
from cutenv._base import resources
from cutenv._base.arrays import Array, StructArray
from cutenv._base.document import render
from cutenv._base.language_files import ENGLISH, languages, texts_by_key
from cutenv._base.output import atomic_write
from cutenv._base.validation import in_range, one_of
from cutenv.agents.policy import experts
from cutenv.display.viewer.drawn_slab import Slab
from cutenv.display.viewer.scene_parts import scene_data
from cutenv.envs.tissue_source import TissueSource
from cutenv.people.browser.watched_cut import expert_way, kind_of_expert
from cutenv.people.play.devices import INCLINED, LEAD, LEVEL_REACH, LOWERED_BY_NOTCH, NOTCH, TRAVEL
from cutenv.people.play.hand_model import PLAYED_HAND
from cutenv.records.measurement.strokes import SHORTEST_STROKE, STANDSTILL_SPEED
from cutenv.records.scoring import points
from cutenv.records.scoring.cut_metrics import HASTE_RATE
from cutenv.sim.cutting.dtypes import READING
from cutenv.sim.quantities import (
    ANGLE_TOLERANCE,
    CLOSE,
    DECELERATION,
    DEPTH_TOLERANCE,
    FARTHEST_TOLERANCE,
    FORCE_ALLOWED,
    FORCE_LIMIT_PER_DEPTH,
    LAG_ALLOWED,
    LAG_CHARGED,
    LAYER_LIMIT,
    LAYER_TOLERANCE,
    LINE_LIMIT,
    LINE_TOLERANCE,
    OVERSHOOT_ALLOWED,
    SHALLOWEST,
    TIP_TOLERANCE,
)
from cutenv.sim.tissue import TissueDescription, measured_liver
from cutenv.sim.tissue.drawn_lines import KINDS
from cutenv.sim.tissue.specimen import CLASSES, LENGTH, SPACING
from cutenv.sim.trace import SPEED_WINDOW
from cutenv.task.assessment import NEAR_TARGET
from cutenv.task.depth import DESCENT_SCALE
from cutenv.task.registry import TASKS, tasks_with
from cutenv.task.reward import TERMS, TIME_AT_REST

OFFERED = ("liver", "uniform", "vascular")
"""Classes of specimens that a page offers by default."""
OFFERED_LINES = ("arc", "s", "excision", "random")
"""Kinds of lines that a page offers by default."""
_HERE = Path(__file__).parent / "page"
_SCRIPTS = (
    "law.js", "words.js", "depth.js", "path.js", "record.js", "score.js", "platform.js", "scene.js", "plan.js",
    "drawing.js", "replay.js", "hand.js", "serial.js", "aids.js", "page.js",
)  # fmt: skip
_TIPS = 61  # positions of the tip for which the page holds the field; between them it is interpolated


def write_page_alone(path: Path, **options: Any) -> int:
    """Write the page of :func:`page_alone` atomically; return its size [bytes].

    Parameters
    ----------
    path : Path
        Page to write (.html).
    **options
        Those of :func:`page_alone`.

    Raises
    ------
    OSError
        If the page cannot be written.
    """
    document = page_alone(**options).encode("utf-8")
    with atomic_write(path) as part:
        part.write_bytes(document)
    return len(document)


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
            specimen_data(
                each,
                seed,
                k,
                task=task,
                line=lines[k % len(lines)] if TASKS[task].line else None,
                expert=expert,
                tissue=tissue,
            )
            for task, each, k in itertools.product(tasks, dict.fromkeys(specimen_classes), numbers)
        ],
    }
    return page_text("page_alone.html", told)


def page_text(template: str, data: dict[str, Any], **values: Any) -> str:
    """Return a cutting page, filled with data, laws, scripts and template values."""
    filled = {
        "data": json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "laws": {task: _base64(law_of(task)) for task in data["tasks"]},
        "code": "\n".join((_HERE / name).read_text(encoding="utf-8") for name in _SCRIPTS),
        "words": data["texts"][data["language"]],
        **values,
    }
    return render(_HERE / template, filled, filters={"digest": script_digest})


def law_of(task: str) -> bytes:
    """Return the compiled law of a task, WebAssembly."""
    return resources.path(f"browser/{task}_law.wasm").read_bytes()


def page_data(tasks: Sequence[str] = ("gentle",), tissue: TissueDescription | None = None) -> dict[str, Any]:
    """Return a page's data on ``tasks`` regardless of specimen, in SI units.

    Its specimens are of ``tissue``, by default the measured pig liver.
    """
    tissue = tissue or measured_liver()
    kinds = {"reading": READING}
    for task in tasks:
        led = TASKS[task].hand.led.task
        kinds |= {f"{task}_cut": led.motion.cut, f"{task}_episode": led.episode}
    return {
        "version": cutenv.__version__,
        "tasks": {task: _task_data(task, tissue) for task in tasks},
        "layout": {name: layout(kind) for name, kind in kinds.items()},
        "hand": dataclasses.asdict(PLAYED_HAND),
        "terms": TERMS,
        "force_allowed_per_depth": FORCE_ALLOWED,
        "tip_tolerance": TIP_TOLERANCE,
        "angle_tolerance": ANGLE_TOLERANCE,
        "near_target": NEAR_TARGET,
        "time_at_rest": TIME_AT_REST,
        "lead": LEAD,
        "travel": TRAVEL,
        "notch": NOTCH,
        "level_notch": LOWERED_BY_NOTCH,
        "level_reach": LEVEL_REACH,
        "fastest_descent": DESCENT_SCALE,
        "depth_tolerance": DEPTH_TOLERANCE,
        "layer_tolerance": LAYER_TOLERANCE,
        "line_tolerance": LINE_TOLERANCE,
        "farthest_tolerance": FARTHEST_TOLERANCE,
        "inclined": INCLINED,
        "spacing": SPACING,
        "length": LENGTH,
        "slab": _slab_data(tissue),
        "scene": scene_data(),
        "texts": {each: texts_by_key(each) for each in languages()},
    }


def _task_data(task: str, tissue: TissueDescription) -> dict[str, Any]:
    """Return a task's call data: numbers, channels, shared part, memory sizes [bytes]."""
    kind = TASKS[task].hand
    led = kind.led.task
    numbers = len(led.action_names)
    return {
        "numbers": numbers,
        "memory": [8 * numbers, 4 * len(led.all_components), 8],  # of action, observation and force across the cut
        "channels": kind.channel_fields,
        "ends": led.ends,
        "terms": tuple(cost.name for cost in led.costs),
        "shared": _base64(shared_part(task, tissue.slab()).tobytes()),
    }


def specimen_data(
    specimen_class: str,
    seed: int,
    episode: int,
    target_length: float | None = None,
    *,
    task: str = "gentle",
    line: str | None = None,
    expert: str | None = None,
    tissue: str | Path | None = None,
) -> dict[str, Any]:
    """Return a cut at its start: key and state records as base64.

    The hidden truth is included. ``line`` is the kind of line of a cut along one; the key draws it by default.  With
    ``expert``, one of the :func:`~cutenv.agents.policy.experts`, its way is there, too.  ``tissue`` is the file of
    another tissue than the measured pig liver.
    """
    key: dict[str, Any] = {"specimen_class": specimen_class, "seed": seed, "episode": episode}
    of_task: dict[str, Any] = {} if line is None else {"line": line}
    cut = TASKS[task].hand(**key, **of_task, target_length=target_length, tissue=tissue)
    told = {"line": cut.noted["line"]} if TASKS[task].line else {}
    records = {name: _base64(record.tobytes()) for name, record in cut.records.items()}
    data = {"task": task} | key | told | {"records": records, "facts": cut.facts}
    if expert is not None:
        key |= {"target_length": target_length, "task": task, "line": line, "tissue": tissue}
        data |= {"expert": expert_way(**key, expert=expert), "expertBy": kind_of_expert(expert)}
    return data


def scoring_data() -> dict[str, Any]:
    """Return the overall score's numbers for a page, in SI units."""
    return {
        "points": {
            "limits": points.LIMIT_POINTS,
            "way": points.WAY_POINTS,
            "accuracy": points.ACCURACY_POINTS,
            "success": points.SUCCESS_POINTS,
            "control": points.CONTROL_POINTS,
            "tissue": points.TISSUE_POINTS,
            "time": points.TIME_POINTS,
        },
        "map_points": points.MAP_POINTS,
        "map_cost": points.MAP_COST,
        "map_missed": points.MAP_MISSED,
        "charged": points.CHARGED,
        "of_part": points.OF_PART,
        "per": points.PER,
        "halved": points.HALVED,
        "missed": points.MISSED,
        "beyond_limit": points.BEYOND_LIMIT,
        "deadline": points.DEADLINE,
        "close": CLOSE,
        "overshoot_allowed": OVERSHOOT_ALLOWED,
        "layer_limit": LAYER_LIMIT,
        "line_limit": LINE_LIMIT,
        "force_limit_per_depth": FORCE_LIMIT_PER_DEPTH,
        "shallowest": SHALLOWEST,
        "standstill": STANDSTILL_SPEED,
        "speed_window": SPEED_WINDOW,
        "shortest_stroke": SHORTEST_STROKE,
        "haste_rate": HASTE_RATE,
        "stopping": 2.0 * DECELERATION * TIP_TOLERANCE,
        "force_allowed": FORCE_ALLOWED,
        "lag_allowed": LAG_ALLOWED,
        "lag_charged": LAG_CHARGED,
    }


def shared_part(task: str, slab: StructArray) -> StructArray:
    """Return a slab's part, shape (1,), shared by a task's cuts."""
    part: StructArray = np.zeros(1, TASKS[task].hand.shared)
    if "slab" in (part.dtype.names or ()):
        for name in part["slab"].dtype.names or ():
            part["slab"][name] = slab[name]
    return part


def layout(kind: np.dtype[Any]) -> dict[str, Any]:
    """Return a structured dtype's size and field offsets [bytes].

    Fields of parts are named "part.field".
    """
    offsets: dict[str, int] = {}
    for name, (field, offset, *_) in (kind.fields or {}).items():
        offsets[name] = offset
        for inner, (_, further, *_) in (field.base.fields or {}).items():
            offsets[f"{name}.{inner}"] = offset + further
    return {"size": kind.itemsize, "offsets": offsets}


def _slab_data(tissue: TissueDescription) -> dict[str, Any]:
    """Return the finite-element field for drawing: places, and displacement per lag."""
    model = tissue.cut_model()
    slab = Slab(model, (1, 1))
    tips = np.linspace(0.0, model.length, _TIPS)
    fields = np.stack([slab.displacement(min(max(tip, 1e-3), model.length - 1e-3), 1.0) for tip in tips.tolist()])
    return {
        "width": model.width,
        "shape": slab.rest.shape[:3],
        "rest": _base64(slab.rest.astype("<f8").tobytes()),
        "tips": _TIPS,
        "fields": _single(fields),
    }


def _single(values: Array) -> str:
    return _base64(values.astype("<f4").tobytes())


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")


def script_digest(code: str) -> str:
    """Return a script's SHA-256 as base64, for a content security policy."""
    return _base64(hashlib.sha256(code.encode()).digest())


_PAGE = "cut.html"
_DATE = (2000, 1, 1, 0, 0, 0)  # of every file, so that the same page gives the same package


def write_scorm_package(path: Path, *, pass_mark: float | None = None, **options: Any) -> int:
    """Write a SCORM 1.2 package of the page atomically; return size [bytes].

    Parameters
    ----------
    path : Path
        Package to write (.zip).
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
    manifest = render(_HERE / "imsmanifest.xml", {"identifier": identifier, "page": _PAGE, "title": texts["title"]})
    with atomic_write(path) as part, zipfile.ZipFile(part, "w") as package:
        for name, content in (("imsmanifest.xml", manifest), (_PAGE, page)):
            package.writestr(zipfile.ZipInfo(name, _DATE), content, zipfile.ZIP_DEFLATED)
    return path.stat().st_size
