"""scripts/foreign_records.py as a module: valid records, dialects, flaws and accidents are made in one place."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

SCRIPT = Path(__file__).parents[1] / "scripts" / "foreign_records.py"


def _script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("foreign_records", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["foreign_records"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


foreign_records = _script()
