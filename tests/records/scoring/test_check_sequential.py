"""Table of the sequential comparison beside a library."""

from __future__ import annotations

import sys

import pytest

from scripts.validation.scoring import check_sequential


def test_both_stand_beside_each_other_and_a_median_that_was_not_reached_is_left_out() -> None:
    shown = {"here": (0.6, 120.0), "confseq": (0.4, float("inf"))}
    rows = [
        {"kind": "normal", "mean": 0.1, "by": by, "studies": 2000, "shown": share, "median": median}
        for by, (share, median) in shown.items()
    ]
    assert check_sequential.library_table(rows).splitlines()[-1] == "| normal | 0.1 | 60.0 % | 40.0 % | 120 |  |"


def test_a_library_that_is_missing_is_named_with_its_source(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "confseq", None)
    with pytest.raises(SystemExit, match=r"github\.com/gostevehoward/confseq .* numpy below 2"):
        check_sequential.library_rows(1)
