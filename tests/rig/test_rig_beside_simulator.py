"""A policy side by side on a rig and in the simulator: nominal constants do not differ, changed ones do."""

from __future__ import annotations

import dataclasses
import json
import types

import numpy as np
import pytest
from scripted_operator import ScriptedOperator

from cutenv.agents.policy import BASELINES
from cutenv.agents.sim_to_real import Agreement
from cutenv.agents.sim_to_real.paired_experiment import (
    PairedCuts,
    cut_on_rig,
    cut_once,
    cut_twins,
    paired_experiment,
    simulate_cuts,
    simulator_like,
)
from cutenv.agents.sim_to_real.specimen_twin import fit_twin
from cutenv.commands.cli import main
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.records import load_one
from cutenv.rig.safety.stop_causes import Cause
from cutenv.sim.tissue.description import measured_liver
from cutenv.sim.tissue.specimen import Specimen

SPECIMENS, DRAWS, SEED = 14, 3, 11
SHORT = {"target_length": 0.04, "specimen_class": "liver"}
pytestmark = pytest.mark.usefixtures("quick_return")


def feed():
    return BASELINES["constant 1.65 cm/s 90 deg"]()


@pytest.fixture(scope="module")
def simulated():
    with_rig = RigCutEnv(rig="fake", **SHORT)
    return simulate_cuts(simulator_like(with_rig, **SHORT), feed(), seed=SEED, specimens=SPECIMENS, draws=DRAWS)


def verdict_of(simulated, **constants):
    env = RigCutEnv(rig="fake", **SHORT, **constants)
    cuts, clock, between = cut_on_rig(env, feed(), seed=SEED, specimens=SPECIMENS)
    env.close()
    assert not between
    assert clock.overruns == 0
    assert clock.spread("periods")["max"] == pytest.approx(0.02)
    assert 0.0 <= clock.spread("latencies")["max"] <= 0.0011  # the newest reading is a millisecond old at most
    return Agreement(cuts, simulated).verdict


def test_a_nominal_rig_does_not_differ_from_the_simulator(simulated):
    verdict = verdict_of(simulated)
    assert verdict.answer != "differ", str(verdict)
    assert len(verdict.open) <= 4, str(verdict)


def test_in_the_simulator_too_no_command_is_faster_than_a_slow_rigs_limits():
    env = RigCutEnv(rig="serial", dry_run=True, angle_mode="fixed", control_hz=10, **SHORT)
    simulator = simulator_like(env, control_hz=10, **SHORT)
    found = paired_experiment(env, simulator, feed(), seed=SEED, specimens=6, draws=2)
    env.close()
    duration = [
        np.mean([cut.trace.time[-1] for cut in cuts]) for cuts in (found.rig, [c for d in found.simulator for c in d])
    ]
    assert duration[0] > 6.0, "the rig is slower than the policy"
    assert duration[1] == pytest.approx(duration[0], rel=0.05)


def test_a_late_force_a_slow_motor_and_a_zero_that_wanders_show(simulated):
    """Each by measures of its own: alone, the first two leave the offset, and the last motion and duration."""
    verdict = verdict_of(simulated, force_delay=0.040, motor_lag=0.120, force_drift=0.3)
    assert verdict.answer == "differ"
    assert {"position_rmse", "duration"} & set(verdict.differ)
    assert "force_offset" in verdict.differ


def test_a_blade_that_rubs_shows(simulated):
    verdict = verdict_of(simulated, friction_per_depth_speed=2000.0)
    assert verdict.answer == "differ"
    assert "peak_force" in verdict.differ


def test_draws_of_noise_differ_and_specimens_do_not(simulated):
    first, second = simulated[0][:2]
    assert first.trace.metadata["specimen_seed"] == SEED
    assert (first.trace.force[:100] != second.trace.force[:100]).any()
    assert (first.trace.depth[:1000] == second.trace.depth[:1000]).all()
    assert first.trace.metadata["target_length_m"] == second.trace.metadata["target_length_m"] == 0.04


def test_the_simulator_is_given_what_was_identified():
    env = RigCutEnv(rig="fake")
    identified = dataclasses.replace(env.settings.identified, motor_lag=0.061)
    env._source.settings = dataclasses.replace(env.settings, identified=identified)
    simulator = simulator_like(env)
    assert simulator.constants.drive.motor_lag == 0.061
    assert simulator.from_truth is False
    assert simulator_like(env, motor_lag=0.05).constants.drive.motor_lag == 0.05


def test_a_policy_that_sees_the_truth_is_refused():
    env = RigCutEnv(rig="fake")
    with pytest.raises(ValueError, match="hidden state"):
        cut_once(env, BASELINES["planner with truth"](), seed=0, episode=0)


class Interfering:
    """A feed beside which something happens once the blade is under way in a cut, numbered from 1."""

    def __init__(self, number, act):
        self.feed, self.number, self.act, self.cuts = feed(), number, act, 0

    def reset(self, rng):
        self.feed.reset(rng)
        self.cuts += 1

    def __call__(self, observation):
        if self.cuts == self.number and observation[4] > 0.2:
            self.act()
        return self.feed(observation)


def test_a_rig_that_ends_early_leaves_what_was_cut():
    operator = ScriptedOperator([("will move", "fake")])
    env = RigCutEnv(rig="fake", operator=operator, **SHORT)
    operator.unasked.append(("was stopped", False))
    breaks_down = Interfering(2, lambda: vars(env.the_fake().faults).update(extra_force=40.0))
    cuts, _, between = cut_on_rig(env, breaks_down, seed=SEED, specimens=3)
    assert [cut.end for cut in cuts] == ["finished", "stopped"]  # a limit of force is the cut's own doing
    assert len(between) == 1
    assert "not agreed" in between[0]


def test_a_specimen_is_cut_anew_where_the_computer_lost_time():
    env = RigCutEnv(rig="fake", **SHORT)

    def stall():
        fake = env.the_fake()
        fake.faults.force_silent = True
        fake.clock.every(0.3, lambda now: vars(fake.faults).update(force_silent=False), "mended")

    cuts, _, between = cut_on_rig(env, Interfering(1, stall), seed=SEED, specimens=2)
    env.close()
    assert [cut.end for cut in cuts] == ["finished", "finished"]
    assert len(between) == 1
    assert "force stale" in between[0]


def test_a_person_who_stops_it_gets_what_was_cut():
    env = RigCutEnv(rig="fake", **SHORT)
    interrupted = Interfering(2, lambda: env.session.plant.supervisor.trip(Cause.INTERRUPTED, "SIGINT", locked=True))
    cuts, _, between = cut_on_rig(env, interrupted, seed=SEED, specimens=3)
    env.close()
    assert [cut.end for cut in cuts] == ["finished"]
    assert "SIGINT" in between[0]


def test_specimens_that_nobody_drew_are_compared_unpaired(simulated):
    shifted = PairedCuts(
        simulator=simulated, rig=[cuts[0] for cuts in simulated[:7]], paired=False, clock=None, between=[]
    )
    assert not shifted.agreement.paired
    assert len(shifted.agreement.simulator) == SPECIMENS


def test_few_specimens_are_refused_before_anything_moves():
    env = RigCutEnv(rig="fake")
    with pytest.raises(ValueError, match="specimens = 3"):
        paired_experiment(env, simulator_like(env), feed(), specimens=3)
    assert env._session is None


def test_the_command_prints_a_screen_and_writes_page_json_and_records(tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")
    out, numbers = tmp_path / "out", tmp_path / "numbers.json"
    status = main(
        ["rig", "evaluate", "--policy", "constant 2.54 cm/s 90 deg", "--rig", "fake", "--specimens", "6",
         "--target-length", "40mm", "--draws", "2", "--change", "motor_lag=0.12", "--out", str(out),
         "--json", str(numbers)]
    )  # fmt: skip
    printed = capsys.readouterr().out
    assert status in (0, 1)
    assert "verdict: " in printed
    assert "control clock: " in printed
    assert len(printed.splitlines()) <= 45
    assert max(map(len, printed.splitlines()[:-6])) <= 120
    told = json.loads(numbers.read_text())
    assert told["changed_si"] == {"motor_lag": 0.12}
    assert len(told["findings"]) + len(told["not_compared"]) == 30
    assert {each["answer"] for each in told["findings"]} <= {"agree", "differ", "undecided"}
    assert (out / "evaluation.html").is_file()
    assert len(list((out / "records" / "rig").glob("*.csv"))) == 6
    assert len(list((out / "records" / "simulator").glob("*.csv"))) == 12
    assert load_one(out / "records" / "simulator" / "000-0.csv").metadata["specimen_seed"] == 0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--policy", "nobody"], "--list' prints the names"),
        (["--policy", "planner with truth"], "hidden state"),
        (["--rig", "missing.toml"], "no such file"),
        (["--change", "motor_lag"], "NAME=NUMBER"),
        (["--change", "motor_lap=0.1"], "'motor_lap=0.1': no constant has that name. Did you mean 'motor_lag'?"),
        (["--rig", "emulator", "--change", "acceleration=0.2"], "an emulated rig has no such option"),
        (["--specimens", "2"], "specimens = 2"),
    ],
)
def test_bad_options_are_refused_in_the_readers_words(options, said, capsys):
    given = ["--policy", "nothing", "--rig", "fake", *options]
    assert main(["rig", "evaluate", *given]) == 2
    assert said in capsys.readouterr().err


# Specimens that nobody has drawn


@pytest.fixture(scope="module")
def laid():
    """Cuts as of a lab: eight specimens, of which nothing but the record is known."""
    env = simulator_like(RigCutEnv(rig="fake", **SHORT), **{**SHORT, "target_length": 0.06})
    return env, [cut_once(env, feed(), seed=SEED, episode=k, noise=77) for k in range(8)]


def times(cut, gain):
    return dataclasses.replace(cut, trace=dataclasses.replace(cut.trace, force=gain * cut.trace.force))


def test_a_twin_has_the_forces_of_the_half_that_it_was_fitted_to(laid):
    env, cuts = laid
    for episode, cut in enumerate(cuts[:3]):
        twin = fit_twin(cut.trace, measured_liver())
        again = cut_once(
            env, feed(), seed=1, episode=episode, specimen=twin.drawn(np.random.default_rng(2)), target_length=0.06,
            depth=twin.specimen.depth,
        )  # fmt: skip
        mean = [each.force[each.position < twin.until].mean() for each in (cut.trace, again.trace)]
        assert mean[1] == pytest.approx(mean[0], rel=0.15)
        tougher = fit_twin(times(cut, 1.5).trace, measured_liver()).specimen
        ratio = np.mean(tougher.fracture_force() / twin.specimen.fracture_force())
        assert ratio == pytest.approx(1.5, rel=0.25), "what is tougher cannot be told from a sensor that reads more"


def test_held_out_halves_of_a_labs_specimens_agree_with_their_twins_unless_the_force_is_another(laid):
    env, cuts = laid
    parts, twins, notes = cut_twins(env, feed(), cuts, seed=SEED, draws=3)
    assert not notes
    assert min(part.trace.position.min() for part in parts) > 0.02
    equal = Agreement(parts, twins, twins=True)
    assert equal.verdict.answer != "differ", str(equal.verdict)
    doubled = Agreement([times(part, 2.0) for part in parts], twins, twins=True)
    (shift,) = (each.shift for each in doubled.findings if each.measure.name == "mean_force_per_depth")
    assert shift.low > shift.margin


def test_a_specimen_that_is_known_shows_a_gain_of_five_percent(laid):
    env, _ = laid
    block = Specimen.mean()
    simulated = simulate_cuts(env, feed(), seed=SEED, specimens=14, draws=3, specimen=block)
    cuts = [cut_once(env, feed(), seed=SEED, episode=k, noise=77, specimen=block) for k in range(14)]
    assert Agreement(cuts, simulated).verdict.answer != "differ"
    assert Agreement([times(cut, 1.05) for cut in cuts], simulated).verdict.answer == "differ"


def test_the_command_gives_twins_to_specimens_that_it_shall_not_know(tmp_path, capsys):
    block = tmp_path / "block.json"
    block.write_text(Specimen.mean().to_json(), encoding="utf-8")
    options = ["--policy", "constant 1.65 cm/s 90 deg", "--rig", "fake", "--target-length", "60mm"]
    options += ["--specimens", "6", "--draws", "2"]
    told = []
    for more in (["--unknown"], ["--specimen", str(block)]):
        assert main(["rig", "evaluate", *options, *more, "--json", str(tmp_path / "told.json")]) in (0, 1)
        told.append(json.loads((tmp_path / "told.json").read_text(encoding="utf-8")))
        assert ("given a twin in the simulator" in capsys.readouterr().out) == (len(told) == 1)
    assert [each["twins"] for each in told] == [True, False]
    assert all(each["paired"] for each in told)


def test_ctrl_c_between_cuts_has_the_status_of_every_command(monkeypatch, capsys):
    def interrupted(rig, *_, **__):
        rig.reset(seed=0)
        rig.session.plant.supervisor.trip(Cause.INTERRUPTED, "SIGINT", locked=True)
        return types.SimpleNamespace(rig=[], between=["specimen 1: interrupted"])

    monkeypatch.setattr("cutenv.agents.sim_to_real.paired_experiment.paired_experiment", interrupted)
    assert main(["rig", "evaluate", "--policy", "nothing", "--rig", "fake", "--specimens", "6"]) == 130
    assert "interrupted" in capsys.readouterr().err
