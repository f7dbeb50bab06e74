"""Line that an environment's argument names: one of a kind that is drawn, or a given one."""

from __future__ import annotations

from numpy.typing import ArrayLike

from cutenv._base.validation import one_of
from cutenv.task.beginning import LONGEST
from cutenv.task.path_beginning import GIVEN_LINE
from cutenv.tissue.description import TissueDescription
from cutenv.tissue.drawn_lines import KINDS, LEAST_LENGTH, DrawnLines, drawn_lines, given_line
from cutenv.tissue.grid import POINTS_PER_METRE
from cutenv.tissue.lines import CutLine, length_within, through

ROOM = LEAST_LENGTH - LONGEST
"""Length of line that a cut needs within the slab beyond its target, for the blade that leads the tip [m]."""


class LineChoice:
    """Choice of the line of every cut.

    Parameters
    ----------
    line : str, CutLine, or array_like of shape (n, 2)
        Kind of line, "mixed", or the line.

    Attributes
    ----------
    kind : int
        Number of the kind, MIXED_LINES, or GIVEN_LINE, see :mod:`cutenv.task.path_beginning`.

    Raises
    ------
    ValueError
        If there is no such kind, or the line turns back, bends too far or leaves the slab.
    """

    def __init__(self, line: str | CutLine | ArrayLike) -> None:
        self.kind = GIVEN_LINE
        if isinstance(line, str):
            self.kind = (*KINDS, "mixed").index(one_of("line", line, (*KINDS, "mixed")))
        self._given = None if isinstance(line, str) else line if isinstance(line, CutLine) else through(line)
        self._drawn: DrawnLines | None = None

    def lines_for(self, tissue: TissueDescription) -> DrawnLines:
        """Return the lines of which one is cut, by the tissue's model in the plane."""
        plane = tissue.element, tissue.formulation, tissue.poisson
        if self._given is None:
            return drawn_lines(*plane)
        if self._drawn is None:
            self._drawn = given_line(self._given, *plane)
        return self._drawn

    def check(self, length: float) -> None:
        """Raise ValueError if a cut of a target length [m] does not fit a given line."""
        if self._given is None:
            return
        within = length_within(self._given)
        if within < length + ROOM - 1e-9:
            k = round(within * POINTS_PER_METRE)
            x, y = self._given.x[k], self._given.y[k]
            raise ValueError(
                f"The line leaves the slab at ({x:.4f}, {y:.4f}) m, after {1e3 * within:.0f} mm: a cut of "
                f"{1e3 * length:.0f} mm needs {1e3 * ROOM:.0f} mm more, for the blade that leads its tip. Give a "
                f"target_length of at most {within - ROOM:.3f} m, or another line."
            )
