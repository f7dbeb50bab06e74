"""Configuration of a rig.

Settings, their schema in its file, calibrations and identified constants.
"""
