"""Parts that pages share: numbers in print typography, the document, escaped text, legible shades."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import pytest
from reading import Page

pytest.importorskip("jinja2", reason="pages are an extra: pip install 'cutenv[view]'")

from jinja2 import UndefinedError

from cutenv.display.report.page import estimate_text, number, write_page
from cutenv.display.report.training_page import grid_shade

PAGE = """{% extends "page.html" %}
{% from "parts.html" import row, table %}
{% set sections = [("one", heading)] %}
{% block one %}
<p title="{{ heading }}">{{ body }}</p>
{% call table("Scores", ["policy", ("return", "1")]) %}{{ row(heading, [estimate]) }}{% endcall %}
{% endblock %}
"""
HOSTILE = """First & <last> " onclick='"""


def written(folder: Path, **values: Any) -> str:
    """A page of one section."""
    (folder / "some.html").write_text(PAGE, encoding="utf-8")
    values = {"title": "A & B", "subtitle": "of <today>", "heading": HOSTILE, "estimate": "0.50 [-0.25, 1.25]"} | values
    write_page(folder / "written.html", folder / "some.html", **values)
    return (folder / "written.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("value", "digits", "shown"),
    [(0.126, 2, "0.13"), (-0.126, 2, "\u22120.13"), (-0.004, 2, "0.00"), (-1.2e-17, 3, "0.000"), (12.0, 0, "12")],
)
def test_a_number_has_a_true_minus_and_no_negative_zero(value: float, digits: int, shown: str) -> None:
    assert number(value, digits) == shown


def test_an_estimate_reads_as_mean_and_interval_in_small_type(tmp_path: Path) -> None:
    assert estimate_text(0.5, -0.25, 1.25, 2) == "0.50 [\u22120.25, 1.25]"
    document = written(tmp_path, body="")
    assert '<td>0.50 <span class="interval">[\u22120.25, 1.25]</span></td>' in document
    assert "<td>group-1 [0-2]</td>" in written(tmp_path, body="", estimate="group-1 [0-2]"), "no estimate"
    assert Page(document).rows == [["policy", "return [1]"], [HOSTILE.strip(), "0.50 [\u22120.25, 1.25]"]]


def test_a_page_is_a_whole_document_in_a_language_for_any_screen(tmp_path: Path) -> None:
    document = written(tmp_path, body="text")
    assert document.startswith("<!DOCTYPE html>")
    found = Page(document)
    elements = [(name, attributes.get("name", attributes.get("lang", ""))) for name, attributes in found.elements]
    assert ("html", "en") in elements
    assert ("meta", "viewport") in elements
    assert found.headings == [(1, "A & B"), (2, HOSTILE)]
    assert "of <today>" in found.text
    assert "prefers-color-scheme: dark" in document


def test_text_cannot_leave_its_place_or_its_attribute(tmp_path: Path) -> None:
    elements = Page(written(tmp_path, body="<script>alert(1)</script>")).elements
    assert ("p", {"title": HOSTILE}) in elements
    assert "script" not in [name for name, _ in elements]


def test_a_value_that_is_missing_is_an_error_and_leaves_no_page(tmp_path: Path) -> None:
    with pytest.raises(UndefinedError, match="'body' is undefined"):
        written(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["some.html"]


def test_a_missing_jinja2_is_named_with_the_cure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(ImportError, match=re.escape("pip install 'cutenv[view]'")):
        written(tmp_path, body="")


def luminance(colour: str) -> float:
    """Relative luminance of #rrggbb or #rgb (WCAG 2.2)."""
    digits = colour[1:] if len(colour) == 7 else "".join(2 * digit for digit in colour[1:])
    values = [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
    red, green, blue = (v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in values)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


SHADES = [grid_shade([0.0, 40.0], float(k)) for k in range(41)]


def test_numbers_can_be_read_on_every_shade() -> None:
    assert len(set(SHADES)) > 20
    for style in SHADES:
        ((background, ink),) = re.findall(r"background:(#\w+);color:(#\w+)", style)
        dark, light = sorted((luminance(background), luminance(ink)))
        assert (light + 0.05) / (dark + 0.05) >= 4.5, style


def test_a_grid_of_equal_returns_is_shaded_too() -> None:
    assert grid_shade([0.3], 0.3) == SHADES[0]
