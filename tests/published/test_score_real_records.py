"""The 207 real cuts scored as a study of trials (Straizys et al. 2023); raters' opinions are no part of it."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
import score_real_records

from cutenv.scoring.study import NotEstimable, OneWay, Study, one_way_reliability

recorded = pytest.mark.needs("records")


@pytest.fixture(scope="module")
def scored() -> Study:
    return score_real_records.study_of(score_real_records.read_cuts(score_real_records.DATA))


@recorded
def test_every_cut_has_every_metric_that_force_alone_can_tell(scored: Study) -> None:
    assert len(scored.cuts) == 207
    assert len(scored.operators) == 18
    assert [found.metric for found in scored.findings] == [
        "peak_force",
        "force_time_integral",
        "force_variation",
        "force_drops",
        "mean_force_drop",
        "force_rate",
        "force_jerk",
        "crest_factor",
    ]
    assert all(found.missing == 0 for found in scored.findings)
    assert scored.notes == ()
    assert all(isinstance(found.separation, NotEstimable) for found in scored.findings), "who made a trial is not known"


@recorded
def test_peaks_are_those_of_the_numbers(scored: Study) -> None:
    peaks = next(found for found in scored.findings if found.metric == "peak_force")
    for trace in score_real_records.read_cuts(score_real_records.DATA):
        assert trace.force[:120].max() in peaks.series[trace.metadata["trial"]]


@recorded
def test_the_page_states_what_was_found(scored: Study) -> None:
    page = Path(__file__).parents[2] / "docs" / "validation" / "real-cuts.md"
    text = " ".join(page.read_text(encoding="utf-8").split())
    found = {
        each.metric: each.reliability.single.value for each in scored.findings if isinstance(each.reliability, OneWay)
    }
    least, *_, second, best = sorted(found, key=found.__getitem__)
    assert (least, {second, best}) == ("force_variation", {"force_rate", "force_time_integral"})
    said = re.search(r"best \(reliability of one cut ([\d.]+) and ([\d.]+)\), .* least \(([\d.]+)\)", text)
    assert said is not None
    assert said.groups() == (f"{found[second]:.2f}", f"{found[best]:.2f}", f"{found[least]:.2f}")


def check_cuts_of_a_trial_are_alike(series: list[np.ndarray]) -> None:
    found = one_way_reliability(series)
    assert found.single.low > 0.1
    assert found.people == 18
    assert found.total == 207


@recorded
def test_cuts_of_a_trial_are_alike_in_every_metric(scored: Study) -> None:
    for found in scored.findings:
        assert isinstance(found.reliability, OneWay)
        check_cuts_of_a_trial_are_alike(list(found.series.values()))


@recorded
def test_cuts_dealt_out_anew_are_not_alike(scored: Study) -> None:
    rng = np.random.default_rng(0)
    for found in scored.findings:
        sizes = [len(values) for values in found.series.values()]
        dealt = np.split(rng.permutation(np.concatenate(list(found.series.values()))), np.cumsum(sizes)[:-1])
        with pytest.raises(AssertionError):
            check_cuts_of_a_trial_are_alike(dealt)


@recorded
def test_the_script_prints_trials_and_metrics_and_writes_the_page(
    scored: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(score_real_records, "study_of", lambda cuts: scored)
    monkeypatch.setattr(sys, "argv", ["score_real_records.py", "--out", str(tmp_path / "new")])
    assert score_real_records.main() == 0
    printed = capsys.readouterr().out
    assert printed.count("\nT") == 18
    assert "nan" not in printed
    assert "not validated for assessment or credentialing" in printed
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["real_study.csv", "real_study.html"]


def test_a_missing_file_is_exit_code_2_and_the_cure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["score_real_records.py", "--data", str(tmp_path / "none.csv")])
    assert score_real_records.main() == 2
    assert "--data" in capsys.readouterr().err
