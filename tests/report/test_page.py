"""Building blocks: numbers as print sets them, tables that fit, shades that can be read on."""

from __future__ import annotations

import re

import pytest
from reading import Page

from cutenv.report.page import Html, PageSection, Row, escaped, estimate_text, html_table, number, page
from cutenv.report.training_figures import heat_map


@pytest.mark.parametrize(
    ("value", "digits", "shown"),
    [(0.126, 2, "0.13"), (-0.126, 2, "\u22120.13"), (-0.004, 2, "0.00"), (-1.2e-17, 3, "0.000"), (12.0, 0, "12")],
)
def test_a_number_has_a_true_minus_and_no_negative_zero(value: float, digits: int, shown: str) -> None:
    assert number(value, digits) == shown


def test_an_estimate_reads_as_mean_and_interval() -> None:
    assert "".join(re.split(r"<[^>]*>", estimate_text(0.5, -0.25, 1.25, 2))) == "0.50 [\u22120.25, 1.25]"


def test_a_ragged_table_is_refused() -> None:
    with pytest.raises(ValueError, match="row 1 of table 'Scores' has 1 cells for 2 columns"):
        html_table("Scores", [Html("a"), Html("b")], [Row([Html("1"), Html("2")]), Row([Html("1")])])


def test_a_page_is_a_whole_document_in_a_language_for_any_screen() -> None:
    document = page(
        "A & B", "of <today>", Html("<p>lead</p>"), [PageSection("one", "First & last", Html("<p>body</p>"))]
    )
    assert document.startswith("<!DOCTYPE html>")
    found = Page(document)
    elements = [(name, attributes.get("name", attributes.get("lang", ""))) for name, attributes in found.elements]
    assert ("html", "en") in elements
    assert ("meta", "viewport") in elements
    assert found.headings == [(1, "A & B"), (2, "First & last")]
    assert "of <today>" in found.text
    assert "prefers-color-scheme: dark" in document


def test_escaped_text_cannot_leave_an_attribute() -> None:
    assert Page(f'<p title="{escaped("a" + chr(34) + " onclick=" + chr(39))}">').elements == [
        ("p", {"title": "a\" onclick='"})
    ]


def luminance(colour: str) -> float:
    """Relative luminance of #rrggbb or #rgb (WCAG 2.2)."""
    digits = colour[1:] if len(colour) == 7 else "".join(2 * digit for digit in colour[1:])
    values = [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
    red, green, blue = (v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in values)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def check_shades_can_be_read(markup: str) -> None:
    """The numbers' contrast with their cell is 4.5 at least."""
    shades = re.findall(r"background:(#\w+);color:(#\w+)", markup)
    assert len(shades) == 41
    for pair in shades:
        dark, light = sorted(map(luminance, pair))
        assert (light + 0.05) / (dark + 0.05) >= 4.5, pair


def shaded_table() -> str:
    rows = [{"speed_cm_s": 1.0, "angle_deg": k, "mean": 0.1 * k, "low_95": 0.0, "high_95": 5.0} for k in range(41)]
    return heat_map([row | {"success": 0.5} for row in rows])


def test_numbers_can_be_read_on_every_shade() -> None:
    check_shades_can_be_read(shaded_table())


def test_a_shade_that_hides_its_number_is_noticed() -> None:
    with pytest.raises(AssertionError):
        check_shades_can_be_read(shaded_table().replace("color:#000", "color:#fff"))


def test_a_grid_of_equal_returns_is_shaded_too() -> None:
    row = {"speed_cm_s": 1.0, "angle_deg": 90, "mean": 0.3, "low_95": 0.2, "high_95": 0.4, "success": 0.5}
    assert "0.30" in heat_map([row])
