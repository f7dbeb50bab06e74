"""Identification of a rig's constants, from an empty axis under steps, sines and reversals, and a sensor at rest."""

from cutenv.rig.identification.experiment import Recorded, estimated, perform
from cutenv.rig.identification.plan import Plan, Sine
from cutenv.rig.identification.result import Estimate, Identification

__all__ = ["Estimate", "Identification", "Plan", "Recorded", "Sine", "estimated", "perform"]
