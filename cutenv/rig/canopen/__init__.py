"""A CiA 402 drive on CANopen, such as Maxon's EPOS4, as an axis of the rig; needs the extra ``cutenv[rig]``."""

from __future__ import annotations

from cutenv.rig.canopen.axis import CanopenAxis
from cutenv.rig.canopen.network import CanNetwork

__all__ = ["CanNetwork", "CanopenAxis"]
