"""Options of learners and their defaults, a dataclass each, for ``cutenv train``.

They are those of learners by trial (PPO, SAC, TQC, CrossQ), and of those by imitation and from data (BC, IQL).

Nothing here loads torch, so that ``cutenv train --help`` answers at once.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from cutenv.agents.learning.option_fields import check_ranges, drawn_as, flag_of, option
from cutenv.agents.learning.seeds import TEST_SEEDS, TRAINING_SEEDS, VALIDATION_SEEDS
from cutenv.agents.policy import SCRIPTS
from cutenv.envs.constants import rig_constants
from cutenv.envs.tissue_source import TissueSource
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.task.registry import TASKS, RegisteredTask, task_of, tasks_in_words

if TYPE_CHECKING:
    from cutenv.agents.learning.environment_groups import EnvironmentGroups
    from cutenv.agents.sb3 import FeatureVecEnv


MAX_ENVIRONMENTS = 1000  # number of training seeds that belong to one run: that with seed k has those from 1000 k on


_UPRIGHT = 0.8  # angle action of a blade that is upright enough for a success
_EASIER_GROUPS = 8  # of EasierEnvironments

QUICKLY: Mapping[str, Any] = {"validations": 4, "validation_specimens": 50, "specimens": 30}
"""Values that ``--quick`` sets for every learner."""


class BadArguments(ValueError):
    """Error for options that contradict each other or are wrong.

    They may be out of range or not fit a data set; the message names the cure.
    """


def for_rig(chosen: Mapping[str, Any]) -> dict[str, Any]:
    """Return options with a rig file's blade angle and decision rate.

    Raises BadArguments if the file cannot be used, or an option contradicts it.
    """
    if not chosen.get("rig"):
        return dict(chosen)
    from cutenv.rig.operation.suitability import decisions
    from cutenv.rig.toml_file import read_rig_file

    try:
        rig_constants(chosen["rig"])
        settings = read_rig_file(chosen["rig"])
    except (OSError, ValueError) as error:
        raise BadArguments(f"--rig: {error}") from None
    by_hand = {"angle_mode": "fixed", "fixed_angle_deg": round(math.degrees(settings.fixed_angle), 6)}
    implied: dict[str, Any] = by_hand if settings.angle_mode == "fixed" else {}
    for name, value in implied.items():
        if chosen.get(name, value) != value:
            raise BadArguments(
                f"{flag_of(name)} {chosen[name]} contradicts {chosen['rig']}, whose blade is set by hand at "
                f"{by_hand['fixed_angle_deg']:g} degrees; leave it out."
            )
    rate = {"control_hz": min(LearnerArguments.control_hz, decisions(settings))}
    return {**rate, **chosen, **implied}


def actor_critic_inputs(task: RegisteredTask, history: int, critic: str, base: str = "none") -> dict[str, int]:
    """Return the input sizes of an actor and its critic.

    The critic sees "truth" or "features".  With the ``base`` "script", both see the script's action as well.
    """
    features = task.features(history=history).size + (len(task.task.action_names) if base == "script" else 0)
    return {"features": features, "critic": features + (len(task.privileged) if critic == "truth" else 0)}


@dataclass(frozen=True, kw_only=True)
class LearnerArguments:
    """Options that every learner has.

    Raises BadArguments for a number out of its range, and for an option without effect.
    """

    quick: ClassVar[Mapping[str, Any]] = {}  # values that ``--quick`` sets
    # values that ``--from-nothing`` sets; empty: the learner has no such option
    from_nothing: ClassVar[Mapping[str, Any]] = {}
    tasks: ClassVar[Collection[str]] = ("gentle",)  # names of the tasks that the learner is for

    task: str = option("gentle", f"task to learn, {tasks_in_words(TASKS)}", TASKS)
    name: str = option("", "name of the run's folder below runs/; default learner, date and time", metavar="NAME")
    seed: int = option(
        0, "seed of networks, exploration and training specimens", (0, len(TRAINING_SEEDS) // MAX_ENVIRONMENTS - 1)
    )
    minutes: float = option(
        0.0,
        "wall-clock minutes after which training ends, demonstrations included; 0: no limit",
        (0.0, 1e6),
        resumable=True,
    )
    specimen_class: str = option("mixed", "class of the specimens to train and test on", CLASSES)
    tissue: str = option(
        "", "file of a tissue of your own, from 'cutenv calibrate', of which the specimens are drawn", metavar="FILE"
    )
    angle_mode: str = option("free", "turn the blade (free), or keep its angle (fixed)", ("free", "fixed"))
    fixed_angle_deg: float = option(90.0, "angle of a blade that the agent does not turn [deg]", (45.0, 90.0))
    control_hz: int = option(10, "decisions per second")
    history: int = option(6, "number of past decisions among the features", (0, 100))
    force: str = option("felt", "give the agent the force (felt), or hide it (unfelt)", ("felt", "unfelt"))
    environments: int = option(64, "number of environments that run side by side", (1, MAX_ENVIRONMENTS))
    rig: str = option(
        "",
        "file of the rig to train for: its drive, sensor and top speed are simulated, and its blade's angle and "
        "decisions a second are kept",
        metavar="FILE",
    )
    rigs: int = option(
        1, "number of rigs to train on: one as it is, the others with constants drawn at random", (1, MAX_ENVIRONMENTS)
    )
    hidden: int = option(64, "number of units in each layer", (1, 4096))
    demonstrations: int = option(
        200_000, "number of decisions of a script that the actor first imitates; 0: none", (0, 10**9)
    )
    script: str = option(
        "return stroke",
        "script to imitate, or to correct (--base script); for --task "
        + "; for --task ".join(f"{name}: {', '.join(one.scripts)}" for name, one in TASKS.items()),
        metavar="SCRIPT",
    )
    demonstration_noise: float = option(
        0.15, "standard deviation of the noise added to half of the demonstrations", (0.0, 1.0)
    )
    validation_specimens: int = option(
        200, "number of specimens on which checkpoints are compared", (2, len(VALIDATION_SEEDS))
    )
    validations: int = option(16, "number of times that checkpoints are compared", (1, 10**6), resumable=True)
    specimens: int = option(
        200,
        "number of held-out specimens of the evaluation; 0: write the policy without one",
        (0, len(TEST_SEEDS)),
        resumable=True,
    )
    checkpoint_seconds: float = option(20.0, "seconds between checkpoints", (0.0, 1e6), resumable=True)
    tensorboard: bool = option(False, "write events for TensorBoard into the run's folder", resumable=True)

    def __post_init__(self) -> None:
        check_ranges(self, BadArguments)
        if self.angle_mode == "free" and self.fixed_angle_deg != 90.0:
            raise BadArguments(f"--fixed-angle-deg {self.fixed_angle_deg:g} has no effect without --angle-mode fixed")
        if self.tissue:
            try:
                TissueSource(self.tissue)
            except (OSError, ValueError) as error:
                raise BadArguments(f"--tissue: {error}") from None
        if self.rig and self.rigs > 1:
            raise BadArguments(f"--rigs {self.rigs} draws rigs at random, and --rig is one: leave one of them out")
        if self.rigs > self.environments:
            raise BadArguments(f"--rigs {self.rigs} needs as many --environments; {self.environments} are too few")
        if self.specimens == 1:
            raise BadArguments("--specimens 1 gives no interval; give 2 or more, or 0 for no evaluation")
        if self.task not in self.tasks:
            raise BadArguments(f"--task {self.task} is learned by PPO alone; leave it out, or give --learner ppo")
        by_script = not getattr(self, "dataset", "")  # else there is none
        if by_script and self.script not in self.learned_task.scripts:
            others = [f"for --task {name}" for name, one in TASKS.items() if self.script in one.scripts]
            own = ", ".join(repr(name) for name in self.learned_task.scripts)
            raise BadArguments(
                f"--script {self.script!r} is {(others or ['not known'])[0]}; those for --task {self.task} are {own}"
            )

    @classmethod
    def knowing_nothing(cls, chosen: Mapping[str, Any], *, quick: bool = False) -> dict[str, Any]:
        """Return chosen options of a new run, for :meth:`completed`."""
        shorter = {name: value for name, value in cls.quick.items() if name in cls.from_nothing} if quick else {}
        return {"demonstrations": 0, **cls.from_nothing, **shorter, **chosen}

    @classmethod
    def completed(cls, chosen: Mapping[str, Any], *, quick: bool = False) -> dict[str, Any]:
        """Return the complete options of a new run, quick if asked.

        Raises BadArguments for options that contradict each other.
        """
        task, _ = task_of(chosen)
        options = {"script": task.script, **task.options}
        own = {name: value for name, value in options.items() if name in cls.__dataclass_fields__}
        merged = {**own, **(cls.quick if quick else {}), **chosen}
        if merged.get("base") == "script":
            merged["demonstrations"] = chosen.get("demonstrations", 0)
        elif "hold" not in chosen:
            merged.pop("hold", None)
        return merged

    @property
    def learned_task(self) -> RegisteredTask:
        """The task to learn."""
        return TASKS[self.task]

    @property
    def environment(self) -> dict[str, Any]:
        """Keyword arguments of the environment for training and testing."""
        return {**drawn_as(vars(self)), "control_hz": self.control_hz, **self.angle, **self.simulated}

    @property
    def simulated(self) -> dict[str, float]:
        """Constants of the rig to train for; empty without one."""
        return rig_constants(self.rig) if self.rig else {}

    @property
    def angle(self) -> dict[str, Any]:
        """Keyword arguments of the environment that set the blade's angle."""
        return {"angle_mode": self.angle_mode} | (
            {"fixed_angle_deg": self.fixed_angle_deg} if self.angle_mode == "fixed" else {}
        )

    @property
    def features(self) -> dict[str, Any]:
        """Keyword arguments of :class:`cutenv.agents.policy.Features`, ``force`` only if not felt."""
        return {"history": self.history} | ({} if self.force == "felt" else {"force": False})

    @property
    def correction(self) -> dict[str, Any]:
        """Script whose actions the actor corrects, and for how many decisions; or empty."""
        return {}

    @property
    def training_seeds(self) -> range:
        """Seeds of the training environments."""
        first = self.seed * MAX_ENVIRONMENTS
        return range(first, first + self.environments)

    @property
    def validation_seeds(self) -> range:
        """Seeds of the specimens on which checkpoints are compared."""
        return VALIDATION_SEEDS[: self.validation_specimens]

    def environments_at(self, seeds: range) -> FeatureVecEnv:
        """Make environments with these seeds, with hidden state after features."""
        from cutenv.agents.sb3 import FeatureVecEnv

        return FeatureVecEnv(seeds, **self._shown)

    def training_environments(self) -> FeatureVecEnv | EnvironmentGroups:
        """Make the environments to train in; see :meth:`environments_at`."""
        if self.rigs == 1:
            return self.environments_at(self.training_seeds)
        from cutenv.agents.learning.environment_groups import EnvironmentGroups, random_rigs

        rigs = random_rigs(self.rigs, self.seed)
        return EnvironmentGroups(rigs, self.training_seeds, **self._shown)

    @property
    def _shown(self) -> dict[str, Any]:
        shown = {"hidden_state": True, "task": self.task, **self.correction, **self.features}
        return {**shown, **self.environment}


@dataclass(frozen=True, kw_only=True)
class TrialArguments(LearnerArguments):
    """Options of the learners that learn by trial.

    Their defaults are those of PPO.
    """

    timesteps: int = option(4_000_000, "number of decisions to train for", (1, 10**12), resumable=True)
    history: int = 0
    environments: int = 1000
    batch_size: int = option(16_000, "number of decisions in a gradient step", (2, 10**9))
    learning_rate: float = option(2.5e-4, "learning rate at the start; falls linearly to a twentieth", (1e-9, 1.0))
    gamma: float = option(1.0, "discount per decision", (0.0, 1.0))
    averaging: float = option(
        0.15, "share of the actor that its running average takes over at every update", (1e-6, 1.0)
    )
    critic: str = option("truth", "input of the critic; truth: features and hidden state", ("truth", "features"))
    critic_first: float = option(
        0.1, "share of training, after demonstrations, in which only the critic learns", (0.0, 1.0)
    )
    exploration: float = option(
        0.08, "standard deviation of the actions at the start", (1e-6, 10.0)
    )  # not 0: its log is kept


@dataclass(frozen=True, kw_only=True)
class PPOArguments(TrialArguments):
    """Options of PPO."""

    tasks: ClassVar[Collection[str]] = TASKS
    quick: ClassVar[Mapping[str, Any]] = {"demonstrations": 100_000, "timesteps": 400_000, **QUICKLY}
    from_nothing: ClassVar[Mapping[str, Any]] = {
        "base": "none", "forward": 0.3, "easier": 0.5, "control_hz": 5, "environments": 256, "batch_size": 4096,
        "epochs": 4, "learning_rate": 1.2e-3, "exploration": 0.5, "last_exploration": 0.05, "timesteps": 6_000_000,
    }  # fmt: skip

    rollout: int = option(64, "number of decisions of each environment between updates", (2, 10**6))
    epochs: int = option(10, "number of passes over a rollout", (1, 10**6))
    gae_lambda: float = option(0.95, "lambda of the generalised advantage estimate", (0.0, 1.0))
    base: str = option(
        "none",
        "what the actor's action is added to; none: nothing, it acts alone; script: the action of --script, which it "
        "learns to correct (residual policy learning), without imitating it first",
        ("none", "script"),
    )
    hold: int = option(1, "number of decisions for which what is added to the script's action is held", (1, 100))
    last_exploration: float = option(0.04, "standard deviation of the actions at the end of training", (1e-6, 10.0))
    forward: float = option(
        0.0,
        "mean speed action of an actor that has learned nothing yet, whose blade then is upright: without "
        "demonstrations and without a script, one that stands learns to stand",
        (-1.0, 1.0),
    )
    easier: float = option(
        0.0,
        "share of training in which the task is easier: half of the cuts begin nearer to the target, costs count less "
        "and time counts more",
        (0.0, 1.0),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("forward", "easier"):
            if getattr(self, name) and (self.demonstrations or self.correction):
                raise BadArguments(f"--{name} {getattr(self, name):g} is for --base none with --demonstrations 0")
        if self.easier and self.rigs > 1:
            raise BadArguments(f"--easier {self.easier:g} has environments of its own, and --rigs too: leave one out")
        if self.easier and self.environments < _EASIER_GROUPS:
            raise BadArguments(f"--easier {self.easier:g} needs at least {_EASIER_GROUPS} --environments")
        if self.hold > 1 and not self.correction:
            raise BadArguments(f"--hold {self.hold} has no effect without --base script")
        if self.correction:
            if self.demonstrations:
                raise BadArguments(f"--demonstrations {self.demonstrations} has no use with --base script; give 0")
            if self.force == "unfelt":
                raise BadArguments("--base script feels the force, which --force unfelt hides; give --base none")

    def training_environments(self) -> FeatureVecEnv | EnvironmentGroups:
        """Make the environments to train in, easier at first if asked."""
        if not self.easier:
            return super().training_environments()
        from cutenv.agents.learning.environment_groups import EasierEnvironments

        return EasierEnvironments(self.easier, self.training_seeds, **self._shown)

    @property
    def sizes(self) -> dict[str, Any]:
        """Networks' keyword arguments: input sizes, units per layer, first actions."""
        inputs = actor_critic_inputs(self.learned_task, self.history, self.critic, self.base)
        begin = {"speed": self.forward, "angle": _UPRIGHT}
        first = [begin.get(name, 0.0) for name in self.learned_task.task.action_names] if self.forward else []
        return {**inputs, "hidden": self.hidden} | ({"begin": first} if first else {})

    @property
    def correction(self) -> dict[str, Any]:
        """Script whose actions the actor corrects, and for how many decisions; or empty."""
        return {"script": self.script, "hold": self.hold} if self.base == "script" else {}


@dataclass(frozen=True, kw_only=True)
class RecurrentPPOArguments(PPOArguments):
    """Options of recurrent PPO."""

    tasks: ClassVar[Collection[str]] = ("gentle",)
    environments: int = 64
    rollout: int = 128
    batch_size: int = 1024
    epochs: int = 4
    learning_rate: float = 3e-4
    averaging: float = 0.03
    exploration: float = 0.15
    last_exploration: float = 0.05
    critic_first: float = 0.15
    from_nothing: ClassVar[Mapping[str, Any]] = {
        "forward": 0.3, "easier": 0.5, "control_hz": 5, "learning_rate": 7e-4, "exploration": 0.5,
    }  # fmt: skip
    cloning_epochs: int = option(15, "number of passes over the demonstrations", (1, 10**6))

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.correction:
            raise BadArguments("--base script is for --learner ppo; an actor with a memory acts alone")


_ENTROPY_WEIGHT = re.compile(r"(auto_)?\d*\.?\d+(e-?\d+)?")


@dataclass(frozen=True, kw_only=True)
class OffPolicyArguments(TrialArguments):
    """Options that SAC, TQC and CrossQ share."""

    quick: ClassVar[Mapping[str, Any]] = {"timesteps": 30_000, "demonstrations": 50_000, **QUICKLY}

    timesteps: int = 100_000
    environments: int = 100
    batch_size: int = 256
    learning_rate: float = 3e-4
    averaging: float = 0.05
    critic_first: float = 0.5
    train_freq: int = option(10, "number of decisions of each environment between updates", (1, 10**6))
    gradient_steps: int = option(100, "number of gradient steps of an update", (1, 10**6))
    buffer_size: int = option(1_000_000, "number of decisions that are kept, demonstrations included", (1, 10**9))
    n_steps: int = option(10, "number of decisions whose rewards are summed before the critic's value", (1, 1000))
    critic_hidden: int = option(128, "number of units in each layer of the critics", (1, 4096))
    ent_coef: str = option("auto_0.001", "weight of the entropy: a number, or auto_ and the number to begin with")
    target_entropy: float = option(-4.0, "entropy of the two actions that an automatic weight keeps", (-100.0, 2.0))

    def __post_init__(self) -> None:
        super().__post_init__()
        if not _ENTROPY_WEIGHT.fullmatch(self.ent_coef):
            raise BadArguments(f"--ent-coef {self.ent_coef!r} is neither a number nor auto_NUMBER; give 0.001, say")
        if self.buffer_size < self.demonstrations:
            raise BadArguments(
                f"--buffer-size {self.buffer_size} does not hold the {self.demonstrations} demonstrations; "
                "give more, or fewer --demonstrations"
            )

    @property
    def sizes(self) -> dict[str, int]:
        """Input sizes of actor and critic: keyword arguments of :mod:`cutenv.agents.learning.asymmetric_actors`."""
        return actor_critic_inputs(self.learned_task, self.history, self.critic)


@dataclass(frozen=True, kw_only=True)
class SACArguments(OffPolicyArguments):
    """Options of SAC."""

    tau: float = option(0.02, "share of the critic that its target takes over at every gradient step", (1e-9, 1.0))


@dataclass(frozen=True, kw_only=True)
class TQCArguments(SACArguments):
    """Options of TQC."""

    top_quantiles_to_drop_per_net: int = option(2, "number of highest quantiles that each critic leaves out", (0, 24))


@dataclass(frozen=True, kw_only=True)
class CrossQArguments(OffPolicyArguments):
    """Options of CrossQ."""

    policy_delay: int = option(3, "number of gradient steps of the critic for one of the actor", (1, 10**6))


@dataclass(frozen=True, kw_only=True)
class BCArguments(LearnerArguments):
    """Options of behaviour cloning."""

    quick: ClassVar[Mapping[str, Any]] = {"demonstrations": 50_000, "epochs": 20, **QUICKLY}
    # options that belong to a script, with what they are where a data set is imitated
    of_script: ClassVar[Mapping[str, Any]] = {"demonstrations": 0, "script": "", "demonstration_noise": 0.0}

    dataset: str = option(
        "", "id of a Minari data set to imitate, not a script; it sets decision rate and angle mode", metavar="ID"
    )
    demonstrations: int = option(400_000, "number of decisions of the script", (1, 10**9))
    epochs: int = option(60, "number of passes over the demonstrations", (1, 10**6))
    batch_size: int = option(1024, "number of decisions in a gradient step", (1, 10**9))
    learning_rate: float = option(2e-3, "learning rate at the start; falls along half a cosine to zero", (1e-9, 1.0))

    @classmethod
    def completed(cls, chosen: Mapping[str, Any], *, quick: bool = False) -> dict[str, Any]:
        """Return a new run's options, completed from its data set.

        Raises BadArguments if there is no such data set, or an option contradicts it.
        """
        if not chosen.get("dataset"):
            return {**(cls.quick if quick else {}), **chosen}
        for name in cls.of_script:
            if name in chosen:
                raise BadArguments(f"{flag_of(name)} belongs to a script; leave it out with --dataset.")
        from cutenv.agents.learning.minari_datasets import environment_of, opened

        try:
            dataset = opened(chosen["dataset"])
            implied = environment_of(dataset)
        except ValueError as error:
            raise BadArguments(f"--dataset: {error}") from None
        for name, value in implied.items():
            if chosen.get(name, value) != value:
                raise BadArguments(
                    f"{flag_of(name)} {chosen[name]} contradicts data set {dataset.id!r}, whose decisions "
                    f"were made with {value}; leave it out."
                )
        told = {**implied, **cls.of_script, "demonstrations": int(dataset.total_steps)}
        return {**(cls.quick if quick else {}), **chosen, **told}

    @property
    def teacher(self) -> str:
        """Name of what is imitated, for a sentence."""
        return f"data set {self.dataset!r}" if self.dataset else repr(self.script)


@dataclass(frozen=True, kw_only=True)
class IQLArguments(BCArguments):
    """Options of implicit Q-learning."""

    quick: ClassVar[Mapping[str, Any]] = {**BCArguments.quick, "epochs": 10}
    of_script: ClassVar[Mapping[str, Any]] = {**BCArguments.of_script, "other_script": ""}

    other_script: str = option("probe and creep", "script that makes half of the demonstrations", tuple(SCRIPTS))
    epochs: int = 40
    learning_rate: float = 1e-3
    gamma: float = option(1.0, "discount per decision", (0.0, 1.0))
    tau: float = option(0.005, "share of the critic that its target takes over at every gradient step", (1e-9, 1.0))
    expectile: float = option(0.7, "expectile of the actions' values that counts as a state's value", (0.5, 0.999))
    temperature: float = option(
        10.0, "exponent per unit of return with which better actions weigh more; 0: imitation", (0.0, 1e6)
    )

    @property
    def teacher(self) -> str:
        """Name of what is imitated, for a sentence."""
        return super().teacher if self.dataset else f"{self.script!r} and {self.other_script!r}"
