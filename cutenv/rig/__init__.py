"""Real rig.

A motor and a force sensor behind the simulator's interface, with the safety layer that stops them.
"""
