"""Drawing back is elastic: probes find the tip and the stiffness, and the script that uses them is worth its while."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from whole_cut import CRUISE, INCLINED, UPRIGHT, cut, interval, make

from cutenv.policy import ConstantFeed, ProbeAndCreep
from cutenv.policy.feedback import UnloadProbe
from cutenv.task.observation import in_units, to_action
from cutenv.tissue.specimen import SPACING


@dataclasses.dataclass
class Probe:
    """What a probe found, and the truth: tips [m], stiffnesses [N/m], and the lag where it began [m]."""

    tip: float
    stiffness: float
    true_tip: float
    true_stiffness: float
    lag: float


class Watched(ProbeAndCreep):
    """The script; beside each probe the hidden truth is written down."""

    def begin(self, rngs):
        super().begin(rngs)
        self.probes: list[Probe] = []

    def _learn(self, n, tip, target):
        state, specimen = self.env.unwrapped.plant.states[0], self.env.unwrapped.specimen
        true_tip = float(state["tip"])
        stiffness = float(np.interp(true_tip / SPACING, np.arange(301), specimen.stiffness()))
        probe = self._probing[n]
        self.probes.append(Probe(tip, probe.stiffness, true_tip, stiffness, probe._felt[0][0] - true_tip))
        super()._learn(n, tip, target)


def probes(seeds: range, **keywords: float) -> list[Probe]:
    script = Watched()
    script.env = make(**keywords)
    found = []
    for seed in seeds:
        cut(script.env, script, seed)
        found += script.probes
    return found


def check_probes(found: list[Probe]) -> None:
    """Tips within 0.3 mm; stiffness, where more than 1.5 mm of lag were there to be unloaded, nearly always in 10 %."""
    assert max(abs(probe.tip - probe.true_tip) for probe in found) < 0.3e-3
    told = [probe.stiffness / probe.true_stiffness for probe in found if probe.lag > 1.5e-3]
    assert len(told) > 0.8 * len(found)
    np.testing.assert_allclose(told, 1.0, atol=0.15)
    assert np.mean(np.abs(np.array(told) - 1.0) < 0.1) > 0.95


def test_a_probe_finds_the_tip_and_the_stiffness_of_tissue_that_is_not_the_mean():
    found = probes(range(22))
    assert len(found) >= 20
    assert np.std([probe.true_stiffness for probe in found]) > 0.2 * np.mean([probe.true_stiffness for probe in found])
    check_probes(found)


@pytest.mark.parametrize("blur", [{"force_noise": 0.5}, {"force_resolution": 2.0}])
def test_a_probe_that_feels_badly_does_not_so_the_check_can_fail(blur):
    with pytest.raises(AssertionError):
        check_probes(probes(range(3), **blur))


def test_a_probe_waits_until_the_blade_draws_back_and_stops_when_only_friction_is_felt():
    env = make(specimen_class="uniform")
    observation, _ = env.reset(seed=0, options={"target_length": 0.09})
    while in_units(observation)["position"] < 0.07:
        observation = env.step(to_action(CRUISE, INCLINED))[0]
    probe, forces = UnloadProbe(), []
    while probe.feel(*(in_units(observation)[name] for name in ("position", "force", "speed"))):
        observation, *_, info = env.step(to_action(-UnloadProbe.SPEED, UPRIGHT))
        forces.append(float(in_units(observation)["force"]))
    assert forces[0] > 2.0
    assert -1.0 < forces[-1] < 0.0
    drawn_back = info["truth"]["tip_m"] - info["truth"]["blade_m"]
    assert 0.0 < drawn_back < 3e-3, "no further than it takes to tell"


@pytest.mark.parametrize("specimen_class", ["liver", "mixed"])
def test_it_succeeds_in_nine_of_ten_specimens_and_more_often_than_the_best_constant_feeds(specimen_class):
    env, seeds = make(specimen_class=specimen_class), range(30)
    policies = (ProbeAndCreep(), *(ConstantFeed(speed=speed, angle=INCLINED) for speed in (CRUISE, 0.0165)))
    succeeded = np.array(
        [[cut(env, policy, seed).infos[-1]["is_success"] for policy in policies] for seed in seeds], float
    )
    assert succeeded[:, 0].mean() >= 0.9
    for feed in succeeded[:, 1:].T:
        assert interval(succeeded[:, 0] - feed)[0] > 0.0


@pytest.mark.parametrize("most", [1, 2, 3])
def test_it_probes_no_more_often_than_it_may(most):
    script = Watched(probes=most, near_enough=0.0)
    script.env = make(specimen_class="vascular")
    counts = []
    for seed in range(6):
        cut(script.env, script, seed)
        counts.append(len(script.probes))
    assert max(counts) == most


def test_it_rests_when_a_probe_finds_the_tip_near_enough():
    script = Watched(near_enough=0.05)
    script.env = make(specimen_class="liver")
    for seed in range(3):
        assert cut(script.env, script, seed).end == "finished"
        assert len(script.probes) == 1


def test_what_a_cut_has_taught_is_forgotten_before_the_next():
    env, script = make(), ProbeAndCreep()
    first = cut(env, script, 5)
    cut(env, script, 6)
    again = cut(env, script, 5)
    np.testing.assert_array_equal(first.observations, again.observations)
