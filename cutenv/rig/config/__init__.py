"""Configuration of a rig: settings, their schema in its file, calibrations and identified constants."""
