"""Two forces tell where the tip is, before any return stroke: better than one force and the mean tissue do."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.envs.batch import CutBatch
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.learning.evaluation import Contestant, evaluate
from cutenv.policy import OneReturnStroke
from cutenv.policy.depth_features import DepthFeatures
from cutenv.policy.depth_scripts import DepthByTwoForces, FollowDepth
from cutenv.policy.features import Features

CUTS = 60


@pytest.fixture(scope="module")
def seen():
    """Lags of the tip [m] while the blade advances at 15 to 40 mm; logarithms of friction; true and estimated."""
    batch = CutBatch(CUTS, DepthCutEnv(specimen_class="mixed", control_hz=25, wanted="constant"))
    every = np.arange(CUTS)
    batch.give_seeds((4000 + every).tolist(), every, np.random.default_rng(0))
    batch.begin(every)
    script, features, along = FollowDepth(), DepthFeatures(CUTS, history=0), Features(history=0).size
    script.begin([np.random.default_rng(0)] * CUTS)
    found = {name: [] for name in ("true", "two forces", "one force")}
    for _ in range(70):
        values = features(batch.observations)
        states = batch.cuts.states
        now = (states["blade"] > 0.015) & (states["blade"] < 0.040) & (states["speed"] > 0.010)
        lag = states["blade"] - states["tip"]
        found["true"] += lag[now].tolist()
        found["two forces"] += (0.01 * values[now, along + 29]).tolist()
        found["one force"] += (0.01 * values[now, 12 + 1]).tolist()
        batch.decide(script.act(batch.observations))
    friction = np.log(batch.cuts.laws["friction_per_depth"])
    return {name: np.array(values) for name, values in found.items()}, friction, values[:, along + 31]


def error(found, name):
    """Root mean square error of a lag [m], each at most 10 mm: one cut gone wrong does not decide."""
    return np.sqrt(np.mean(np.clip(found[name] - found["true"], -0.01, 0.01) ** 2))


def test_they_tell_the_lag_of_the_tip_better_than_the_mean_tissue(seen):
    found = seen[0]
    assert len(found["true"]) > 1000
    assert error(found, "two forces") < 0.85 * error(found, "one force")


def test_they_tell_the_friction(seen):
    _, friction, told = seen
    assert np.corrcoef(friction, told)[0, 1] > 0.8


def test_a_script_that_knows_the_tip_by_them_cuts_nearer_to_the_wanted_depth():
    scripts = {"two": DepthByTwoForces(OneReturnStroke()), "one": FollowDepth()}  # the same way along the cut
    rows = evaluate(
        {name: Contestant(script) for name, script in scripts.items()}, range(4000, 4000 + CUTS),
        {"task": "depth", "wanted": "constant"}, processes=1,
    )  # fmt: skip
    two, one = (
        np.array([row["mean_error_mm"] for row in rows if row["policy"] == name]) for name in ("two", "one")
    )  # fmt: skip
    assert np.median(two - one) < 0.0
    assert two.mean() < one.mean()
