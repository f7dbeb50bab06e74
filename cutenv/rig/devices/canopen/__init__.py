"""Axes of a rig: CiA 402 drives on CANopen, with the extra ``cutenv[rig]``."""
