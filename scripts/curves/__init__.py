"""Benchmark of cuts along a curve for other solvers; the program is scripts/curved_cuts.py."""
