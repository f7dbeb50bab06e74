"""Fixtures of several test files of a rig."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest

from cutenv.rig.config.settings import HEIGHT


@pytest.fixture(scope="module")
def quick_return() -> Iterator[None]:
    """Let blades return to the clamp quickly, and hardly raised.

    At their slow pace, and by 20 mm up and down, a short cut is mostly the way back.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cutenv.rig.operation.session.RETURN_SPEED", 0.025)
        patch.setattr("cutenv.rig.config.settings.HEIGHT", replace(HEIGHT, raised=0.003))
        yield
