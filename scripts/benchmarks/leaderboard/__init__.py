"""Benchmark of all agents: protocol, training runs, statistics, robustness, table and page."""
