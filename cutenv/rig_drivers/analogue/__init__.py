"""Analogue six-axis sensors through a data acquisition board."""
