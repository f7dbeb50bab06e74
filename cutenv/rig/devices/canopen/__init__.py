"""A CiA 402 drive on CANopen as an axis of the rig.

Maxon's EPOS4 is such a drive. It needs the extra ``cutenv[rig]``.
"""
