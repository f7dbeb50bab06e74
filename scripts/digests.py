"""Digests of what the project computes, compared with the committed ones: they show which bits a change has moved.

    python -m scripts.digests --check [--quick] [--only gentle/ depth/]
    python -m scripts.digests --write [--quick] [--only gentle/ depth/]

Prints the name of every digest that moved.  A name says what it is of: ``gentle/single/script/info`` are the infos of
single environments of gentle cutting under a script.  With ``--quick`` there are fewer specimens, and digests of their
own.  The digests are in ``tests/envs/digests.json``, by portability: "portable" ones are the same on every
machine, those from "here" depend on the libraries for linear algebra and learning, and may move on another processor.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import sys
import tempfile
import time
import traceback
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np

import cutenv  # noqa: F401  registers the environments
from cutenv.agents.policy import ConstantFeed, PlannerNominal, ProbeAndCreep
from cutenv.agents.policy.depth_policies import FollowDepth
from cutenv.agents.policy.interface import ArrayPolicy, script_of
from cutenv.agents.policy.path_policies import BladeOnLine
from cutenv.sim.plant import DescendingPlant, FreehandPlant, SimulatedPlant, SteeredPlant
from cutenv.sim.tissue import Specimen
from cutenv.sim.tissue.lines import arc, s_shape
from cutenv.task import registry
from scripts import ROOT

FILE = ROOT / "tests" / "envs" / "digests.json"
DECISIONS, HOLD = 60, 4  # of a cut by random actions
UPRIGHT = np.pi / 2
Digests = Iterator[tuple[str, str]]


class Task(NamedTuple):
    """Task: its entry, its simplest script, rounds of its planner with truth, and arguments of its variants."""

    entry: registry.RegisteredTask
    script: Callable[[], ArrayPolicy]
    rounds: int
    variants: Mapping[str, dict[str, Any]]

    def held(self) -> HeldRandomActions:
        """Return random actions that are held."""
        return HeldRandomActions(len(self.entry.task.action_names))


_OF_EVERY_TASK: dict[str, dict[str, Any]] = {
    **{f"class {name}": {"specimen_class": name} for name in ("uniform", "liver", "vascular")},
    "fixed angle": {"angle_mode": "fixed", "fixed_angle_deg": 60.0},
    "drive pd": {"drive": "pd"},
    "drive hand": {"drive": "hand"},
    "50 Hz and a deadline": {"control_hz": 50, "deadline_s": 1.0},
    "given length": {"target_length": 0.07},
    "near the target": {"start_before_target": 0.02},
    "weights": {"weight_jump": 0.2, "weight_force": 0.1, "weight_stored": 0.5},
    "rig's constants": {"dead_time": 0.01, "backlash": 0.0005, "force_noise": 0.2, "force_delay": 0.03},
}
_GIVEN_LINE = [(0.0, 0.0), (0.05, 0.002), (0.1, 0.008), (0.149, 0.012)]
TASKS = {
    "gentle": Task(
        registry.TASKS["gentle"], partial(ConstantFeed, speed=0.0127), 2,
        {
            "SafeCut": {"id": "cutenv/SafeCut-v1"},
            "GentleCutRaw": {"id": "cutenv/GentleCutRaw-v1"},
            "GentleCutRaw hidden state": {"id": "cutenv/GentleCutRaw-v1", "hidden_state": True},
            "reward from estimate": {"reward_from": "estimate"},
        },
    ),
    "depth": Task(
        registry.TASKS["depth"], FollowDepth, 1,
        {
            **{f"wanted {kind}": {"wanted": kind} for kind in ("constant", "ramp", "step", "profile")},
            "no layer": {"layer": False},
            "depth's constants": {"weight_uncut": 0.3, "surface_spread": 0.0, "edge_length": 2e-4},
        },
    ),
    "path": Task(
        registry.TASKS["path"], BladeOnLine, 1,
        {
            **{f"line {kind}": {"line": kind} for kind in ("straight", "arc", "s", "excision", "random")},
            "given line": {"line": _GIVEN_LINE},
            "path's constants": {"weight_off_line": 0.4, "crack_curvature": 80.0, "line_limit": 0.004},
        },
    ),
}  # fmt: skip


class Content:
    """SHA-256 of numbers, texts, arrays and mappings of them, without regard to the order of the keys."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def add(self, value: Any) -> None:
        """Add a value; equal ones of Python and NumPy are the same."""
        add = self._hash.update
        if isinstance(value, np.generic) and value.dtype.names is None:
            value = value.item()
        if isinstance(value, Mapping):
            add(b"{%d" % len(value))
            for name in sorted(value):
                self.add(name)
                self.add(value[name])
        elif value is None or isinstance(value, (bool, int, str)):
            add(f"{value!r};".encode())
        elif isinstance(value, float):
            add(value.hex().encode())
        elif isinstance(value, np.ndarray) and value.dtype.names is not None:
            self.add({name: value[name] for name in value.dtype.names})
        elif isinstance(value, np.ndarray) and value.dtype != object:
            add(f"{value.dtype.str}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
        elif isinstance(value, (list, tuple, np.ndarray)):
            add(b"[%d" % len(value))
            for each in value:
                self.add(each)
        elif isinstance(value, bytes):
            add(value)
        else:
            raise TypeError(f"value is of type {type(value).__name__}, which has no canonical bytes: add its parts.")

    def digest(self) -> str:
        """Return the first 32 digits of the hash."""
        return self._hash.hexdigest()[:32]


def digest(*values: Any) -> str:
    """Return the digest of some values."""
    content = Content()
    for value in values:
        content.add(value)
    return content.digest()


class HeldRandomActions(ArrayPolicy):
    """Seeded random actions, mostly forward, each held for some decisions."""

    def __init__(self, actions: int) -> None:
        self._low, self._high = np.array([-0.4, -1.0, -0.35][:actions]), np.array([1.0, 1.0, 0.35][:actions])

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Draw the actions of ``len(rngs)`` cuts."""
        shape = DECISIONS // HOLD, len(self._low)
        drawn = np.stack([rng.uniform(self._low, self._high, shape) for rng in rngs])
        self._actions, self._decision = drawn.repeat(HOLD, axis=1).astype(np.float32), 0

    def forget(self, cuts: Any) -> None:
        """Do nothing: the next cuts go on with the random numbers."""

    def act(self, observations: Any) -> Any:
        """Return the next action of each cut."""
        self._decision += 1
        return self._actions[:, (self._decision - 1) % DECISIONS]


class SingleCut(NamedTuple):
    """One cut: observations, rewards, ends, all infos, and readings at 1 kHz, decision after decision."""

    observations: Any
    rewards: Any
    ended: Any
    infos: list[dict[str, Any]]
    readings: list[Any]


def single_cut(env: Any, policy: Any, seed: int, most: int, *, readings: bool = False, **options: Any) -> SingleCut:
    """Cut the specimen of a seed in a single environment, for at most ``most`` decisions."""
    observation, info = env.reset(seed=seed, options=options or None)
    policy.reset(np.random.default_rng(seed))
    seen, rewards, ends, infos, kept = [observation], [], [], [info], []
    ended = False
    while not ended and len(rewards) < most:
        observation, reward, ended, truncated, info = env.step(policy(observation))
        seen.append(observation)
        rewards.append(reward)
        ends.append((ended, truncated))
        infos.append(info)
        if readings:
            kept.append(env.unwrapped.cutting.readings.copy())
    return SingleCut(np.array(seen), np.array(rewards), np.array(ends), infos, kept)


def single_digests(cuts: Sequence[SingleCut]) -> Digests:
    """Yield the digests of cuts by what they consist of."""
    names = ("observations", "rewards", "ended", "infos", *(["readings"] if cuts[0].readings else []))
    for name in names:
        yield name, digest([getattr(each, name) for each in cuts])


class ManyCuts(NamedTuple):
    """Cuts of a vector environment: digests by name, observations, rewards and ends with axes (decision, cut)."""

    digests: dict[str, str]
    observations: Any
    rewards: Any
    ended: Any
    rows: dict[int, dict[str, Any]]


def row_of(info: Mapping[str, Any], n: int) -> dict[str, Any]:
    """Return the info of one environment of a vector of them."""
    names = [name for name in info if not name.startswith("_") and np.all(info[f"_{name}"][n])]
    return {name: row_of(info[name], n) if isinstance(info[name], dict) else info[name][n] for name in names}


def many_cuts(envs: Any, policy: ArrayPolicy, most: int, last: Mapping[int, int], **options: Any) -> ManyCuts:
    """Cut in a vector environment until every cut has ended once, for at most ``most`` decisions.

    ``last`` has the number of decisions of those cuts whose last info is kept.
    """
    count = envs.num_envs
    observations, info = envs.reset(seed=0, options=options or None)
    policy.begin([np.random.default_rng(seed) for seed in range(count)])
    seen, rewards, ends = [observations.copy()], [], []
    infos, rows, over, waiting = Content(), {}, np.zeros(count, bool), np.zeros(count, bool)
    infos.add(info)
    at: dict[int, list[int]] = defaultdict(list)
    for n, decisions in last.items():
        at[decisions].append(n)
    while len(rewards) < most and not over.all():
        observations, reward, ended, truncated, info = envs.step(policy.act(observations))
        policy.forget(np.flatnonzero(waiting))
        waiting, over = ended, over | ended
        seen.append(observations.copy())
        rewards.append(reward.copy())
        ends.append(np.stack([ended, truncated], axis=1))
        infos.add(info)
        rows |= {n: row_of(info, n) for n in at[len(rewards)]}
    arrays = np.array(seen), np.array(rewards), np.array(ends)
    found = dict(zip(("observations", "rewards", "ended"), map(digest, arrays), strict=True))
    return ManyCuts(found | {"infos": infos.digest()}, *arrays, rows)


def differing_row(many: ManyCuts, cuts: Sequence[SingleCut]) -> str:
    """Return the first difference between rows of a vector environment and single cuts, or that there is none."""
    for n, cut in enumerate(cuts):
        k = len(cut.rewards)
        for name in ("observations", "rewards", "ended"):
            own = getattr(cut, name)
            if getattr(many, name)[: len(own), n].tobytes() != own.tobytes():
                return f"{name} of seed {n} differ"
        if digest(many.rows[n]) != digest(cut.infos[k]):
            return f"last info of seed {n} differs"
    return "rows equal single cuts"


def both(task: Task, keywords: Mapping[str, Any], policy: ArrayPolicy, singles: int, count: int, most: int) -> Digests:
    """Yield the digests of single environments and of a vector of them, and whether they agree."""
    own = dict(keywords)
    name = own.pop("id", task.entry.id)
    env = gymnasium.make(name, **own)
    cuts = [single_cut(env, policy, seed, most) for seed in range(singles)]
    for part, found in single_digests(cuts):
        yield f"single/{part}", found
    envs = gymnasium.make_vec(name, num_envs=count, **own)
    many = many_cuts(envs, policy, most, {n: len(cut.rewards) for n, cut in enumerate(cuts)})
    for part, found in many.digests.items():
        yield f"vector/{part}", found
    yield "vector/rows", differing_row(many, cuts)


def random_digests(task: Task, quick: bool) -> Digests:
    """Yield the digests of cuts by random actions."""
    count = 50 if quick else 1000
    return both(task, {"control_hz": 10}, task.held(), count, count, DECISIONS)


def script_digests(task: Task, quick: bool) -> Digests:
    """Yield the digests of whole cuts by the task's simplest script."""
    singles, count = (10, 50) if quick else (100, 1000)
    return both(task, {}, task.script(), singles, count, 1500)


def variant_digests(task: Task, quick: bool) -> Digests:
    """Yield a digest of each variant of the task: the parts of single cuts and of a vector environment together."""
    count = 2 if quick else 10
    for name, keywords in {**_OF_EVERY_TASK, **task.variants}.items():
        rate = {} if "id" in keywords else {"control_hz": 10}
        found = dict(both(task, {**rate, **keywords}, task.held(), count, count, DECISIONS))
        yield f"{name}/rows", found.pop("vector/rows")
        yield name, digest(found)


def reset_digests(task: Task, quick: bool) -> Digests:
    """Yield digests of options of a reset, and of vector environments that begin the next cut in their own ways."""
    policy, short = task.held(), {"control_hz": 10, "deadline_s": 2.0}
    env = gymnasium.make(task.entry.id, **short)
    options = {"specimen": Specimen.drawn(3, 4).to_json(), "target_length": 0.065, "episode": 7}
    for name, value in options.items():
        yield f"option {name}", digest(*single_cut(env, policy, 11, DECISIONS, **{name: value}))
    count = 4 if quick else 32
    for mode in ("NextStep", "SameStep"):
        envs = gymnasium.make_vec(task.entry.id, num_envs=count, autoreset_mode=mode, **short)
        observations, info = envs.reset(seed=5)
        policy.begin([np.random.default_rng(seed) for seed in range(count)])
        content = Content()
        content.add([observations, info])
        for _ in range(DECISIONS):
            content.add(list(envs.step(policy.act(observations))))
        yield f"autoreset {mode}", content.digest()


def feature_digests(task: Task, quick: bool) -> Digests:
    """Yield digests of features along a cut, and of the actions of every script on the same observations."""
    for seed in range(1 if quick else 3):
        seen = single_cut(gymnasium.make(task.entry.id, control_hz=10), task.script(), seed, 300).observations
        for history in (0, 6):
            features = task.entry.features(history=history)
            yield f"features/history {history}/seed {seed}", digest([features(each) for each in seen])
        for name in task.entry.scripts:
            script = script_of(task.entry, name)
            script.reset(np.random.default_rng(seed))
            yield f"scripts/{name}/seed {seed}", digest([script(each) for each in seen])


def commands(seed: int, count: int) -> Iterator[tuple[float, float, int, float]]:
    """Yield speeds [m/s], angles [rad], milliseconds, and numbers from -1 to 1 for a third axis."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        speed, angle = rng.uniform(-0.008, 0.0254), rng.uniform(np.pi / 4, UPRIGHT)
        yield speed, angle, int(rng.choice([1, 3, 20, 50, 137, 300])), rng.uniform(-1.0, 1.0)


def specimens(quick: bool) -> Iterator[tuple[int, Specimen, int]]:
    """Yield seeds, specimens and numbers of commands for plants."""
    for seed, name in enumerate(["uniform", "liver", "vascular"] * (1 if quick else 5)):
        yield seed, Specimen.drawn(seed, 0, specimen_class=name), 20 if quick else 60


def plant_digest(plant: Any, seed: int, count: int, third: float = 0.0, beside: str = "") -> str:
    """Return the digest of a plant's readings and energies under a sequence of commands."""
    content = Content()
    for speed, angle, ticks, other in commands(seed, count):
        content.add(plant.advance(speed, angle, ticks, *([third * other] if beside else [])))
        if beside:
            content.add(getattr(plant, beside))
    content.add(plant.energy())
    return content.digest()


def plant_digests(made: Callable[[Specimen, int], Any], third: float, beside: str, quick: bool) -> Digests:
    """Yield digests of cuts by a plant that is made of a specimen and its seed."""
    for seed, specimen, count in specimens(quick):
        yield f"{seed}", plant_digest(made(specimen, seed), seed, count, third, beside)


PLANTS: dict[str, tuple[Callable[[Specimen, int], Any], float, str]] = {
    "simulated": (lambda specimen, seed: SimulatedPlant(specimen, seed=seed), 0.0, ""),
    "descending": (lambda specimen, seed: DescendingPlant(specimen, seed=seed, level=0.005), 0.004, "vertical_force"),
    "steered": (
        lambda specimen, seed: SteeredPlant(specimen, (arc(0.06), s_shape(0.05))[seed % 2], seed=seed),
        0.3,
        "lateral_force",
    ),
    "freehand": (lambda specimen, seed: FreehandPlant(specimen, seed=seed), 0.3, "lateral_force"),
}
"""Plants by name, each with the size of the command of its third axis, and the force that is read beside."""


def rig_digests(quick: bool) -> Digests:
    """Yield digests of cuts on rigs in memory."""
    for task, script in zip(TASKS.values(), (ProbeAndCreep, FollowDepth, BladeOnLine), strict=True):
        name = task.entry.rig_id.removeprefix("cutenv/").removesuffix("-v1")
        env = gymnasium.make(task.entry.rig_id, rig="fake", target_length=0.06)
        most = 150 if quick else 2000
        cuts = [single_cut(env, script(), 5, most, readings=True, episode=n) for n in range(1 if quick else 2)]
        for part, found in single_digests(cuts):
            yield f"{name}/{part}", found
        env.close()


def browser_digests(name: str, quick: bool) -> Digests:
    """Yield digests of a task's cuts by hand as the page makes them."""
    milliseconds = np.arange(4000 if quick else 12_000)
    place = np.minimum(1.2e-5 * milliseconds, 0.1) - 0.004 * (milliseconds % 3000 > 2500)
    angle = 1.2 + 0.3 * (milliseconds // 700 % 2)
    third = 1e-6 * (milliseconds % 1000) - 5e-4
    for seed, specimen_class in enumerate(("liver", "vascular", "uniform")[: 1 if quick else 3]):
        cut = registry.TASKS[name].hand(specimen_class=specimen_class, seed=seed)
        readings = cut.follow(np.stack([place, angle, third], axis=1)[:, : len(cut.led.task.action_names)])
        yield f"readings/{seed}", digest(readings, cut.channels, cut.end, cut.success)
        trace = cut.trace(readings, **cut.noted)
        yield f"record/{seed}", digest({each: getattr(trace, each) for each in trace.known}, trace.metadata)


def program_digests(quick: bool) -> Digests:
    """Yield digests of the programs that the page carries, and of the names that they export."""
    import wasmtime

    from cutenv.people.browser.page_data import law_of

    for name in TASKS:
        program = law_of(name)
        yield f"{name}/bytes", digest(program)
        exports = wasmtime.Module(wasmtime.Engine(), program).exports
        yield f"{name}/exports", digest(sorted(each.name for each in exports))


def learner_digests(quick: bool) -> Digests:
    """Yield digests of the weights after a very short training by the project's own PPO, on each task."""
    from cutenv.agents.learning.arguments import PPOArguments
    from cutenv.agents.learning.on_policy import ON_POLICY, train

    chosen = {
        "environments": 4, "rollout": 32, "batch_size": 64, "timesteps": 256 if quick else 1280, "validations": 1,
        "validation_specimens": 2, "specimens": 0, "seed": 0,
    }  # fmt: skip
    for task in TASKS:
        with tempfile.TemporaryDirectory() as folder:
            own = {"task": task, "demonstrations": 400 if task == "gentle" else 0}  # the others start from a script
            arguments = PPOArguments(**PPOArguments.completed(own | chosen))
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                train(ON_POLICY["ppo"], arguments, Path(folder), False)
            for name in ("untrained", "policy", "checkpoint"):
                model = ON_POLICY["ppo"].algorithm.load(Path(folder) / f"{name}.zip", device="cpu")
                weights = {key: value.numpy() for key, value in model.policy.state_dict().items()}
                yield f"{task}/{name}", digest(weights)


def planner_digests(quick: bool) -> Digests:
    """Yield digests of the actions of planners."""
    for name, task in TASKS.items():
        env = gymnasium.make(task.entry.id, control_hz=10)
        for seed in range(1 if quick else 3):
            observation, _ = env.reset(seed=seed)
            planner = task.entry.planner(rounds=task.rounds)
            planner.reset(np.random.default_rng(seed))
            planner.set_state(env.unwrapped.cutting)
            yield f"{name}/with truth/{seed}", digest([planner(observation) for _ in range(100)])
    yield "gentle/nominal", digest(PlannerNominal(rounds=1).plan_for(0.08))


def score_digests(quick: bool) -> Digests:
    """Yield digests of score cards, and of the scores of cuts in batches."""
    from cutenv.agents.learning.evaluation import batched_rollout
    from cutenv.agents.sim_to_real.paired_experiment import cut_once

    for name, task in TASKS.items():
        for seed in range(1 if quick else 3):
            cut = cut_once(gymnasium.make(task.entry.id).unwrapped, task.script(), seed=seed, episode=0)
            yield f"{name}/card/{seed}", digest(cut.card.to_json())
        arguments = {"task": name, "control_hz": 10}
        cuts = batched_rollout(task.script(), range(4 if quick else 100), arguments, readings=True)
        yield f"{name}/scores", digest([cut.scores() for cut in cuts])
        yield f"{name}/metrics", digest([cut.metrics() for cut in cuts])


def estimated_digests(quick: bool) -> Digests:
    """Yield digests of cuts in the simulator that are assessed as a rig's."""
    from cutenv.agents.sim_to_real.paired_experiment import cut_once, simulator_like

    for name, task in TASKS.items():
        with_rig = gymnasium.make(task.entry.rig_id, rig="fake").unwrapped
        env = simulator_like(with_rig, target_length=0.06)
        for episode in range(1 if quick else 4):
            cut = cut_once(env, task.script(), seed=5, episode=episode, noise=episode)
            yield f"{name}/{episode}", digest(cut.value, cut.end, cut.success, cut.card.to_json())
        with_rig.close()


_OF_TASK = {
    "random": random_digests, "variant": variant_digests, "reset": reset_digests, "script": script_digests,
    "policy": feature_digests,
}  # fmt: skip
GROUPS: dict[str, Callable[[bool], Digests]] = {
    **{f"{name}/{part}": partial(compute, task) for name, task in TASKS.items() for part, compute in _OF_TASK.items()},
    **{f"browser/{name}": partial(browser_digests, name) for name in TASKS},
    "browser/programs": program_digests,
    **{f"plant/{name}": partial(plant_digests, *plant) for name, plant in PLANTS.items()},
    "rig": rig_digests,
    "learner": learner_digests,
    "planner": planner_digests,
    "score": score_digests,
    "announced/estimated": estimated_digests,
}
"""Functions that compute digests, quick ones if asked to, by group; a digest's name begins with that of its group."""
PORTABLE = (
    *(f"{name}/{part}" for name in ("gentle", "depth") for part in ("random", "variant", "reset")),
    "path/random", "path/reset", "browser/gentle", "browser/depth", "plant/simulated", "plant/descending",
)  # fmt: skip
"""Groups that NumPy and BLAS for another processor do not change; the stiffness of a given line comes from BLAS."""


def computed(name: str, *, quick: bool) -> dict[str, str]:
    """Return the digests of a group by their names, and the error by the group's name if it cannot be computed."""
    found: dict[str, str] = {}
    try:
        for part, value in GROUPS[name](quick):
            found[f"{name}/{part}"] = value
    except Exception as error:  # a name that was changed must not hide the other groups
        traceback.print_exc()
        found[name] = f"{type(error).__name__}: {error}"
    return found


def differences(found: Mapping[str, str], kept: Mapping[str, str]) -> list[str]:
    """Return a line for each digest that moved, is missing or is new."""
    lines = []
    for name in sorted({*found, *kept}):
        if name not in kept:
            lines.append(f"new      {name}: {found[name]}")
        elif name not in found:
            lines.append(f"missing  {name}")
        elif found[name] != kept[name]:
            lines.append(f"moved    {name}: {kept[name]} is now {found[name]}")
    return lines


def read() -> dict[str, dict[str, dict[str, str]]]:
    """Return the committed digests by "full" or "quick", then by "portable" or "here", then by name."""
    return json.loads(FILE.read_text(encoding="utf-8"))


def chosen_groups(only: Iterable[str] | None) -> list[str]:
    """Return the names of the groups that begin with one of these texts; of all, for None."""
    names = [name for name in GROUPS if only is None or name.startswith(tuple(only))]
    if not names:
        raise SystemExit(f"--only: no group begins so; there are {', '.join(GROUPS)}.")
    return names


def main() -> int:
    """Compare or write; return 1 if a digest moved."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    action = parser.add_mutually_exclusive_group(required=True)
    action.add_argument("--check", action="store_true", help="compare with the committed digests")
    action.add_argument("--write", action="store_true", help="write the digests as they are now")
    parser.add_argument("--quick", action="store_true", help="fewer specimens, some seconds")
    parser.add_argument("--only", nargs="+", metavar="START", help="groups whose names begin with one of these alone")
    arguments = parser.parse_args()
    size = "quick" if arguments.quick else "full"
    kept = read() if FILE.is_file() else {}
    moved = 0
    for name in chosen_groups(arguments.only):
        where = "portable" if name in PORTABLE else "here"
        begun = time.process_time()
        found = computed(name, quick=arguments.quick)
        print(f"{name}: {len(found)} digests, {time.process_time() - begun:.1f} s of CPU", flush=True)
        others = kept.setdefault(size, {"portable": {}, "here": {}})
        before = {key: others[where][key] for key in others[where] if key == name or key.startswith(f"{name}/")}
        if arguments.write:
            for each in others.values():
                for key in [key for key in each if key == name or key.startswith(f"{name}/")]:
                    del each[key]
            others[where] |= found
            continue
        for line in differences(found, before):
            print(line if name in PORTABLE else f"{line} (another processor may move it)", flush=True)
            moved += 1
    if arguments.write:
        FILE.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        return 0
    print(f"{moved} digests moved" if moved else "no digest moved")
    return int(moved > 0)


if __name__ == "__main__":
    sys.exit(main())
