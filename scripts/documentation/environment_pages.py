"""Pages of the environments, made of the docstrings that specify them."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator

import gymnasium

from cutenv.task.registry import TASKS
from scripts.documentation.restructured import markdown

IDS = {  # name of the page and id of the environment
    "-".join(re.findall("[A-Z][a-z]+", environment_id)).lower(): environment_id
    for task in TASKS.values()
    for environment_id in (task.id, task.rig_id)
    if environment_id
} | {"free-cut": "cutenv/FreeCut-v1"}


def environment_class(environment_id: str) -> type:
    """Return the class that ``gymnasium.make`` of this id makes."""
    entry_point = str(gymnasium.spec(environment_id).entry_point)
    module, _, name = entry_point.partition(":")
    return getattr(importlib.import_module(module), name)


def pages() -> Iterator[tuple[str, str]]:
    """Yield path below ``docs`` and Markdown of every page."""
    for page, environment_id in IDS.items():
        made = environment_class(environment_id)
        summary, _, rest = markdown(inspect.getdoc(made) or "", level=2).partition("\n\n")
        title = environment_id.removeprefix("cutenv/")
        yield f"environments/{page}.md", f"# {title}\n\n{summary}\n\n{_call(environment_id)}\n\n{rest}\n"


def _call(environment_id: str) -> str:
    return f'```python\nimport gymnasium\nimport cutenv\n\nenv = gymnasium.make("{environment_id}")\n```'
