"""What scripts get on the specimen of a record: the same as if they had cut it, and nothing where it is unknown."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from cutenv.agents.difficulty import COMPARED_SCRIPTS, scripts_on_specimen_of
from cutenv.agents.policy import BASELINES
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.records.scoring import score
from cutenv.records.scoring.truth import TIP_AT_END
from cutenv.sim.plant import to_trace
from cutenv.sim.trace import Trace

SCRIPT = "constant 1.27 cm/s 90 deg"


@pytest.fixture(scope="module")
def record() -> Trace:
    """A script's own record of the third specimen of a seed."""
    env, policy = GentleCutEnv(specimen_class="vascular"), BASELINES[SCRIPT]()
    observation, _ = env.reset(seed=4, options={"episode": 3})
    policy.reset(np.random.default_rng(0))
    parts: list[Any] = []
    ended = False
    while not ended:
        observation, _, ended, _, _ = env.step(policy(observation))
        parts.append(env.cutting.readings.copy())  # type: ignore[union-attr]
    readings = np.concatenate(parts)
    facts = {"specimen_class": "vascular", "specimen_seed": 4, "specimen_episode": 3, "end": env.cutting.end}
    facts |= {"target_length_m": env.cutting.target_length, TIP_AT_END: float(readings["tip"][-1])}
    return to_trace(env.plant, readings, **facts)


def test_a_script_gets_on_the_specimen_what_its_own_record_gets(record: Trace) -> None:
    scripts = scripts_on_specimen_of(record)
    assert tuple(each.name for each in scripts) == COMPARED_SCRIPTS
    own = next(each for each in scripts if each.name == SCRIPT)
    card = score(record)
    assert (own.overall_score, own.outcome) == (card.overall_score, card.outcome)
    card = dataclasses.replace(card, scripts=scripts)
    assert f"{SCRIPT} {own.overall_score:.0f}" in str(card)
    assert json.loads(card.to_json())["scripts_on_this_specimen"][0]["name"] == "planner with truth"


@pytest.mark.parametrize(
    "changes",
    [
        {"specimen_class": None},  # a rig
        {"specimen_seed": 5},  # not what was cut: the depth is another
        {"specimen_episode": 2},
        {"specimen_seed": "4"},
        {"target_length_m": 5.0},
        {"target_length_m": None},
    ],
)
def test_of_a_specimen_that_is_not_known_nothing_is_said(record: Trace, changes: dict[str, object]) -> None:
    trace = dataclasses.replace(record, metadata=record.metadata | changes)
    assert scripts_on_specimen_of(trace) == ()
    assert "very specimen" not in str(score(trace, target_length=0.08))
