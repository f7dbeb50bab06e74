"""Pages of recorded cuts to be looked at, and what stands in them."""

from __future__ import annotations

import base64
import json
import re
from functools import cache
from typing import Any

import numpy as np
from recorded_cut import recorded_cut

from cutenv.display.viewer.solid import ShownCut
from cutenv.display.viewer.solid.view_page import view_page

INSTANTS = 40


@cache
def shown(target: float | None = 0.08) -> ShownCut:
    """A cut of a drawn liver at 60 degrees."""
    return ShownCut.of(
        recorded_cut("liver", angle_deg=60.0, turns=(0.085, 0.075)).trace, target=target, instants=INSTANTS
    )


@cache
def document(colour: str = "displacement") -> str:
    """Its page."""
    return view_page(shown(), colour=colour)


def block(page: str, name: str) -> str:
    """A block of data of a page."""
    found = re.search(rf'<script type="text/plain" id="{name}">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return found[1]


def told(page: str) -> dict[str, Any]:
    """What the page's script is told."""
    numbers: dict[str, Any] = json.loads(block(page, "told"))
    return numbers


def with_told(page: str, **changes: Any) -> str:
    """The page, its script told something else."""
    return page.replace(block(page, "told"), json.dumps(told(page) | changes).replace("<", "\\u003c"))


def array(page: str, name: str, kind: str) -> np.ndarray:
    """A block of numbers."""
    return np.frombuffer(base64.b64decode(block(page, name)), kind)
