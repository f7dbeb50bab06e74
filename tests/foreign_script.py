"""scripts/foreign_records.py as a module: valid records, dialects, flaws and accidents are made in one place."""

from __future__ import annotations

import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[1] / "scripts" / "foreign_records.py"
sys.path.insert(0, str(SCRIPT.parent))

import foreign_records  # noqa: E402, F401
