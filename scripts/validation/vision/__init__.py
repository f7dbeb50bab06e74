"""Checks of measurement by images, on rendered ones whose truth is known."""
