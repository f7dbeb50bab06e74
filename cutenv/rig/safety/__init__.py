"""Safety of a rig.

The supervisor, its monitors, causes of a stop and quick stops.
"""
