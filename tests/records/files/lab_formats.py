"""Every format of the corpus: one cut of known duration, peak and travel as the programs of laboratories write it."""

from __future__ import annotations

from importlib import import_module

from lab_cut import FORMATS, LabFormat, Truth

__all__ = ["FORMATS", "LabFormat", "Truth"]

for part in ("bags", "binary", "odd", "programs"):
    import_module(f"lab_{part}")
