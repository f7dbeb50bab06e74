"""Environment that agents are trained in, and its seeds.

The seeds are of specimens for training, validation and test.
"""

from __future__ import annotations

import gymnasium

import cutenv  # registers the environment

ENVIRONMENT = "cutenv/GentleCut-v1"  # id of the environment
assert ENVIRONMENT in gymnasium.registry, cutenv.__name__

TRAINING_SEEDS = range(0, 1_000_000)  # seeds of the environments that agents are trained in
VALIDATION_SEEDS = range(1_000_000, 2_000_000)  # seeds of the specimens on which checkpoints and settings are compared
TEST_SEEDS = range(2_000_000, 3_000_000)
"""Seeds of the held-out specimens; a specimen depends on seed and episode, so these are disjoint from the others."""
ENTRY_SEEDS = range(2**32, 2**63)
"""Seeds of the specimens of entries on the leaderboard, drawn for each entry: too many to be solved beforehand."""
