"""Emulated serial rig: the board's own sketch, compiled for this computer, behind a pseudo-terminal."""
