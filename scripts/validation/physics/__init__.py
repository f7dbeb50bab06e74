"""Checks of the cutting law: energy, limit cases, other models, and the same bits on other machines."""
