"""Checks of the package: against the thesis, theory, other models, rendered images, emulated rigs and attacks."""
