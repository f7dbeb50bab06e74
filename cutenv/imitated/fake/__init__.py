"""A rig in memory on a clock of its own, for tests and dry runs."""
