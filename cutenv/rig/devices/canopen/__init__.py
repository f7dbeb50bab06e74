"""A CiA 402 drive on CANopen, such as Maxon's EPOS4, as an axis of the rig; needs the extra ``cutenv[rig]``."""
