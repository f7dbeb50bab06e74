"""Benchmarks of speed and of agents."""
