"""Identification of a rig's constants, from an empty axis under steps, sines and reversals, and a sensor at rest."""

from cutenv.rig.identification.experiment import Recorded, identification_from, perform
from cutenv.rig.identification.motion_plan import Plan, Sine
from cutenv.rig.identification.result import Identification, IdentifiedValue

__all__ = ["Identification", "IdentifiedValue", "Plan", "Recorded", "Sine", "identification_from", "perform"]
