"""The page of a cut as a file: one, whole, the same each time, with the record's numbers and no server behind it."""

from __future__ import annotations

import dataclasses
import re
import socket
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from view_pages import INSTANTS, array, block, document, shown, told

pytest.importorskip("meshcat", reason="the 3-D viewer is an extra: pip install 'cutenv[view3d]'")

from cutenv.display.viewer.solid import write_view
from cutenv.display.viewer.solid.solids import SlabSolid
from cutenv.display.viewer.solid.view_page import view_page


class References(HTMLParser):
    """Attributes by which a page fetches something."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [f"{tag} {name}={value}" for name, value in attrs if name in ("src", "href", "srcset", "action")]


@pytest.mark.parametrize("colour", ["displacement", "energy"])
def test_the_page_refers_to_nothing(colour: str) -> None:
    """No element fetches, and the browser is told to allow no fetch and no script but the two that are there."""
    page = document(colour)
    assert References(page).found == []
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    rules = {rule.split()[0]: rule.split()[1:] for rule in policy[1].split("; ")}
    assert rules["default-src"] == ["'none'"]
    assert set(rules) == {"default-src", "script-src", "style-src", "img-src"}
    assert len(rules["script-src"]) == 2
    assert all(source.startswith("'sha256-") for source in rules["script-src"])
    assert rules["img-src"] == ["data:", "blob:"]


def test_the_same_cut_makes_the_same_page() -> None:
    assert view_page(shown()) == document()


def test_no_server_is_started_and_no_program(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def refuse(*arguments: object, **_: object) -> None:
        raise AssertionError(f"not to be called: {arguments}")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    monkeypatch.setattr(socket, "socket", refuse)
    assert write_view(tmp_path / "page.html", shown()) > 0


def test_the_size_is_that_of_the_file_and_below_10_MB_with_160_instants(tmp_path: Path) -> None:
    size = write_view(tmp_path / "page.html", shown())
    assert (tmp_path / "page.html").stat().st_size == size
    per_instant = sum(len(block(document(), name)) for name in ("displacements", "amounts")) / INSTANTS
    assert size + (160 - INSTANTS) * per_instant < 10e6


def test_the_numbers_are_those_of_the_cut() -> None:
    cut, page = shown(), told(document())
    for name, values in (
        ("time_s", cut.time),
        ("force_N", cut.force),
        ("position_m", cut.position),
        ("angle_rad", cut.angle),
        ("tip_m", cut.tip),
    ):
        np.testing.assert_allclose(page[name], values, atol=5.1e-4 if name == "force_N" else 5.1e-5)


def test_displacements_come_back_to_a_micrometre_and_colours_to_a_step() -> None:
    solid, page = SlabSolid(shown()), document()
    i, step = 25, told(page)["displacement_step_m"]
    kept = array(page, "displacements", "<i2").reshape(INSTANTS, -1, 2)
    np.testing.assert_allclose(step * kept[i], solid.displacement(i), atol=1e-6)
    np.testing.assert_allclose(array(page, "rest", "<f4").reshape(-1, 3), solid.rest, atol=1e-7)
    amounts = array(page, "amounts", np.uint8).reshape(INSTANTS, -1)
    greatest = max(solid.amount(k, "displacement").max() for k in range(INSTANTS))
    np.testing.assert_allclose(amounts[i] / 255 * greatest, solid.amount(i, "displacement"), atol=greatest / 500)


def test_a_name_is_text_and_never_markup() -> None:
    page = view_page(dataclasses.replace(shown(), name="<script>alert(1)</script>"))
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt; in 3-D" in page


def test_what_is_estimated_or_illustration_is_said() -> None:
    page = document()
    assert "cut drawn open: illustration" in page
    assert "nothing exaggerated" in page
    assert "tip (from return stroke)" in page or "tip (estimated)" in page
    upright = view_page(dataclasses.replace(shown(), angle_known=False))
    assert "holds no angle" in upright
    assert "holds no angle" not in page


def test_the_licences_of_what_is_in_the_page_are_in_it() -> None:
    licences = block(document(), "licences")
    assert "MIT License" in licences or "Permission is hereby granted" in licences
    assert "Three.js Authors" in licences


def test_an_unknown_colour_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="colour"):
        write_view(tmp_path / "page.html", shown(), colour="stress")
    assert list(tmp_path.iterdir()) == []
