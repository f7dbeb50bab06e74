"""``cutenv field`` on files: what it prints and writes, and what it refuses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scripts.validation.measurement import filmed_cuts
from scripts.validation.measurement.filmed_cuts import FilmedCut, slice_of_zones

pytest.importorskip("pyarrow", reason="Parquet is an extra: pip install 'cutenv[vision]'")
pytest.importorskip("jinja2", reason="pages are an extra: pip install 'cutenv[vision]'")
pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[vision]'")

from cutenv.commands import cli
from cutenv.records import save


@pytest.fixture(scope="module")
def cut() -> FilmedCut:
    return filmed_cuts.filmed_cut(slice_of_zones([], [40e3], 0.02), divisions=(16, 30), frames=5.0, length=0.06)


@pytest.fixture(scope="module")
def folder(cut: FilmedCut, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("filmed")
    cut.tracks.save(folder / "tracks.parquet")
    save(cut.trace.select(slice(None, None, 10)), folder / "cut.csv")
    return folder


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Exit status, standard output and standard error."""
    capsys.readouterr()
    status = cli.main(["field", *map(str, arguments)])
    said = capsys.readouterr()
    return status, said.out, said.err


def refused(capsys: pytest.CaptureFixture[str], folder: Path, *arguments: object) -> str:
    status, out, err = run(capsys, *arguments, "--out", folder / "refused.html")
    assert (status, out) == (2, "")
    assert "Traceback" not in err
    assert not (folder / "refused.html").exists()
    return err


def test_modulus_by_force_by_image_and_put_in_stand_side_by_side(folder, capsys):
    page = folder / "new" / "page.html"
    status, out, _ = run(capsys, folder / "tracks.parquet", "--record", folder / "cut.csv", "--zones", 2, "--out", page)
    assert status == 0
    assert "Modulus by force 40." in out
    assert "put in 40.0 kPa" in out
    text = page.read_text(encoding="utf-8")
    for said in ("by force", "by image", "put in", "Bead by bead", "Moduli of zones", "What a reader must know"):
        assert said in text
    found = json.loads(page.with_suffix(".json").read_text())
    assert found["modulus_put_in_Pa"] == 40e3
    for name in ("modulus_by_force_Pa", "modulus_by_image_Pa"):
        assert found[name]["mean"] == pytest.approx(40e3, rel=0.03)
    assert found["zones"]["modulus_Pa"] == pytest.approx([40e3, 40e3], rel=0.1)
    assert len(found["beads"]) == 98
    assert found["field"]["rms_m"] < 0.15e-3


def test_the_truth_can_be_given(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = run(
        capsys, folder / "tracks.parquet", "--record", folder / "cut.csv", "--truth", 50e3, "--out", folder / "t.html"
    )[1]
    assert "put in 50.0 kPa" in out
    assert "Moduli of zones" not in (folder / "t.html").read_text(encoding="utf-8")


def test_tracks_of_another_cut_are_refused(cut: FilmedCut, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    replace(cut.tracks, time=cut.tracks.time + 500.0).save(folder / "late.parquet")
    said = refused(capsys, folder, folder / "late.parquet", "--record", folder / "cut.csv")
    assert "they are of different cuts, or their clocks are not in step" in said


@pytest.mark.parametrize(
    ("option", "value", "told"),
    [
        ("--zones", 0, "--zones 0: give 1 or more"),
        ("--zones", 30, "zones = 30: a cut of"),
        ("--width", "8", "--width '8' is no length with a unit"),
        ("--offset", "15mm", "offset = 0.015 m is no multiple of the elements' 0.01 m"),
        ("--truth", 40, "--truth = 40 Pa is outside"),
        ("--cut", 7, "--cut 7: the file holds cuts 1"),
    ],
)
def test_bad_options_are_refused(option, value, told, folder, capsys):
    said = refused(capsys, folder, folder / "tracks.parquet", "--record", folder / "cut.csv", option, value)
    assert told in said


@pytest.mark.parametrize("seed", range(8))
def test_a_damaged_file_ends_in_a_reason(seed: int, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(seed)
    content = bytearray((folder / "tracks.parquet").read_bytes())
    for place in rng.integers(len(content), size=20):
        content[place] ^= int(rng.integers(1, 256))
    (folder / "damaged.parquet").write_bytes(bytes(content[: len(content) if seed % 2 else rng.integers(len(content))]))
    said = refused(capsys, folder, folder / "damaged.parquet", "--record", folder / "cut.csv")
    assert said.startswith("cutenv field: ")


def test_a_file_that_holds_no_tracks_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, folder, folder / "cut.csv", "--record", folder / "cut.csv")
    assert "is not a Parquet file, or it is damaged" in said
