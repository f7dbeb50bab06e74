"""Rendered images whose truth is known, to test measurements with; shares no code with :mod:`cutenv.vision`."""
