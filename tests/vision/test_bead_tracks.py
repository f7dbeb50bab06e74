"""Bead tracks as arrays and as a file."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

from cutenv.vision import BeadTracks

pytest.importorskip("pyarrow", reason="Parquet is an extra: pip install 'cutenv[vision]'")


def some(**changed):
    n = 6
    spread = np.random.default_rng(1).normal(size=(n, 3, 3))
    given = {
        "bead": np.array([4, 4, 4, 9, 9, 9]),
        "time": np.array([0.2, 0.0, 0.1] * 2),
        "place": np.arange(3.0 * n).reshape(n, 3),
        "covariance": spread @ spread.transpose(0, 2, 1),
        "metadata": {"residual_m": 1e-5},
    }
    return BeadTracks(**given | changed)


def test_a_file_gives_back_what_was_saved(tmp_path):
    tracks = some()
    tracks.save(tmp_path / "tracks.parquet")
    again = BeadTracks.load(tmp_path / "tracks.parquet")
    for name in ("bead", "time", "place", "covariance"):
        assert np.array_equal(getattr(again, name), getattr(tracks, name))
    assert again.metadata == tracks.metadata


def test_one_bead_is_in_order_of_time():
    one = some().of(4)
    assert one.time.tolist() == [0.0, 0.1, 0.2]
    assert one.place[:, 0].tolist() == [3.0, 6.0, 0.0]
    with pytest.raises(KeyError, match=r"no bead 5; there are \[4, 9\]"):
        some().of(5)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"time": np.zeros(5)}, "time has shape"),
        ({"place": np.full((6, 3), np.nan)}, "place is not finite in row 0"),
        ({"time": np.zeros(6)}, "two places at the same time"),
    ],
)
def test_bad_tracks_are_refused(changed, told):
    with pytest.raises(ValueError, match=told):
        some(**changed)


def test_a_damaged_file_is_a_clear_error(tmp_path):
    path = tmp_path / "tracks.parquet"
    some().save(path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(60):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 3):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(bytes(damaged)[: rng.integers(1, len(whole) + 1)])
        with contextlib.suppress(ValueError):  # where the damage does not show, the numbers are others
            BeadTracks.load(path)


def test_a_file_that_is_not_there_is_said_to_be_missing(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no such file: .*tracks\.parquet"):
        BeadTracks.load(tmp_path / "tracks.parquet")
