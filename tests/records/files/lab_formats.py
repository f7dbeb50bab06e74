"""Every format of the corpus: one cut of known duration, peak and travel as the programs of laboratories write it."""

from __future__ import annotations

import lab_bags
import lab_binary
import lab_clocks
import lab_exports
import lab_harder
import lab_loggers
import lab_machines
import lab_recorders
import lab_variants
from lab_cut import FORMATS, LabFormat, Truth

__all__ = [
    "FORMATS",
    "LabFormat",
    "Truth",
    "lab_bags",
    "lab_binary",
    "lab_clocks",
    "lab_exports",
    "lab_harder",
    "lab_loggers",
    "lab_machines",
    "lab_recorders",
    "lab_variants",
]
