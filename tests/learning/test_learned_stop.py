"""The learned stop: it finds the best place where one can be seen, and a cut stops where it says."""

import numpy as np
import pytest
import torch

from cutenv.learning import learned_stop
from cutenv.learning.arguments import BadArguments, PPOArguments
from cutenv.learning.cloning import script_demonstrations
from cutenv.learning.learned_stop import LearnedStop, fit_values, learn_stop, outcomes

ARGUMENTS = PPOArguments(stops=40, environments=4, demonstrations=400)


def test_the_rule_stops_at_the_best_place_that_what_is_seen_tells():
    rng = np.random.default_rng(0)
    places, count = 8, 4000
    best = rng.integers(0, places, count)
    step = np.arange(places)[:, None]
    returns = (1.0 - 0.2 * np.abs(step - best) + rng.normal(0.0, 0.1, (places, count))).astype(np.float32)
    shown = np.stack(np.broadcast_arrays(step - best, rng.normal(size=(places, count))), axis=2).astype(np.float32)
    values = fit_values(returns, shown, seed=0)
    with torch.no_grad():
        earned = values(torch.as_tensor(shown)).numpy()
    stops = earned[..., 0] >= earned[..., 1]
    assert stops[step >= best].mean() > 0.99
    assert stops[step < best].mean() < 0.01


def test_stops_farther_on_end_farther_on_and_a_place_that_was_not_reached_shows_nothing():
    near, far = (outcomes(ARGUMENTS, place, 7, 30)[1][:, -1] / 100.0 for place in (-0.002, 0.010))
    assert np.isfinite(near).all()
    assert (far > near)[np.isfinite(far)].all()
    for place, beyond in ((-0.002, near), (0.010, far)):
        reached = beyond[np.isfinite(beyond)]
        assert (reached >= place).all()
        assert (reached < place + learned_stop.SPACING + 0.001).all()  # a decision's way farther at most


def test_the_teacher_of_the_options_has_learned_when_to_stop(monkeypatch):
    monkeypatch.setattr(learned_stop, "PLACES", learned_stop.PLACES[::5])
    teacher = learn_stop(ARGUMENTS)
    assert isinstance(teacher, LearnedStop)
    taught = []
    monkeypatch.setattr(learned_stop, "learn_stop", lambda arguments: taught.append(arguments) or teacher)
    shown = script_demonstrations(ARGUMENTS.training_environments(), ARGUMENTS)
    assert taught == [ARGUMENTS]
    assert shown.actions.shape == (100, 4, 2)


def test_no_other_script_has_a_stop_to_learn():
    with pytest.raises(BadArguments, match="--stops 40 needs --script 'return stroke', not 'probe and creep'"):
        PPOArguments(stops=40, script="probe and creep")
