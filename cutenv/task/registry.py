"""Tasks by name.

One entry for each, by which it is made, learned, scripted, played, shown and documented.

An entry names objects by their places, and each is imported when it is first read.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from cutenv._base.validation import one_of


class ImportedField:
    """Field of an entry that is imported when it is read.

    It is given as a place, "package.module:NAME", and read as the object there; or given as the object.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __set__(self, entry: RegisteredTask, given: Any) -> None:
        entry.places[self._name] = given

    def __get__(self, entry: RegisteredTask | None, owner: type) -> Any:
        if entry is None:
            return ""  # the default: there is none
        given = entry.places[self._name]
        module, _, name = given.partition(":") if isinstance(given, str) else ("", "", "")
        return getattr(import_module(module), name) if module else given or ()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RegisteredTask:
    """One task, and all that the package knows of it; the rest it lacks."""

    places: dict[str, Any] = field(default_factory=dict, init=False)  # imported fields as they were given, by name
    name: str
    id: str  # id of the environment
    task: ImportedField = ImportedField()  # declaration
    single: ImportedField = ImportedField()  # environment
    vector: ImportedField = ImportedField()  # vector environment
    rig_id: str = ""  # id of the environment on a rig
    rig: ImportedField = ImportedField()  # that environment
    along: str = ""  # words for what the cuts follow, such as "along a drawn line"
    line: bool = False  # True if they follow one of the drawn lines, and take the keyword ``line``
    # Scores that tell how well they follow it: name, words, unit, and number of decimals.
    errors: tuple[tuple[str, str, str, int], ...] = ()

    features: ImportedField = ImportedField()  # class of what a learner is shown, such as Features
    scripts: ImportedField = ImportedField()
    """Scripts that learners imitate, correct and are compared with: makers by name."""
    script: str = ""  # name of the one that is imitated or corrected by default
    # Policies without a network that cut on a rig, as far as they are more than the scripts: makers by name.
    policies: ImportedField = ImportedField()
    planner: ImportedField = ImportedField()  # class of the planner with truth
    options: Mapping[str, Any] = field(default_factory=dict)  # options of PPO that differ from its defaults
    infos: ImportedField = ImportedField()  # infos of data sets besides those of gentle cutting, AddedInfos

    played: ImportedField = ImportedField()  # class of a cut by a person in a window, a PlayedCut
    hand: ImportedField = ImportedField()  # class of a cut by a person in a page, a HandCut

    @property
    def privileged(self) -> tuple[str, ...]:
        """Names of the hidden state that a critic is shown."""
        from cutenv.task.privileged import privileged_names

        return privileged_names(self.task)


_CORRECTING: Mapping[str, Any] = {
    "base": "script", "hold": 2, "control_hz": 10, "environments": 256, "batch_size": 4096, "epochs": 4,
    "critic_first": 0.05, "validation_specimens": 500, "validations": 8,
}  # fmt: skip
_ALONG_LINE: Mapping[str, Any] = {
    **_CORRECTING,
    "timesteps": 7_000_000,
    "exploration": 0.25,
    "last_exploration": 0.05,
    "learning_rate": 1.5e-3,
}
_OFF_LINE = (
    ("mean_distance_mm", "mean distance to the line", "mm", 2),
    ("largest_distance_mm", "largest distance to the line", "mm", 2),
)


def _excision(name: str, stem: str, along: str, scripts: str, script: str, **options: Any) -> RegisteredTask:
    """Return the registry entry of cutting along one excision side."""
    return RegisteredTask(
        name=name,
        id=f"cutenv/{stem}-v1",
        task="cutenv.task.path:PATH_CUT",
        single=f"cutenv.envs.path_cut:{stem}Env",
        vector=f"cutenv.envs.path_cut:{stem}VectorEnv",
        along=along,
        errors=_OFF_LINE,
        features="cutenv.agents.policy.path_policies:PathFeatures",
        scripts=f"cutenv.agents.policy.path_policies:{scripts}",
        script=script,
        planner="cutenv.agents.policy.third_axis_planners:PathPlanner",
        options={**_ALONG_LINE, **options},
        infos="cutenv.agents.learning.demonstration:PATH_INFOS",
    )  # fmt: skip


_SHIPPED = (
    RegisteredTask(
        name="gentle",
        id="cutenv/GentleCut-v1",
        task="cutenv.task.declare:GENTLE_CUT",
        single="cutenv.envs.gentle_cut:GentleCutEnv",
        vector="cutenv.envs.vector:GentleCutVectorEnv",
        rig_id="cutenv/RigCut-v1",
        rig="cutenv.envs.rig_cut:RigCutEnv",
        errors=(("tip_error_mm", "tip error", "mm", 2), ("largest_jump_mm", "largest jump", "mm", 2)),
        features="cutenv.agents.policy:Features",
        scripts="cutenv.agents.policy:SCRIPTS",
        script="return stroke",
        policies="cutenv.agents.policy:BASELINES",
        planner="cutenv.agents.policy:PlannerWithTruth",
        played="cutenv.people.play.played_cut:PlayedCut",
        hand="cutenv.people.browser.stylus_steps:HandCut",
    ),
    RegisteredTask(
        name="depth",
        id="cutenv/DepthCut-v1",
        task="cutenv.task.depth:DEPTH_CUT",
        single="cutenv.envs.depth_cut:DepthCutEnv",
        vector="cutenv.envs.depth_cut:DepthCutVectorEnv",
        rig_id="cutenv/RigDepthCut-v1",
        rig="cutenv.envs.rig_cut:RigDepthCutEnv",
        along="along a wanted depth",
        errors=(("mean_error_mm", "mean error of the depth", "mm", 2), ("layer_mm", "into the layer below", "mm", 3)),
        features="cutenv.agents.policy.depth_policies:DepthFeatures",
        scripts="cutenv.agents.policy.depth_policies:DEPTH_SCRIPTS",
        script="depth by two forces",
        planner="cutenv.agents.policy.third_axis_planners:DepthPlanner",
        options={
            **_CORRECTING, "timesteps": 5_000_000, "exploration": 0.12, "last_exploration": 0.03,
            "learning_rate": 1e-3,
        },
        infos="cutenv.agents.learning.demonstration:DEPTH_INFOS",
        played="cutenv.people.play.played_cut:PlayedDepthCut",
        hand="cutenv.people.browser.stylus_steps:HandDepthCut",
    ),
    RegisteredTask(
        name="path",
        id="cutenv/PathCut-v1",
        task="cutenv.task.path:PATH_CUT",
        single="cutenv.envs.path_cut:PathCutEnv",
        vector="cutenv.envs.path_cut:PathCutVectorEnv",
        rig_id="cutenv/RigPathCut-v1",
        rig="cutenv.envs.rig_cut:RigPathCutEnv",
        along="along a drawn line",
        line=True,
        errors=_OFF_LINE,
        features="cutenv.agents.policy.path_policies:PathFeatures",
        scripts="cutenv.agents.policy.path_policies:PATH_SCRIPTS",
        script="steer by force",
        planner="cutenv.agents.policy.third_axis_planners:PathPlanner",
        options=_ALONG_LINE,
        infos="cutenv.agents.learning.demonstration:PATH_INFOS",
        played="cutenv.people.play.played_cut:PlayedPathCut",
        hand="cutenv.people.browser.stylus_steps:HandPathCut",
    ),
    _excision("excision", "Excision", "along one side of an excision", "EXCISION_SCRIPTS", "excision by force"),
    _excision(
        "hand-excision", "HandExcision", "along one side of an excision, with a hand that yields", "HAND_SCRIPTS",
        "excision by hand and force", timesteps=9_000_000,
    ),
)  # fmt: skip
TASKS = {each.name: each for each in _SHIPPED}  # tasks by name; register adds one


def task_of(arguments: Mapping[str, Any]) -> tuple[RegisteredTask, dict[str, Any]]:
    """Return the task that ``arguments["task"]`` names, "gentle" without, and other arguments."""
    own = dict(arguments)
    return TASKS[one_of("task", own.pop("task", "gentle"), tuple(TASKS))], own


def task_made_as(environment: str) -> RegisteredTask:
    """Return the task of an environment id, gentle cutting for its tracks and others."""
    return next((task for task in TASKS.values() if task.id == environment), TASKS["gentle"])


def tasks_in_words(names: Iterable[str]) -> str:
    """Return task names with what their cuts follow, for choices."""
    return ", ".join(name + (f" ({TASKS[name].along})" if TASKS[name].along else "") for name in names)


def tasks_with(part: str) -> tuple[str, ...]:
    """Return names of tasks with a part, an entry's imported field."""
    return tuple(name for name, task in TASKS.items() if task.places[part])
