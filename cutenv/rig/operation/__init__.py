"""Operation of a rig.

Operator, checks before motion, session, specimens and jogging.
"""
