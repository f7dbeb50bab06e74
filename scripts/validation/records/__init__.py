"""Checks of reading: damaged records, records with faults, and published cuts of others."""
