"""The benchmarks measure what they say; how fast the machine is does not matter here."""

from __future__ import annotations

import gc
import sys

import numpy as np
import pytest

from cutenv import bench
from cutenv.bench import batch, environment, tick
from cutenv.plant import SimulatedPlant
from cutenv.tissue import Specimen


def test_rates_are_of_whole_batches():
    found = batch.rates(64, rounds=1)
    assert 0.0 < found.native
    assert 0.0 < found.bare
    assert 0.0 < found.resets


def test_operations_are_counted_in_the_law_itself():
    counted = batch.operations_per_update()
    assert {"additions", "multiplications", "divisions", "comparisons"} <= set(counted)
    assert 3.0 <= counted["divisions"] <= 12.0
    assert 50.0 < sum(counted.values()) < 500.0


def test_a_step_touches_less_than_a_first_level_cache_holds():
    assert 1000 < batch.bytes_per_step() < 16 * 1024


def test_updates_and_nothing_take_turns():
    own, empty, _ = tick.durations(updates=50)
    assert len(own) == len(empty) == 50
    assert np.median(own) > np.median(empty) > 0


def test_an_update_leaves_no_memory_behind():
    plant = SimulatedPlant(Specimen.mean())
    for _ in range(100):
        plant.advance(0.005, 1.0, 1)
    gc.collect()
    before = sys.getallocatedblocks()
    for _ in range(5000):
        plant.advance(0.005, 1.0, 1)
    assert sys.getallocatedblocks() - before < 50


@pytest.mark.parametrize("name", ["step", "batch", "tick"])
def test_each_prints_a_verdict_by_its_own_numbers(name, capsys, monkeypatch):
    monkeypatch.setattr(environment, "step_times", lambda: {"cutenv/GentleCut-v0": 3.0, "Pendulum-v1": 2.0})
    monkeypatch.setattr(environment, "reset_time", lambda: 50.0)
    monkeypatch.setattr(batch, "rates", lambda count: batch.Rates(1.0e6, 2.0e6, 1.0e5))
    monkeypatch.setattr(batch, "pendulum_rate", lambda: 1.0e4)
    monkeypatch.setattr(tick, "durations", lambda: (np.full(1000, 50_000), np.full(1000, 100), 0))
    assert bench.main([name]) == 0
    said = capsys.readouterr().out
    assert said.count("MISSED") == {"step": 1, "batch": 2, "tick": 1}[name]
    if name == "batch":
        assert "100 times SyncVectorEnv of Pendulum-v1 at 1024 (10 thousand/s): at least 50 required" in said
        assert "as much as 10.0 steps of the batch; within the 100 allowed" in said
