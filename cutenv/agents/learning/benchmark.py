"""Protocol, statistics and entries of the published benchmark.

Specimens on which policies are compared, a policy's standing, its submission.

An entry cuts specimens of its own: their seeds are drawn from the digest of the entry's files, so that no file can hold
the answers to them, and anybody can draw them again.

Results of one version are comparable; a change of any number here is a new version.
"""

from __future__ import annotations

import base64
import datetime
import hashlib
import json
import math
import re
import sys
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import cutenv
from cutenv._base.arrays import Array32, Indices
from cutenv._base.output import atomic_write
from cutenv.agents.learning.evaluation import Contestant, batched_rollout
from cutenv.agents.learning.seeds import ENTRY_SEEDS, ENVIRONMENT, TEST_SEEDS, VALIDATION_SEEDS
from cutenv.agents.learning.statistics import Interval, interquartile_mean, mean, stratified
from cutenv.agents.policy import BASELINES, SCRIPTS, ArrayPolicy, TrainedPolicy
from cutenv.agents.policy.interface import as_array_policy
from cutenv.agents.policy.shipped import named_folder
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.tissue.specimen import CLASSES


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """The numbers of the comparison."""

    version: str = "3"
    environment: str = ENVIRONMENT
    training_class: str = "mixed"  # class of the specimens on which agents are trained and the headline is evaluated
    classes: tuple[str, ...] = tuple(reversed(CLASSES))  # classes of held-out specimens
    script: str = "return stroke"  # script from which differences are taken: the best of all by its mean return
    most_seeds: int = 10  # largest number of training runs of one agent
    training: tuple[str, ...] = ()  # options of ``cutenv train`` for every agent, before its own
    specimens: int = 1000  # number of held-out specimens of each class
    # index of the first of them in ``TEST_SEEDS``; earlier ones serve for the reports of runs and the design of the
    # reward.  It moves on by 10 000 with every version, so that nothing is tuned on held-out specimens for long
    first_specimen: int = 10_000
    feed_specimens: int = 200  # number of validation specimens on which the best constant feed is chosen
    sweep_specimens: int = 200  # number of held-out specimens for every constant that is swept
    resamples: int = 2000

    def __post_init__(self) -> None:
        assert self.training_class in self.classes
        assert self.script in SCRIPTS
        assert 1 <= self.most_seeds
        assert 2 <= self.sweep_specimens <= self.specimens <= len(TEST_SEEDS) - self.first_specimen
        assert 2 <= self.feed_specimens <= len(VALIDATION_SEEDS)

    @property
    def test_seeds(self) -> range:
        """Seeds of the held-out specimens of each class."""
        return TEST_SEEDS[self.first_specimen : self.first_specimen + self.specimens]


QUICK = Protocol(
    version="quick", classes=("mixed", "liver"), most_seeds=2, specimens=40, feed_specimens=10, sweep_specimens=10,
    training=("--demonstrations", "20000", "--minutes", "0.3"), resamples=400,
)  # fmt: skip
"""Protocol of a test of the whole program; it gives no result."""


RunRows = Sequence[Mapping[str, Any]]
"""Rows of one run, a cut each: ``seed``, ``specimen_class`` and scores, as numbers or as text."""

IQM, MEAN = "interquartile mean", "mean"
STATISTICS: dict[str, Callable[[np.ndarray], np.ndarray]] = {IQM: interquartile_mean, MEAN: mean}  # statistics by name


@dataclass(frozen=True)
class TableColumn:
    """One column of the table.

    Score, heading, factor and digits, statistic, and whether it is a paired difference.
    """

    score: str
    heading: str
    factor: float = 1.0
    digits: int = 2
    statistic: str = IQM
    paired: bool = False


TABLE_COLUMNS = (
    TableColumn("return", "return (IQM)", digits=3),
    TableColumn("return", "return (mean)", digits=3, statistic=MEAN),
    TableColumn("return", "minus best script", digits=3, statistic=MEAN, paired=True),
    TableColumn("success", "success [%]", 100.0, 1, MEAN),
    TableColumn("tip_error_mm", "tip error [mm]"),
    TableColumn("peak_force_N", "peak force [N]"),
    TableColumn("largest_jump_mm", "largest run [mm]"),
    TableColumn("cost_mm", "cost [mm]", statistic=MEAN),
    TableColumn("overshoot_mm", "overshoot [mm]", statistic=MEAN),
    TableColumn("time_s", "time [s]", digits=1),
)
"""Columns of the table; one that the cuts lack is left out."""

CUT_MARKS = {100: "100", 1000: "1,000", 10_000: "10,000", math.inf: "all"}
"""Numbers of cuts consumed after which the return in training is told."""


def strata(runs: Sequence[RunRows], score: str) -> list[np.ndarray]:
    """Return an array, (runs, specimens), per tissue, without specimens lacking the score."""
    cells = [[row.get(score, "") for row in rows] for rows in runs]
    values = np.array([[math.nan if cell == "" else float(cell) for cell in own] for own in cells])
    tissue = np.array([row["specimen_class"] for row in runs[0]])
    known = np.isfinite(values).all(axis=0)
    parts = [values[:, known & (tissue == name)] for name in sorted(set(tissue))]
    return [part for part in parts if part.size]


def paired_difference(runs: Sequence[RunRows], others: Sequence[RunRows], score: str, protocol: Protocol) -> Interval:
    """Return the mean paired difference on the same specimens.

    It is by training run where both have as many; outliers count.
    """
    pairs = zip(strata(runs, score), strata(others, score), strict=True)
    return stratified([own - theirs for own, theirs in pairs], mean, resamples=protocol.resamples)


def standing(runs: Sequence[RunRows], script: RunRows, protocol: Protocol) -> dict[TableColumn, Interval]:
    """Return the numbers of a policy's row.

    ``runs`` are cuts of the headline's specimens by training run, of which a script has one; ``script`` those of the
    protocol's.
    """
    found = {}
    for column in TABLE_COLUMNS:
        if column.paired:
            found[column] = paired_difference(runs, [script], column.score, protocol)
        elif own := strata(runs, column.score):
            found[column] = stratified(own, STATISTICS[column.statistic], resamples=protocol.resamples)
    return found


def shown(interval: Interval | None, factor: float = 1.0, digits: int = 2, sign: str = "") -> str:
    """Format a number with its interval, or a dash without one."""
    if interval is None:
        return "–"
    value, low, high = (factor * number for number in (interval.value, interval.low, interval.high))
    return f"{value:{sign}.{digits}f} [{low:{sign}.{digits}f}, {high:{sign}.{digits}f}]"


def returns_after(curve: Sequence[Mapping[str, float]]) -> dict[str, float | None]:
    """Return the best validation return within each number of :data:`CUT_MARKS`.

    It is None where nothing had been validated by then, and for a curve that does not count cuts.
    """
    points = [(row["cuts"], row["validation_return"]) for row in curve if {"cuts", "validation_return"} <= row.keys()]
    return {
        name: max((value for cuts, value in points if cuts <= mark), default=None) for mark, name in CUT_MARKS.items()
    }


OF_SCRIPT, SCRATCH, DEMONSTRATED, CORRECTION = "script", "from scratch", "with demonstrations", "correction of a script"
ENTRY_KINDS = (OF_SCRIPT, SCRATCH, DEMONSTRATED, CORRECTION)  # kinds of policies; each has ranks of its own


def training_kind(training: Mapping[str, Any]) -> str:
    """Return the kind of a trained policy from training options."""
    if training.get("base", "none") != "none":
        return CORRECTION
    return DEMONSTRATED if training["demonstrations"] or training.get("dataset") else SCRATCH


def recorded_kind(name: str, policy: Any) -> str | None:
    """Return a named policy's kind from its records, or None."""
    if name in BASELINES:
        return OF_SCRIPT
    if not isinstance(policy, TrainedPolicy):
        return None
    options = policy.card.training.get("arguments", {})
    if policy.card.script is not None:
        return CORRECTION
    return training_kind(options) if "demonstrations" in options else None


def entry_files(name: str) -> dict[str, bytes]:
    """Return the contents of a policy's files by name.

    They are all files of its folder; of a class, MODULE:CLASS, its module and those that it names in ``files``,
    relative to the present folder.  A script has none: it is this package's.

    Raises OSError if one cannot be read.
    """
    folder = named_folder(name)
    if folder is not None:
        paths = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    elif ":" not in name:
        return {name: b""}
    else:
        module, _, made = name.partition(":")
        source = Path(str(sys.modules[module].__file__))
        own = getattr(getattr(sys.modules[module], made), "files", ())
        paths = {source.name: source} | {str(file): Path(file) for file in own}
    return {shown: path.read_bytes() for shown, path in paths.items()}


def entry_digest(policies: Sequence[Mapping[str, bytes]]) -> str:
    """Return an entry's SHA-256 (hexadecimal) of all policies' files.

    The order of the policies and the names of their folders do not matter.
    """
    whole = sorted(
        _sha256(*(text for name in sorted(files) for text in (_sha256(name.encode()), _sha256(files[name]))))
        for files in policies
    )
    return _sha256(*whole).decode()


def _sha256(*parts: bytes) -> bytes:
    return hashlib.sha256(b"".join(parts)).hexdigest().encode()


def entry_seeds(digest: str, protocol: Protocol, salt: str = "") -> list[int]:
    """Return the seeds of an entry's specimens, by its :func:`entry_digest`.

    The protocol's version is part of what they are drawn from, and so is ``salt``: what the host of a competition adds
    after the files are fixed, so that trying many files gains nothing.
    """
    drawn = (
        hashlib.sha256(json.dumps([protocol.version, salt, digest, number]).encode()).digest()
        for number in range(protocol.specimens)
    )
    return [ENTRY_SEEDS[int.from_bytes(one[:8]) % len(ENTRY_SEEDS)] for one in drawn]


FORMAT = 2  # version of the file
CHOICES = ("control_hz", "angle_mode", "fixed_angle_deg")
"""Keyword arguments of the environment that a policy may choose; all others are the protocol's."""
_BATCH = 200  # cuts simulated together
_CURE = "Copy the file again, or make it again with cutenv submit."

Finished = Callable[[int], Any]


@dataclass(frozen=True)
class SubmittedRun:
    """Cuts of one training run, or of a script."""

    arguments: Mapping[str, Any]  # keyword arguments of the environment that the policy chose
    returns: tuple[float, ...]
    actions: tuple[np.ndarray, ...]  # actions of each cut, shape (decisions, 2)
    after: Mapping[str, float | None]  # returns in training, of :func:`returns_after`; they are the author's own


@dataclass(frozen=True)
class Submission:
    """Entry: policy, author, code link, date, kind, and its runs."""

    policy: str
    author: str
    code: str
    date: str
    kind: str
    digest: str
    salt: str
    protocol: Protocol
    runs: tuple[SubmittedRun, ...]

    @property
    def seeds(self) -> list[int]:
        """Seeds of the specimens."""
        return entry_seeds(self.digest, self.protocol, self.salt)


def _begin(policy: ArrayPolicy, count: int) -> None:
    """Begin cuts with random numbers that hide the specimens' seeds."""
    policy.begin([np.random.default_rng(place) for place in range(count)])


class _Recorded(ArrayPolicy):
    """A policy whose actions are kept."""

    def __init__(self, policy: ArrayPolicy) -> None:
        self._policy = policy
        self.actions: list[Array32] = []

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        _begin(self._policy, len(rngs))

    def forget(self, cuts: Indices) -> None:
        self._policy.forget(cuts)

    def act(self, observations: Array32) -> Array32:
        self.actions.append(np.array(self._policy.act(observations), np.float32))
        return self.actions[-1]


_MAX_ACTION_DIFFERENCE = (
    1e-3  # difference of actions that another machine may make, whose sums of float32 round otherwise
)


class _Repeated(ArrayPolicy):
    """Actions as recorded, the last one of a cut for ever.

    Beside them a policy that should have taken them, if any. ``apart`` is the first cut in which it would have acted
    otherwise, with the decision.
    """

    def __init__(self, actions: Sequence[np.ndarray], policy: ArrayPolicy | None) -> None:
        self._actions, self._policy, self._decision = actions, policy, -1
        self.apart: tuple[int, int] | None = None

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        self._decision = -1
        if self._policy is not None:
            _begin(self._policy, len(rngs))

    def forget(self, cuts: Indices) -> None:
        raise NotImplementedError("a recorded cut does not begin again")

    def act(self, observations: Array32) -> Array32:
        self._decision += 1
        told = np.stack([own[min(self._decision, len(own) - 1)] for own in self._actions])
        if self._policy is not None and self.apart is None:
            going = self._decision < np.array([len(own) for own in self._actions])
            other = ~(np.abs(self._policy.act(observations) - told) <= _MAX_ACTION_DIFFERENCE).all(axis=1) & going
            if other.any():
                self.apart = int(np.argmax(other)), self._decision + 1
        return told


def _cut(
    policy: ArrayPolicy, seeds: Sequence[int], arguments: Mapping[str, Any], protocol: Protocol, finished: Finished
) -> tuple[list[dict[str, Any]], list[int]]:
    """Return the scores of every cut, and its number of decisions."""
    whole = {"specimen_class": protocol.training_class, **arguments}
    cuts = batched_rollout(policy, seeds, whole, finished=finished)
    ticks = GentleCutEnv(**whole).ticks
    return [cut.scores() for cut in cuts], [math.ceil(round(cut.time_s / TICK) / ticks) for cut in cuts]


def submitted_run(
    one: Contestant,
    after: Mapping[str, float | None],
    protocol: Protocol,
    seeds: Sequence[int],
    finished: Finished = lambda count: None,
) -> SubmittedRun:
    """Let a policy cut an entry's specimens, and keep its actions.

    Raises ValueError if the policy is shown the hidden state, or asks for another environment.
    """
    policy = as_array_policy(one.policy)
    if policy.privileged:
        raise ValueError("this policy is shown the hidden state, so it takes no part; submit one that is not.")
    _check_arguments(one.arguments)
    returns: list[float] = []
    actions: list[np.ndarray] = []
    for first in range(0, len(seeds), _BATCH):
        kept = _Recorded(policy)
        rows, decisions = _cut(kept, seeds[first : first + _BATCH], one.arguments, protocol, finished)
        whole = np.stack(kept.actions, axis=1)
        returns += [row["return"] for row in rows]
        actions += [whole[n, :count] for n, count in enumerate(decisions)]
    return SubmittedRun(dict(one.arguments), tuple(returns), tuple(actions), dict(after))


def replayed(
    entry: Submission, policies: Sequence[Contestant] = (), finished: Finished = lambda count: None
) -> list[list[dict[str, Any]]]:
    """Repeat every cut from its seed and actions; return the scores, by run.

    ``policies``, one for each run, must act as the file says; without any that is not checked.  ``finished`` is called
    with the number of cuts that have ended with a decision.

    Raises ValueError if a return differs in its last bit, a cut takes another number of decisions, or a policy acts
    otherwise; names the cut.
    """
    repeated, seeds = [], entry.seeds
    if policies and len(policies) != len(entry.runs):
        raise ValueError(f"the file holds {len(entry.runs)} runs, and {len(policies)} policies are given. Refused.")
    for number, run in enumerate(entry.runs, 1):
        rows: list[dict[str, Any]] = []
        policy = as_array_policy(policies[number - 1].policy) if policies else None
        if policies and dict(policies[number - 1].arguments) != dict(run.arguments):
            raise ValueError(
                f"run {number}: the policy wants {dict(policies[number - 1].arguments)}, but the file says "
                f"{dict(run.arguments)}. Refused."
            )
        for first in range(0, len(run.returns), _BATCH):
            part = slice(first, first + _BATCH)
            actions = run.actions[part]
            again = _Repeated(actions, policy)
            found, decisions = _cut(again, seeds[part], run.arguments, entry.protocol, finished)
            for row, count, own, told in zip(found, decisions, actions, run.returns[part], strict=True):
                cut = f"run {number}, specimen {row['seed']}"
                if count != len(own):
                    raise ValueError(f"{cut}: its replay takes {count} decisions, not {len(own)}. Refused.")
                if row["return"] != told:
                    raise ValueError(
                        f"{cut}: its replay returns {row['return']!r}, but the file says {told!r}. Refused. "
                        f"The file was altered, or made by another version than cutenv {cutenv.__version__}."
                    )
            if again.apart is not None:
                cut_number, decision = again.apart
                raise ValueError(
                    f"run {number}, specimen {seeds[first + cut_number]}: the policy's action {decision} is not the "
                    "file's. Refused. Give the policies that were submitted, in the same order."
                )
            rows += found
        repeated.append(rows)
    return repeated


def write_submission(path: Path, entry: Submission) -> None:
    """Write an entry as JSON, as a whole or not at all."""
    content = {
        "cutenv_submission": FORMAT,
        "cutenv": cutenv.__version__,
        "environment": entry.protocol.environment,
        "protocol": entry.protocol.version,
        **{name: getattr(entry, name) for name in _TEXTS},
        "runs": [
            {
                "environment_arguments": run.arguments,
                "returns_after_cuts": run.after,
                "returns": run.returns,
                "decisions": [len(own) for own in run.actions],
                "actions": _packed(np.concatenate(run.actions)),
            }
            for run in entry.runs
        ],
    }
    with atomic_write(path) as part:
        part.write_text(json.dumps(content) + "\n", encoding="utf-8")


_TEXTS = ("policy", "author", "code", "date", "kind", "digest", "salt")
_MAY_BE_EMPTY = ("code", "salt")
_MAX_CHARACTERS = 200


def read_submission(path: Path, protocols: Sequence[Protocol] = (Protocol(), QUICK)) -> Submission:
    """Read an entry; nothing is replayed yet.

    Raises OSError if the file cannot be read; ValueError if it is damaged or not whole, or was made for another
    environment or protocol; names what is wrong.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict) or "cutenv_submission" not in content:
            raise ValueError("it is no file of cutenv submit")
        if content["cutenv_submission"] != FORMAT:
            raise ValueError(f"its format is {content['cutenv_submission']!r}, not {FORMAT}")
        protocol = _protocol(content, protocols)
        texts = {name: content[name] for name in _TEXTS}
        for name, text in texts.items():
            check_text(name, text, empty=name in _MAY_BE_EMPTY)
        datetime.date.fromisoformat(texts["date"])
        if texts["kind"] not in ENTRY_KINDS:
            raise ValueError(f"kind is {texts['kind']!r}, not one of {', '.join(ENTRY_KINDS)}")
        if not re.fullmatch("[0-9a-f]{64}", texts["digest"]):
            raise ValueError(f"digest is {texts['digest']!r}, not 64 hexadecimal digits")
        seeds = entry_seeds(texts["digest"], protocol, texts["salt"])
        runs = tuple(_read_run(run, number, seeds) for number, run in enumerate(content["runs"], 1))
    except json.JSONDecodeError as error:
        raise ValueError(f"{path}: it is not whole, or no JSON: {error}. {_CURE}") from None
    except KeyError as error:
        raise ValueError(f"{path}: {error} is missing. {_CURE}") from None
    except (ValueError, TypeError, AttributeError, zlib.error) as error:
        raise ValueError(f"{path}: {error}. {_CURE}") from None
    if not runs:
        raise ValueError(f"{path}: it holds no run. {_CURE}")
    for number, run in enumerate(runs, 1):
        for other, earlier in enumerate(runs[: number - 1], 1):
            if run.returns == earlier.returns:
                raise ValueError(f"{path}: runs {other} and {number} are the same; give each training run once.")
    return Submission(**texts, protocol=protocol, runs=runs)


def check_text(name: str, text: Any, *, empty: bool = False) -> None:
    """Raise ValueError unless a text fits a cell of the leaderboard."""
    if not isinstance(text, str) or not (empty or text.strip()):
        raise ValueError(f"{name} is {text!r}; give a text")
    if len(text) > _MAX_CHARACTERS or not text.isprintable() or set("|<>") & set(text):
        raise ValueError(
            f"{name} is {text[:_MAX_CHARACTERS]!r}; give one line of at most {_MAX_CHARACTERS} characters without | < >"
        )


def _protocol(content: Mapping[str, Any], protocols: Sequence[Protocol]) -> Protocol:
    for protocol in protocols:
        if (content["environment"], content["protocol"]) == (protocol.environment, protocol.version):
            return protocol
    known = " or ".join(f"protocol {protocol.version} of {protocol.environment}" for protocol in protocols)
    raise ValueError(f"it was made for protocol {content['protocol']} of {content['environment']}, not for {known}")


def _read_run(run: Mapping[str, Any], number: int, seeds: Sequence[int]) -> SubmittedRun:
    arguments, returns, decisions = run["environment_arguments"], run["returns"], run["decisions"]
    _check_arguments(arguments)
    if not len(returns) == len(decisions) == len(seeds):
        raise ValueError(f"run {number} holds {len(returns)} cuts, not the {len(seeds)} of the protocol")
    if not all(isinstance(count, int) and count > 0 for count in decisions):
        raise ValueError(f"run {number}: decisions are not all whole numbers above 0")
    whole = _unpacked(run["actions"], number)
    if len(whole) != sum(decisions):
        raise ValueError(f"run {number} holds {len(whole)} actions, not {sum(decisions)}")
    bad = np.flatnonzero(~(np.abs(whole) <= 1.0).all(axis=1))
    if len(bad):
        cut = int(np.searchsorted(np.cumsum(decisions), bad[0], side="right"))
        raise ValueError(f"run {number}, specimen {seeds[cut]}: action {whole[bad[0]]} is outside [-1, 1]")
    actions = tuple(np.split(whole, np.cumsum(decisions)[:-1]))
    return SubmittedRun(arguments, tuple(map(float, returns)), actions, run["returns_after_cuts"])


def _check_arguments(arguments: Mapping[str, Any]) -> None:
    for name in arguments:
        if name not in CHOICES:
            raise ValueError(f"environment argument {name!r} is the protocol's; a policy chooses {', '.join(CHOICES)}")


def _packed(actions: np.ndarray) -> str:
    """Pack actions as text, equal bytes together, which compresses better."""
    content = np.ascontiguousarray(actions, "<f4").view(np.uint8).reshape(-1, 4).T.tobytes()
    return base64.b64encode(zlib.compress(content, 9)).decode("ascii")


def _unpacked(text: str, number: int) -> np.ndarray:
    content = np.frombuffer(zlib.decompress(base64.b64decode(text, validate=True)), np.uint8)
    if content.size % 8:
        raise ValueError(f"run {number}: its actions are not whole")
    return np.ascontiguousarray(content.reshape(4, -1).T).view("<f4").reshape(-1, 2).astype(np.float32)
