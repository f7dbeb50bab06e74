"""From an empty axis that is stepped, shaken and turned round, and a sensor at rest: the constants of a rig."""

from cutenv.rig.identification.experiment import Recorded, estimated, perform
from cutenv.rig.identification.plan import Plan, Sine
from cutenv.rig.identification.result import Estimate, Identification

__all__ = ["Estimate", "Identification", "Plan", "Recorded", "Sine", "estimated", "perform"]
