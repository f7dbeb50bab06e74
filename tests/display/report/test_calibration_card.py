"""The validation card: its data, and a page that holds everything and runs nothing that a record's name says."""

from __future__ import annotations

import dataclasses
import functools
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scripts.browsers import chromium

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from reading import Page
from test_pages_in_browser import check_fetches_nothing as check_only_itself_was_read
from test_pages_in_browser import check_fits
from virtual_session import MODEL, cuts, silent

from cutenv.display.report.calibration_card import (
    VALIDATION_SCHEMA,
    ValidationCard,
    calibration_headline,
    write_validation_card,
)
from cutenv.records.measurement import MeasuredCut, leave_one_out, tissue_of
from cutenv.records.measurement.calibration import RefusedRecord, with_findings
from cutenv.sim.tissue import TissueDescription, measured_liver

HOSTILE = "<script>document.title='taken'</script>\"' onload=alert(1) $\\frac{x}$ & 100%"


def card_of(some: list[MeasuredCut], refused: Sequence[RefusedRecord] = (), **options: Any) -> ValidationCard:
    options = {"resamples": 20, "name": "virtual liver"} | options
    return ValidationCard(tissue=with_findings(tissue_of(some, MODEL, **options), refused), model=MODEL, cuts=some)


@functools.cache
def card() -> ValidationCard:
    """Of two livers, some cuts of which show no modulus; and one record was left out."""
    return card_of(cuts()[6:], refused=[RefusedRecord("bad record", "no force")])


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page; its data lie beside it."""
    path = tmp_path_factory.mktemp("card") / "card.html"
    assert write_validation_card(path, card()) == path.with_suffix(".json")
    return path


@pytest.fixture(scope="module")
def page(written: Path) -> Page:
    return Page(written.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def content(written: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(written.with_suffix(".json").read_text(encoding="utf-8"))
    return found


def test_the_data_hold_the_tissue_as_it_is_used(content: dict[str, Any]) -> None:
    assert content["schema"] == VALIDATION_SCHEMA
    again = TissueDescription.from_json(json.dumps(content["tissue"]))
    assert again == card().tissue
    assert again.calibration == card().calibration


def test_the_data_hold_every_cut_with_units_in_the_names(content: dict[str, Any]) -> None:
    for row, cut in zip(content["cuts"], card().cuts, strict=True):
        assert (row["name"], row["specimen"]) == (cut.name, cut.specimen)
        assert row["speed_cm_s"] == pytest.approx(100.0 * cut.speed)
        assert row["angle_deg"] == pytest.approx(np.degrees(cut.angle))
        assert row["resistance_J_m2"] == cut.fracture.corrected
        assert row["apparent_resistance_J_m2"] == cut.fracture.apparent
        assert row["modulus_Pa"] == (cut.moduli.mean if len(cut.moduli) else None)
        assert row["return_stroke"] is True


def test_the_data_hold_the_prediction_of_every_cut(content: dict[str, Any]) -> None:
    expected = leave_one_out(card().cuts, MODEL)
    assert [row["name"] for row in content["left_out"]] == [each.name for each in expected]
    for row, each in zip(content["left_out"], expected, strict=True):
        for source in ("own_rmse", "same_rmse", "other_rmse"):
            assert row[f"{source}_N"] == pytest.approx(getattr(each, source))
    for source, error in content["median_prediction_error"].items():
        assert error["rmse_N"] == pytest.approx(np.median([getattr(each, source) for each in expected]))
        percent = [100.0 * getattr(each, source) / each.peak_force for each in expected]
        assert error["percent_of_peak"] == pytest.approx(np.median(percent))


def test_the_page_shows_every_number_with_its_provenance(page: Page) -> None:
    rows = {row[0]: row for row in page.rows if row}
    for each in card().calibration.evidence:
        row = rows[each.name.replace("_", " ")]
        assert row[4] == each.provenance
        assert row[5] == each.how
    assert rows["fracture resistance"][1].startswith(f"{card().tissue.fracture_resistance:.1f}"[:5])


def test_the_page_shows_every_cut_and_every_note(page: Page) -> None:
    first_cells = {row[0] for row in page.rows if row}
    assert {cut.name for cut in card().cuts} <= first_cells
    for note in card().calibration.notes:
        assert note in page.text
    assert "left out: bad record: no force" in page.text


def test_the_page_says_how_well_it_predicts_in_newtons_and_percent(page: Page) -> None:
    assert calibration_headline(card()) in page.text
    assert re.search(r"own specimen to 0\.\d\d N, \d+\.\d % of the peak", calibration_headline(card()))
    assert "from another specimen to" in calibration_headline(card())


def test_curves_are_drawn_from_the_best_prediction_to_the_worst() -> None:
    shown = [left_out for _, left_out in card().shown()]
    errors = sorted(each.same_rmse / each.peak_force for each in card().left_out if each.same_rmse is not None)
    assert len(shown) == 4
    assert shown[0].same_rmse / shown[0].peak_force == errors[0]  # type: ignore[operator]
    assert shown[-1].same_rmse / shown[-1].peak_force == errors[-1]  # type: ignore[operator]
    assert all(cut.name == left_out.name for cut, left_out in card().shown())


def test_the_page_names_no_other_address(page: Page) -> None:
    assert [address for address in page.addresses() if not address.startswith(("data:", "#"))] == []


# Odd sets of cuts.


def renamed(cut: MeasuredCut, name: str, specimen: str) -> MeasuredCut:
    return dataclasses.replace(cut, name=name, specimen=specimen)


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A card of records and a tissue with names that would do harm."""
    path = tmp_path_factory.mktemp("hostile") / "card.html"
    named = [renamed(cut, f"{n} {HOSTILE}", HOSTILE) for n, cut in enumerate(cuts()[:2])]
    refused = [RefusedRecord(HOSTILE, HOSTILE)]
    write_validation_card(path, card_of(named, resamples=0, name=HOSTILE, refused=refused))
    return path


@pytest.mark.filterwarnings("error")
def test_names_are_shown_as_they_are_and_run_nothing(hostile: Path) -> None:
    found = Page(hostile.read_text(encoding="utf-8"))
    assert not [name for name, _ in found.elements if name == "script"]
    assert not [attributes for _, attributes in found.elements if any(name.startswith("on") for name in attributes)]
    assert found.text.count(HOSTILE) >= 3
    assert json.loads(hostile.with_suffix(".json").read_text())["cuts"][0]["specimen"] == HOSTILE


def test_one_cut_has_a_card_that_says_what_is_missing(tmp_path: Path) -> None:
    single = card_of(cuts()[:1])
    write_validation_card(tmp_path / "card.html", single)
    page = Page((tmp_path / "card.html").read_text(encoding="utf-8"))
    assert "A single cut cannot be predicted from others" in page.text
    assert "1 cut of 1 specimen" in page.text
    assert "Not measured: slope_90, intercept_45" in page.text
    assert ["other cuts of its specimen", "not possible", "", "0"] in page.rows
    errors = json.loads(single.to_json())["median_prediction_error"]
    assert errors["same_rmse"] is errors["other_rmse"] is None
    assert errors["own_rmse"]["rmse_N"] > 0.0


def test_where_nothing_can_be_predicted_the_card_says_so(tmp_path: Path) -> None:
    """A tissue, and beside it only cuts that show no steady segment."""
    nothing = ValidationCard(tissue=card().tissue, model=MODEL, cuts=[silent(cuts()[0])])
    write_validation_card(tmp_path / "card.html", nothing)
    page = Page((tmp_path / "card.html").read_text(encoding="utf-8"))
    assert calibration_headline(nothing) in page.text
    assert "there is no force to predict" in calibration_headline(nothing)
    assert nothing.shown() == []


def test_a_tissue_that_was_not_calibrated_has_no_card() -> None:
    with pytest.raises(ValueError, match="'pig liver' was not calibrated from records"):
        ValidationCard(tissue=measured_liver(), model=MODEL, cuts=[])


# In a browser.


@pytest.mark.needs("chromium")
def test_a_browser_shows_the_pages_fetches_nothing_and_runs_no_name(
    browser: chromium.Browser, written: Path, hostile: Path
) -> None:
    for path, title in ((written, "Validation card: virtual liver"), (hostile, f"Validation card: {HOSTILE}")):
        for width in (1400, 390):
            browser.open(path, width)
            assert browser.value("document.title") == title
            check_fits(browser, width)
            check_only_itself_was_read(browser, path)
            shown = browser.value("[...document.images].map(i => i.complete && i.naturalWidth > 0)")
            assert shown == [True] * 3
