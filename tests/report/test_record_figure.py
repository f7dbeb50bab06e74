"""A record is drawn with its tare, cuts and flaws, so that a person can confirm them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from cutenv.measurement import QualityIssue
from cutenv.report import RecordPicture, draw_record
from cutenv.report.record_figure import record_figure
from cutenv.trace import Trace

TIME = np.arange(9000) / 1000
FORCE = 0.4 + np.where((TIME > 2) & (TIME < 5), 3.0, 0.0)
RECORD = Trace(time=TIME, force=FORCE, position=np.clip(0.01 * (TIME - 2), 0.0, 0.03))
TARED = Trace(time=TIME, force=FORCE - 0.4, position=RECORD.position)
CUTS = [slice(2000, 3000), slice(4000, 5000)]
FLAW = QualityIssue(kind="stuck", rows=(100, 200), message="the sensor shows 3 N", refuse=True)
LOOK = QualityIssue(kind="gap", rows=(10, 11), message="nothing was recorded", refuse=False)


def spans(axes: Any) -> list[tuple[float, float]]:
    """Beginning and end [s] of what is marked, cuts and flaws."""
    return sorted((patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches)


def test_a_record_is_written_as_a_picture_and_nothing_else(tmp_path: Path) -> None:
    found = RecordPicture(record=RECORD, tared=TARED, cuts=CUTS, flaws=[[FLAW], [LOOK]])
    draw_record(tmp_path / "record.png", found, "costs $5")
    assert [path.name for path in tmp_path.iterdir()] == ["record.png"]
    assert (tmp_path / "record.png").read_bytes().startswith(b"\x89PNG")


def test_cuts_and_flaws_are_marked_where_they_are() -> None:
    figure = record_figure(
        RecordPicture(record=RECORD, tared=TARED, quiet=slice(0, 1900), cuts=CUTS, flaws=[[FLAW], [LOOK]])
    )
    force, position = figure.axes
    expected = [(2.0, 2.999), (2.1, 2.2), (4.0, 4.999), (4.0105 - 0.018, 4.0105 + 0.018)]
    assert np.allclose(spans(force), sorted(expected), atol=1e-3)
    assert spans(position) == spans(force)
    names = [text.get_text() for text in force.get_legend().get_texts()]
    assert names == [
        "as recorded",
        "less the tare of 0.4 N",
        "taken for zero",
        "cut",
        "flaw that refuses the cut",
        "flaw worth a look",
    ]
    written = [text.get_text() for text in force.texts]
    assert written == ["cut 1\n2.00 to 3.00 s", "cut 2\n4.00 to 5.00 s", "stuck", "gap"]


def test_many_cuts_have_room_for_their_numbers_only() -> None:
    cuts = [slice(900 * k, 900 * k + 500) for k in range(9)]
    force, _ = record_figure(RecordPicture(record=RECORD, cuts=cuts)).axes
    assert [text.get_text() for text in force.texts] == [str(k) for k in range(1, 10)]


def test_a_record_in_which_nothing_was_found_can_be_drawn() -> None:
    (force,) = record_figure(RecordPicture(record=Trace(time=TIME, force=FORCE, force_unit="1"), flaws=[[LOOK]])).axes
    assert len(spans(force)) == 1
    assert force.get_ylabel() == "force (normalised)"


def test_what_does_not_belong_together_is_refused() -> None:
    with pytest.raises(ValueError, match="flaws of 1 cuts do not fit 2"):
        RecordPicture(record=RECORD, cuts=CUTS, flaws=[[FLAW]])
    with pytest.raises(ValueError, match="not the same one"):
        RecordPicture(record=RECORD, tared=TARED.select(slice(100)))
