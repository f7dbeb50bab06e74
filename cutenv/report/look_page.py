"""Page of records as they were understood, before anybody scores them: pictures, questions, rows left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cutenv.report.page import number, significant, write_page
from cutenv.report.record_figure import RecordPicture, record_figure


@dataclass(frozen=True, kw_only=True)
class UnderstoodFile:
    """File as it was understood.

    Attributes
    ----------
    name : str
        Name of the file.
    pictures : sequence of RecordPicture
        Its records.
    mapping : str
        Options of the command line that read it so; "" for a record of this package.
    questions, left_out, notes : sequence of str
        What it leaves open, which rows are in no record, and how it was read.
    reason : str
        Reason for which it is not read, "" if it is.
    """

    name: str
    pictures: Sequence[RecordPicture] = ()
    mapping: str = ""
    questions: Sequence[str] = ()
    left_out: Sequence[str] = ()
    notes: Sequence[str] = ()
    reason: str = ""

    @property
    def unit(self) -> str:
        """Unit of force of its records."""
        return self.pictures[0].record.force_unit if self.pictures else "N"

    @property
    def rows(self) -> list[tuple[str, list[str]]]:
        """Rows of the table of its records."""
        rows = []
        for k, picture in enumerate(self.pictures, 1):
            record = picture.record
            position = record.position
            travel = "–" if position is None else number(1e3 * float(position.max() - position.min()), 1)
            peak = significant(float(record.force.max()), 3)
            rows.append(
                (str(k), [str(len(record)), number(record.duration, 2), peak, travel, str(len(picture.cuts))]),
            )
        return rows


def write_look_page(path: Path, files: Sequence[UnderstoodFile]) -> None:
    """Write the page (.html) of some files; raises as :func:`cutenv.report.page.write_page`."""
    write_page(path, "look.html", files=files, record_figure=record_figure)
