"""Benchmark of cuts along a curve for other solvers; the program is scripts/validation/physics/curved_cuts.py."""
