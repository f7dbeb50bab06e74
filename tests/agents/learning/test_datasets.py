"""Cuts as a Minari data set: nothing is lost on the way, the force is in newtons, and a clone can be taught by it."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from program import run

minari = pytest.importorskip("minari", reason="data sets are an extra: pip install 'cutenv[data]'")
pytest.importorskip("h5py", reason="data sets are an extra: pip install 'cutenv[data]'")

from cutenv.agents.learning.demonstration import ESTIMATED, FELT, HIDDEN, recorded  # noqa: E402
from cutenv.agents.learning.minari_datasets import (  # noqa: E402
    cloning_data,
    cloning_data_by_cut,
    environment_of,
    write,
)
from cutenv.agents.policy import Features  # noqa: E402
from cutenv.commands.datasets import Arguments, cuts_of  # noqa: E402
from cutenv.records import save  # noqa: E402
from cutenv.sim.cutting.dtypes import TICK  # noqa: E402
from cutenv.sim.plant import Leg, SimulatedPlant, to_trace  # noqa: E402
from cutenv.sim.plant.protocol import run as follow  # noqa: E402
from cutenv.sim.tissue import Specimen  # noqa: E402
from cutenv.sim.trace import Trace  # noqa: E402
from cutenv.task.observation import commanded_speed, in_units  # noqa: E402
from cutenv.task.registry import task_made_as  # noqa: E402

SHORT: dict[str, Any] = {"cuts": 2, "specimen_class": "liver"}
ID = "cutenv/test/cuts-v0"


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let Minari keep its data sets in a folder of this test."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "kept"))
    return tmp_path / "kept"


@pytest.fixture(scope="module")
def trace() -> Trace:
    """Make a record of a cut to 70 mm at 1.27 cm/s with a return stroke and a rest."""
    plant = SimulatedPlant(Specimen.mean())
    legs = [Leg(position=0.0785, speed=0.0127, dwell=0.2), Leg(position=0.068, speed=0.005, dwell=0.6)]
    return to_trace(plant, follow(plant, legs), target_length_m=0.07, operator="P07")


@pytest.mark.parametrize("policy", ["probe and creep", "ppo-free", "planner with truth"])
def test_a_round_trip_loses_nothing(kept: Path, policy: str) -> None:
    keywords, cuts = cuts_of(Arguments(dataset=ID, policy=policy, **SHORT))
    write(ID, policy, keywords, cuts)
    loaded = minari.load_dataset(ID)
    assert loaded.total_episodes == len(cuts) == 2
    for cut, episode in zip(cuts, loaded.iterate_episodes(), strict=True):
        for name in ("observations", "actions", "rewards"):
            given, back = getattr(cut, name), getattr(episode, name)
            assert given.dtype == back.dtype
            assert (given == back).all()
        assert set(episode.infos) == set(FELT | HIDDEN)
        assert all((episode.infos[name] == values).all() for name, values in cut.infos.items())
        assert list(np.flatnonzero(episode.terminations)) == [len(cut.actions) - 1]
        assert not episode.truncations.any()
    told = loaded.storage.metadata["cutenv"]
    assert told["infos"] == FELT | HIDDEN
    assert [component["unit"] for component in told["observations"]][:6] == ["N", "N", "N", "N", "m", "m/s"]
    assert "2.54 cm/s" in told["actions"][0]


@pytest.mark.parametrize(
    ("policy", "environment", "components"),
    [("follow the depth", "cutenv/DepthCut-v1", 22), ("steer by force", "cutenv/PathCut-v1", 28)],
)
def test_a_cut_along_a_depth_or_a_line_comes_back_with_what_its_task_adds(kept, policy, environment, components):
    keywords, cuts = cuts_of(Arguments(dataset=ID, policy=policy, **SHORT))
    write(ID, policy, keywords, cuts)
    loaded = minari.load_dataset(ID)
    assert loaded.env_spec.id == environment
    env = loaded.recover_environment()
    for cut, episode in zip(cuts, loaded.iterate_episodes(), strict=True):
        assert (episode.observations == cut.observations).all()
        assert episode.observations.shape[1:] == (components,)
        assert episode.actions.shape[1:] == (3,)
        assert set(episode.infos) == set(FELT | HIDDEN | task_made_as(environment).infos.meanings)
        if environment == "cutenv/DepthCut-v1":
            assert episode.infos["vertical_force_N"].max() > 0.1
            assert np.abs(episode.infos["floor_depth_m"] - episode.infos["wanted_depth_m"]).max() < 0.01
        else:
            assert episode.infos["tip_x_m"].max() > 0.03
        env.reset(seed=cut.seed)
        assert [env.step(action)[1] for action in episode.actions] == cut.rewards.tolist()
    written = loaded.storage.metadata["cutenv"]
    assert (len(written["observations"]), len(written["actions"])) == (components, 3)
    assert environment == "cutenv/DepthCut-v1" or "rad/s" in written["actions"][2]


def test_replayed_in_the_recovered_environment_the_actions_earn_the_recorded_rewards(kept: Path) -> None:
    arguments = Arguments(dataset=ID, policy="fast then slow", angle_mode="fixed", control_hz=20, **SHORT)
    write(ID, "script", *cuts_of(arguments))
    loaded = minari.load_dataset(ID)
    env = loaded.recover_environment()
    assert env.spec.kwargs == {"specimen_class": "liver", "angle_mode": "fixed", "control_hz": 20}
    facts = loaded.storage.get_episode_metadata(loaded.episode_indices)
    for episode, about in zip(loaded.iterate_episodes(), facts, strict=True):
        observation, info = env.reset(seed=about["seed"])
        assert (observation == episode.observations[0]).all()
        assert json.loads(about["about"]) == {"target_length_m": info["truth"]["target_length_m"]}
        for k, action in enumerate(episode.actions):
            observation, reward, ended, _, info = env.step(action)
            assert (observation == episode.observations[k + 1]).all()
            assert reward == episode.rewards[k]
            assert info["truth"]["tip_m"] == episode.infos["tip_m"][k + 1]
            assert env.unwrapped.cutting.readings["force"][-1] == episode.infos["force_N"][k + 1]
        assert ended
        assert info["is_success"] == episode.infos["is_success"][-1]


def test_what_is_felt_is_what_the_observation_says_in_the_units_of_the_names(kept: Path) -> None:
    _, (cut, _) = cuts_of(Arguments(dataset=ID, policy="90-45-90", **SHORT))
    seen = in_units(cut.observations)
    units = {"force": "N", "force_mean": "N", "force_min": "N", "force_max": "N"}
    for name, unit in {**units, "position": "m", "speed": "m_s", "depth": "m"}.items():
        assert cut.infos[f"{name}_{unit}"] == pytest.approx(seen[name], abs=1e-5), name
    assert np.radians(cut.infos["angle_deg"]) == pytest.approx(seen["angle"], abs=1e-5)
    assert 30.0 - cut.infos["time_s"] == pytest.approx(seen["time_left"], abs=1e-5)
    assert cut.infos["force_N"].max() > 1.0


def test_a_persons_record_becomes_observations_and_the_actions_that_move_a_blade_alike(trace: Trace) -> None:
    cut = recorded(trace, control_hz=20)
    ticks = round(1.0 / (20 * TICK))
    last = np.arange(1, len(cut.actions) + 1) * ticks - 1
    assert (cut.infos["force_N"][1:-1] == trace.force[last[:-1]]).all()  # the task ends within the last decision
    assert (cut.infos["position_m"][1:-1] == trace.position[last[:-1]]).all()
    moved = np.cumsum(commanded_speed(cut.actions[:, 0].astype(float))) / 20
    assert trace.position[0] + moved == pytest.approx(trace.position[last], abs=1e-5)
    assert cut.observations.shape == (len(cut.actions) + 1, 12)
    assert set(cut.infos) == set(FELT | ESTIMATED)
    assert cut.terminated
    assert cut.infos["is_success"][-1] == 1.0
    assert cut.about["operator"] == "P07"
    assert cut.about["faster_than_reach"] == 0.0
    assert 0.3 < cut.rewards.sum() < 1.0


def test_a_record_that_ends_before_the_task_is_truncated(trace: Trace) -> None:
    cut = recorded(trace.select(slice(0, 2000)), control_hz=10)
    assert not cut.terminated
    assert len(cut.actions) == 20


def test_records_become_a_data_set_in_an_environment_that_assesses_by_estimates(kept, trace, tmp_path):
    save(trace, tmp_path / "mine.csv")
    write(ID, "people", *cuts_of(Arguments(dataset=ID, records=(str(tmp_path / "mine.csv"),))))
    loaded = minari.load_dataset(ID)
    assert loaded.recover_environment().spec.kwargs["reward_from"] == "estimate"
    (facts,) = loaded.storage.get_episode_metadata([0])
    assert json.loads(facts["about"])["record"] == "mine.csv"
    assert "seed" not in facts
    assert loaded.storage.metadata["cutenv"]["infos"] == FELT | ESTIMATED
    assert loaded[0].infos["force_N"].max() == pytest.approx(trace.force.max(), abs=0.5)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"angle": None}, r"mine\.csv, cut 1: a replay needs angle"),
        ({"depth": None}, r"mine\.csv, cut 1: a replay needs depth"),
        ({"metadata": {}}, r"mine\.csv, cut 1: the record has no target_length_m.*--target-length"),
    ],
)
def test_a_record_that_lacks_something_is_named_with_it(trace, tmp_path, changes, told):
    save(dataclasses.replace(trace, **changes), tmp_path / "mine.csv")
    with pytest.raises(ValueError, match=told):
        cuts_of(Arguments(dataset=ID, records=(str(tmp_path / "mine.csv"),)))


def test_a_target_that_the_record_does_not_tell_can_be_given(trace: Trace, tmp_path: Path) -> None:
    save(dataclasses.replace(trace, metadata={}), tmp_path / "mine.csv")
    _, (cut,) = cuts_of(Arguments(dataset=ID, records=(str(tmp_path / "mine.csv"),), target_length="72mm"))
    assert cut.about["target_length_m"] == pytest.approx(0.072)


def test_lessons_are_the_features_that_an_agent_sees_and_the_actions(kept: Path) -> None:
    dataset = write(ID, "script", *cuts_of(Arguments(dataset=ID, policy="force feedback", **SHORT)))
    shown, taught = cloning_data(dataset, history=2)
    cuts = list(cloning_data_by_cut(dataset, history=2))
    assert (np.concatenate([own for own, _ in cuts]) == shown).all()
    assert (taught == np.concatenate([episode.actions for episode in dataset.iterate_episodes()])).all()
    for force in (True, False):  # nothing of the first cut is remembered
        features, shown = Features(history=2, force=force), cloning_data(dataset, history=2, force=force)[0]
        expected = [features(observation) for observation in dataset[1].observations[:-1]]
        assert (shown[-len(expected) :] == expected).all()


def test_what_the_actions_of_a_data_set_mean_is_told_or_it_is_refused(kept: Path) -> None:
    keywords, cuts = cuts_of(Arguments(dataset=ID, policy="nothing", cuts=1, control_hz=20))
    assert environment_of(write(ID, "nothing", keywords, cuts)) == {"control_hz": 20, "angle_mode": "free"}
    default = write("cutenv/test/default-v0", "nothing", {}, cuts)
    assert environment_of(default) == {"control_hz": 50, "angle_mode": "free"}
    inclined = write("cutenv/test/inclined-v0", "nothing", {"angle_mode": "fixed", "fixed_angle_deg": 60.0}, cuts)
    assert environment_of(inclined) == {"control_hz": 50, "angle_mode": "fixed", "fixed_angle_deg": 60.0}


def test_a_data_set_of_another_environment_teaches_nothing(kept: Path) -> None:
    from minari.data_collector import EpisodeBuffer

    buffer = EpisodeBuffer(
        observations=np.zeros((2, 4), np.float32),  # type: ignore[arg-type]
        actions=np.zeros(1, np.int64),  # type: ignore[arg-type]
        rewards=[1.0],
        terminations=[True],
        truncations=[False],
    )
    with pytest.warns(UserWarning, match="is set to None"):
        other = minari.create_dataset_from_buffers("other/cart-v0", [buffer], env="CartPole-v1")
    with pytest.raises(ValueError, match=r"'other/cart-v0' has observations of shape \(4,\)"):
        cloning_data(other, history=0)
    with pytest.raises(ValueError, match="is of environment CartPole-v1; give one of cutenv/GentleCut-v1"):
        environment_of(other)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"dataset": "mine", "policy": "random"}, "id with a version"),
        ({"dataset": ID}, "either --policy"),
        ({"dataset": ID, "policy": "random", "records": ("a.csv",)}, "either --policy"),
        ({"dataset": ID, "policy": "random", "seed": 999_999, "cuts": 2}, "kept for validation and test"),
        ({"dataset": ID, "policy": "random", "control_hz": 30}, "does not divide 1000"),
    ],
)
def test_bad_arguments_are_refused_in_words(given: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        Arguments(**given)


def test_the_program_records_and_says_where(kept: Path, tmp_path: Path) -> None:
    given = ("--dataset", ID, "--policy", "nothing", "--cuts", "1")
    done = run("datasets", tmp_path, *given)
    assert done.returncode == 0, done.stderr
    assert f"1 cuts, 300 decisions in {kept / ID}" in done.stdout
    assert minari.load_dataset(ID).total_steps == 300
    again = run("datasets", tmp_path, *given)
    assert again.returncode != 0
    assert "Traceback" not in again.stderr
    assert "give another id" in again.stderr
