"""Data of a page that cuts: laws, numbers, specimens, scene, texts."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import cutenv
from cutenv._base import resources
from cutenv._base.arrays import StructArray
from cutenv._base.document import as_base64, render, script_digest
from cutenv._base.language_files import languages, texts_by_key
from cutenv.display.viewer.drawn_slab import Slab
from cutenv.display.viewer.scene_parts import scene_data
from cutenv.people.browser.watched_cut import expert_way, kind_of_expert
from cutenv.people.play import devices
from cutenv.people.play.hand_model import PLAYED_HAND
from cutenv.sim import quantities
from cutenv.sim.cutting.dtypes import READING
from cutenv.sim.tissue import TissueDescription, measured_liver
from cutenv.sim.tissue.specimen import LENGTH, SPACING
from cutenv.task.assessment import NEAR_TARGET
from cutenv.task.depth import DESCENT_SCALE
from cutenv.task.registry import TASKS
from cutenv.task.reward import TERMS, TIME_AT_REST

PAGE_FOLDER = Path(__file__).parent / "page"
"""Folder of the page's templates and scripts."""
_SCRIPTS = (
    "law.js", "words.js", "depth.js", "path.js", "record.js", "score.js", "platform.js", "scene.js", "plan.js",
    "drawing.js", "replay.js", "hand.js", "serial.js", "aids.js", "page.js",
)  # fmt: skip
_TIPS = 61  # positions of the tip for which the page holds the field; between them it is interpolated


def page_text(template: str, data: dict[str, Any], **values: Any) -> str:
    """Return a cutting page, filled with data, laws, scripts and template values."""
    filled = {
        "data": json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "laws": {task: as_base64(law_of(task)) for task in data["tasks"]},
        "code": "\n".join((PAGE_FOLDER / name).read_text(encoding="utf-8") for name in _SCRIPTS),
        "words": data["texts"][data["language"]],
        **values,
    }
    return render(PAGE_FOLDER / template, filled, filters={"digest": script_digest})


def law_of(task: str) -> bytes:
    """Return the compiled law of a task, WebAssembly."""
    return resources.path(f"browser/{task}_law.wasm").read_bytes()


def page_data(tasks: Sequence[str] = ("gentle",), tissue: TissueDescription | None = None) -> dict[str, Any]:
    """Return a page's data on ``tasks`` and ``tissue``, regardless of specimen, in SI units."""
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
        "force_allowed_per_depth": quantities.FORCE_ALLOWED,
        "tip_tolerance": quantities.TIP_TOLERANCE,
        "angle_tolerance": quantities.ANGLE_TOLERANCE,
        "near_target": NEAR_TARGET,
        "time_at_rest": TIME_AT_REST,
        "lead": devices.LEAD,
        "travel": devices.TRAVEL,
        "notch": devices.NOTCH,
        "level_notch": devices.LOWERED_BY_NOTCH,
        "level_reach": devices.LEVEL_REACH,
        "fastest_descent": DESCENT_SCALE,
        "depth_tolerance": quantities.DEPTH_TOLERANCE,
        "layer_tolerance": quantities.LAYER_TOLERANCE,
        "line_tolerance": quantities.LINE_TOLERANCE,
        "farthest_tolerance": quantities.FARTHEST_TOLERANCE,
        "inclined": devices.INCLINED,
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
        "shared": as_base64(shared_part(task, tissue.slab()).tobytes()),
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
    """Return a cut at its start: key, facts and state records as base64."""
    key: dict[str, Any] = {"specimen_class": specimen_class, "seed": seed, "episode": episode}
    of_task: dict[str, Any] = {} if line is None else {"line": line}
    cut = TASKS[task].hand(**key, **of_task, target_length=target_length, tissue=tissue)
    told = {"line": cut.noted["line"]} if TASKS[task].line else {}
    records = {name: as_base64(record.tobytes()) for name, record in cut.records.items()}
    data = {"task": task} | key | told | {"records": records, "facts": cut.facts}
    if expert is not None:
        key |= {"target_length": target_length, "task": task, "line": line, "tissue": tissue}
        data |= {"expert": expert_way(**key, expert=expert), "expertBy": kind_of_expert(expert)}
    return data


def shared_part(task: str, slab: StructArray) -> StructArray:
    """Return a slab's part, shape (1,), shared by a task's cuts."""
    part: StructArray = np.zeros(1, TASKS[task].hand.shared)
    if "slab" in (part.dtype.names or ()):
        for name in part["slab"].dtype.names or ():
            part["slab"][name] = slab[name]
    return part


def layout(kind: np.dtype[Any]) -> dict[str, Any]:
    """Return a structured dtype's size and field offsets, "part.field" [bytes]."""
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
        "rest": as_base64(slab.rest.astype("<f8").tobytes()),
        "tips": _TIPS,
        "fields": as_base64(fields.astype("<f4").tobytes()),
    }
