"""Operation of a rig: operator, checks before motion, session, specimens and jogging."""
