"""With ``flat_info=True`` infos are numbers alone, the same names at every step, of single environments and batches."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from batches import N, both, run_both

from cutenv.envs.gymnasium_facts import flat_info
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.task.registry import TASKS

IDS = [*(task.id for task in TASKS.values()), "cutenv/FreeCut-v1", "cutenv/SafeCut-v1", "cutenv/GentleCutRaw-v1"]


def leaves(info, path=()):
    """Entries of nested dictionaries by path."""
    for name, value in info.items():
        if isinstance(value, dict):
            yield from leaves(value, (*path, name))
        else:
            yield (*path, name), value


@pytest.mark.parametrize("environment", IDS)
def test_every_entry_is_there_as_a_number_at_every_step(environment):
    short = {} if "Safe" in environment or "Raw" in environment else {"deadline_s": 1.0, "control_hz": 20}
    flat, nested = gymnasium.make(environment, flat_info=True, **short), gymnasium.make(environment, **short)
    ends = flat.unwrapped.task.ends
    (_, info), (_, whole) = flat.reset(seed=3), nested.reset(seed=3)
    names, ended, steps = set(info), False, 0
    action = np.full(flat.action_space.shape, 0.3, np.float32)
    while not ended and steps < 25:
        expected = {"_".join(path): value for path, value in leaves(whole)}
        expected["truth_specimen_class"] = CLASSES.index(expected["truth_specimen_class"])
        expected["end"] = ends.index(expected.get("end", ""))
        assert info == {"is_success": 0, **expected}
        assert set(info) == names
        assert {type(value) for value in info.values()} <= {np.float64, np.int64}
        _, _, ended, _, info = flat.step(action)
        whole = nested.step(action)[-1]
        steps += 1
    assert not short or (ended and info["end"] == ends.index(whole["end"]) > 0)


@pytest.mark.parametrize(
    ("task", "mode"),
    [*(("gentle", mode) for mode in ("NextStep", "SameStep", "Disabled")), ("depth", "SameStep"), ("path", "NextStep")],
)
def test_a_batch_has_the_flat_infos_of_single_environments(task, mode):
    native, singles = both(mode, id=TASKS[task].id, flat_info=True, deadline_s=2.0, control_hz=20)
    ended, _ = run_both(native, singles, steps=90)
    assert ended >= N


def test_the_end_of_a_success_is_told_in_numbers():
    told = flat_info({"cost": 0.0, "end": "finished", "is_success": True}, ("", "deadline", "finished"))
    assert told == {"end": 2, "is_success": 1, "cost": 0.0}


def test_it_is_true_or_false():
    with pytest.raises(ValueError, match="flat_info must be one of False, True, got 'yes'"):
        gymnasium.make("cutenv/GentleCut-v1", flat_info="yes")
