"""A class with its server for every test that asks for one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def room(tmp_path: Path) -> Iterator[Any]:
    from class_room import Room  # its server is an extra

    made = Room(tmp_path)
    yield made
    made.lesson.close()
