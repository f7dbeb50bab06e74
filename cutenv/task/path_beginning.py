"""Beginning cuts along a line: the line that is drawn from a key, and the place of blade and tip on it."""

from __future__ import annotations

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.jit import njit, njit_internal, njit_nogil
from cutenv._engine.randomness import LINE_DRAW, TASK, Integer, uniform_at
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.steering_start import lay_line, stand_on_line
from cutenv.task.cuts import Cuts
from cutenv.task.path_assessment import UNFELT_ASIDE, observe_path, survey_path
from cutenv.tissue.drawn_lines import KINDS, MIXED_LINES, OF_A_KIND
from cutenv.tissue.grid import SPACING

GIVEN_LINE = MIXED_LINES + 1
"""Number, after those of the kinds, of a line that is given."""
_KINDS = len(KINDS)


@njit
def line_number(seed: Integer, episode: Integer, kind: int) -> int:
    """Return the number of a key's line among all that are drawn, of a kind or mixed; 0 for a given one."""
    if kind == MIXED_LINES:
        kind = min(int(_KINDS * uniform_at(seed, episode, TASK, LINE_DRAW)), _KINDS - 1)
    if kind in (0, GIVEN_LINE):
        return 0
    place = min(int(OF_A_KIND * uniform_at(seed, episode, TASK, LINE_DRAW + 1)), OF_A_KIND - 1)
    return 1 + OF_A_KIND * (kind - 1) + place


@njit_internal
def begin_path(
    profile: Struct, state: Struct, drive: Struct, steering: Struct, path: Struct, line: Struct
) -> None:  # fmt: skip
    """Begin one cut, whose records were begun as those of gentle cutting, on a ``line``."""
    lay_line(profile, steering, line)
    stand_on_line(profile, steering, state.tip)
    drive.travel = min(drive.travel, line.within - SPACING)
    path.begun = state.tip
    survey_path(path, steering, state.tip)


@njit
def begin_path_one(
    cuts: StructArray, steerings: StructArray, paths: StructArray, lines: StructArray, number: int
) -> None:
    """Begin one cut: :func:`begin_path` for records of shape (1,), on a line with this number."""
    c = cuts[0]
    paths[0].line = number
    begin_path(c.profiles[0], c.states[0], c.drives[0], steerings[0], paths[0], lines[number])


@njit
def observe_path_at_start(
    cuts: StructArray, steerings: StructArray, paths: StructArray, observation: StructArray
) -> None:
    """Fill what the path adds to the observation of one cut at its start."""
    c = cuts[0]
    observe_path(paths[0], steerings[0], c.sensors[0], 0, 0, c.states[0].blade, UNFELT_ASIDE, 0.0, observation)


@njit_nogil
def begin_path_some(
    passed: WorkQueue,
    core: int,
    cuts: Cuts,
    steerings: StructArray,
    paths: StructArray,
    start: tuple[StructArray, StructArray],
    lines: StructArray,
    kind: int,
    which: StructArray,
    seeds: StructArray,
    episodes: StructArray,
    observations: StructArray,
) -> None:
    """Begin the paths of the cuts with indices ``which``, after :func:`cutenv.task.beginning.begin_some`.

    ``start`` has the records that all share, each of shape (1,): place in the plane, path.  ``lines`` are those that
    are drawn, :data:`~cutenv.tissue.drawn_lines.LINE`, or the one that is given.  The others are those of
    :func:`cutenv.task.beginning.begin_some`.
    """
    k, end = next_chunk(passed, core, 1)
    while k < end:
        n = which[k]
        steerings[n], paths[n] = start[0][0], start[1][0]
        number = line_number(seeds[n], episodes[n], kind)
        paths[n].line = number
        begin_path(cuts.profiles[n], cuts.states[n], cuts.drives[n], steerings[n], paths[n], lines[number])
        observe_path(
            paths[n], steerings[n], cuts.sensors[n], 0, 0, cuts.states[n].blade, UNFELT_ASIDE, 0.0, observations[n]
        )  # fmt: skip
        mark_done(passed, core, 1)
        k, end = next_chunk(passed, core, 1)
