"""SAC, TQC and CrossQ as a user runs them, small: they learn from demonstrations and trial, export, and go on."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
from program import rows, run

pytest.importorskip("sb3_contrib", reason="the learners are an extra: pip install 'cutenv[rl]'")
torch = pytest.importorskip("torch", reason="the learners are an extra: pip install 'cutenv[rl]'")

from cutenv.agents.learning.arguments import BadArguments, SACArguments  # noqa: E402
from cutenv.agents.learning.cloning import script_demonstrations  # noqa: E402
from cutenv.agents.learning.off_policy import OFF_POLICY, imitate, network, remember  # noqa: E402
from cutenv.commands.train import LEARNERS  # noqa: E402


def decisions(folder: Path) -> list[float]:
    return [float(row["decisions"]) for row in rows(folder / "learning_curve.csv")]


@pytest.mark.parametrize("learner", OFF_POLICY)
def test_a_resumed_run_goes_on_from_its_checkpoint_with_the_demonstrations(trained, tmp_path, learner):
    folder = shutil.copytree(trained(learner)[0], tmp_path / "runs" / "small")
    before = OFF_POLICY[learner].algorithm.load(folder / "checkpoint.zip", device="cpu")
    done = run("train", tmp_path, "--resume", "runs/small", "--timesteps", "1200")
    assert done.returncode == 0, done.stderr
    assert "resuming after 600 decisions" in done.stdout
    assert "the replay buffer begins again, with the demonstrations" in done.stdout
    after = OFF_POLICY[learner].algorithm.load(folder / "checkpoint.zip", device="cpu")
    assert after.num_timesteps == 1200
    pairs = zip(before.policy.actor_parameters(), after.policy.actor_parameters(), strict=True)
    assert any((one != other).any() for one, other in pairs)
    assert decisions(folder) == sorted(decisions(folder))


def untrained(learner: str, **options: object) -> tuple[object, SACArguments]:
    small = {"environments": 4, "demonstrations": 2000, "hidden": 16, "critic_hidden": 16}
    arguments = LEARNERS[learner][1](**small | options)
    return OFF_POLICY[learner].new_model(arguments, arguments.training_environments()), arguments


def test_the_replay_buffer_begins_with_what_was_done_and_never_joins_it_to_the_agents_cuts():
    model, arguments = untrained("sac")
    shown = script_demonstrations(model.get_env(), arguments)
    remember(model, shown)
    replay, count = model.replay_buffer, len(shown.starts) - 1
    assert replay.pos == count
    assert (replay.actions[:count] == shown.taken[:count]).all()
    assert (replay.rewards[:count] == shown.rewards[:count]).all()
    assert (replay.dones[: count - 1] == shown.starts[1:count]).all()
    assert replay.dones[count - 1].all()
    assert (replay.timeouts[count - 1] == ~shown.starts[count]).all()


@pytest.mark.parametrize("learner", OFF_POLICY)
def test_the_actor_learns_what_is_demonstrated_and_explores_as_told(learner):
    model, arguments = untrained(learner, exploration=0.05)
    shown = script_demonstrations(model.get_env(), arguments)
    seen, wanted = shown.by_decision().observations, shown.by_decision().actions
    with torch.no_grad():
        before = float(((model.policy.action_for(seen) - wanted) ** 2).mean().sqrt())
    assert imitate(model.policy, shown, arguments) < 0.6 * before
    actor = model.policy.actor
    drawn = torch.atanh(actor(seen[:1].repeat(4000, 1)).clamp(-0.999999, 0.999999))
    assert drawn.std(0).mean().item() == pytest.approx(0.05, rel=0.3)


def test_a_normalisation_left_out_is_noticed():
    model, arguments = untrained("crossq")
    imitate(model.policy, script_demonstrations(model.get_env(), arguments), arguments)
    arrays = {name: values.detach().numpy() for name, values in model.policy.state_dict().items()}
    features = np.random.default_rng(0).uniform(-1.0, 1.0, (50, arguments.sizes["features"])).astype(np.float32)
    with torch.no_grad():
        expected = model.policy.action_for(torch.as_tensor(features)).numpy()
    assert network(arrays, "relu")(features) == pytest.approx(expected, abs=1e-5)
    without = {name: values for name, values in arrays.items() if ".0." not in name or "latent_pi" not in name}
    assert abs(network(without, "relu")(features) - expected).max() > 0.05


def test_rewards_are_summed_over_several_decisions_up_to_the_end_of_a_cut():
    model, arguments = untrained("sac", n_steps=1000, demonstrations=1200)
    shown = script_demonstrations(model.get_env(), arguments)
    remember(model, shown)
    begun = [(k, n) for k, n in zip(*np.nonzero(shown.starts), strict=True) if shown.starts[k + 1 :, n].any()]
    returns = []
    for k, n in begun:  # whole cuts
        after = k + 1 + int(np.flatnonzero(shown.starts[k + 1 :, n])[0])
        returns.append(shown.rewards[k:after, n].sum())
    drawn = model.replay_buffer.sample(20_000)  # each of 1196 decisions, but for a chance of 1e-4
    assert begun
    for total in returns:
        assert abs(drawn.rewards.numpy() - total).min() < 1e-4


def test_the_critic_may_be_shown_the_features_alone():
    model, arguments = untrained("sac", critic="features")
    assert model.critic.q_networks[0][0].in_features == arguments.sizes["features"] + 2


def test_options_without_sense_are_refused():
    for value in ("much", "auto", "-1"):
        with pytest.raises(BadArguments, match=f"--ent-coef '{value}' is neither a number nor auto_NUMBER"):
            SACArguments(ent_coef=value)
    with pytest.raises(BadArguments, match="--buffer-size 100 does not hold the 200000 demonstrations"):
        SACArguments(buffer_size=100)
    assert dataclasses.replace(SACArguments(), ent_coef="1e-4").ent_coef == "1e-4"
