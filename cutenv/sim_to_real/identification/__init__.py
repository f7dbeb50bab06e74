"""Identification of a rig's constants, from an empty axis under steps, sines and reversals, and a sensor at rest."""

from cutenv.sim_to_real.identification.experiment import (
    Identification,
    IdentifiedValue,
    Plan,
    Recorded,
    Sine,
    identification_from,
    perform,
)

__all__ = ["Identification", "IdentifiedValue", "Plan", "Recorded", "Sine", "identification_from", "perform"]
