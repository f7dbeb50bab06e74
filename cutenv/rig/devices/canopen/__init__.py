"""Axes of a rig: CiA 402 drives on CANopen. Maxon's EPOS4 is such a drive. It needs the extra ``cutenv[rig]``."""
