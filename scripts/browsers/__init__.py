"""Chromium and Firefox, led by programs and tests."""
