"""Checks of measurement: what was put into virtual tissue comes out of its records."""
