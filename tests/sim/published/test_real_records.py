"""Real cuts, recorded by others: 207 hand-held scalpel excisions (Straizys et al. 2023), read and scored."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from cutenv.records.measurement import estimate_fracture_resistance, estimate_local_effective_moduli
from cutenv.records.measurement.segments import STRAIGHT_RAMP
from cutenv.records.scoring.study import NotEstimable, OneWay, Study, one_way_reliability
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.trace import Trace
from scripts.validation.records import real_records, score_real_records

recorded = pytest.mark.needs("records")


@pytest.fixture(scope="module")
def cuts() -> list[Trace]:
    return real_records.read_cuts(real_records.DATA)


def check_they_are_the_published_cuts(cuts: list[Trace]) -> None:
    """18 trials, 207 cuts, 180 samples each at 30 Hz, normalised to the data set's maximum."""
    assert len(cuts) == 207
    assert sorted({cut.metadata["trial"] for cut in cuts}) == [f"T{i:02d}" for i in range(1, 19)]
    assert all(len(cut) == 180 for cut in cuts)
    assert all(cut.sample_rate == pytest.approx(30.0, rel=1e-4) for cut in cuts)
    assert all(cut.force_unit == "1" for cut in cuts)
    assert max(cut.force.max() for cut in cuts) == 1.0


@recorded
def test_all_published_cuts_are_read(cuts: list[Trace]) -> None:
    check_they_are_the_published_cuts(cuts)
    with pytest.raises(AssertionError):
        check_they_are_the_published_cuts(cuts[:-1])


@recorded
def test_a_cut_tells_where_it_comes_from(cuts: list[Trace]) -> None:
    assert len({(cut.metadata["trial"], cut.metadata["cut"]) for cut in cuts}) == 207
    for cut in cuts:
        assert "straizys" in cut.metadata["source"]
        assert cut.metadata["licence"].startswith("MIT")
        assert cut.known == ("time", "force")


@recorded
def test_what_needs_newtons_or_position_refuses_them_by_name(cuts: list[Trace]) -> None:
    cut = cuts[0]
    for refuses in (estimate_fracture_resistance, lambda trace: estimate_local_effective_moduli(trace, CutModel())):
        with pytest.raises(ValueError, match=r'needs force in newtons .force_unit "N".'):
            refuses(cut)
        with pytest.raises(ValueError, match="needs position"):
            refuses(Trace(time=cut.time, force=5.0 * cut.force, force_unit="N"))


@recorded
def test_statistics_are_those_of_the_numbers(cuts: list[Trace]) -> None:
    trial = [cut for cut in cuts if cut.metadata["trial"] == "T08"]
    forces = np.array([cut.force[:120] for cut in trial])
    statistics = real_records.force_statistics(trial)
    assert statistics["cuts"] == 10
    assert statistics["mean"] == pytest.approx(forces.mean())
    assert statistics["peak"] == pytest.approx(forces.max(axis=1).mean())
    assert statistics["sd"] == pytest.approx(forces.std(axis=1).mean())
    assert statistics["rms_rate"] == pytest.approx(30.0 * np.sqrt((np.diff(forces) ** 2).mean()), rel=2e-3)


def sawing(drops: int, rate: float) -> Trace:
    """Six seconds at 30 Hz: ramps of one rate, each ended by a drop of 0.3, and a last ramp that none ends."""
    time = np.arange(180) / 30.0
    ramp = 4.0 / (drops + 1)
    return Trace(time=time, force=np.minimum(rate * (time % ramp), 0.3), force_unit="1")


def check_the_saws_are_counted(cuts: list[Trace]) -> None:
    found = real_records.segment_statistics(cuts)
    assert found["cuts"] == 3
    assert (found["drops"], found["drops_sd"]) == (pytest.approx(3.0), pytest.approx(np.std([2, 3, 4])))
    assert found["drop"] == pytest.approx(0.3, rel=0.01)
    assert found["first_rate"] == pytest.approx(0.8, rel=0.05)
    assert found["straight"] == 1.0
    later = [found[name] for name in ("rate_low", "rate", "rate_high")]
    assert later == sorted(later) == pytest.approx([0.8] * 3, rel=0.05)


def test_drops_and_rates_of_a_saw_are_those_put_in() -> None:
    check_the_saws_are_counted([sawing(drops, 0.8) for drops in (2, 3, 4)])
    with pytest.raises(AssertionError):
        check_the_saws_are_counted([sawing(drops, 0.8) for drops in (2, 3, 5)])


def test_a_smooth_trial_has_no_later_rate() -> None:
    rising = Trace(time=np.arange(180) / 30.0, force=np.linspace(0.0, 0.9, 180), force_unit="1")
    found = real_records.segment_statistics([rising])
    assert found["drops"] == 0.0
    assert found["first_rate"] == pytest.approx(0.9 / (179 / 30.0))
    assert np.isnan([found["drop"], found["rate"]]).all()


@recorded
def test_real_drops_are_falls_of_the_real_force(cuts: list[Trace]) -> None:
    """Every drop is there in the readings: no reading lies above the hilltop until the force has fallen by it."""
    n = 0
    for cut in cuts:
        for s in real_records.segments_of(cut):
            assert s.rate > 0.0 or s.r_squared < STRAIGHT_RAMP
            if s.drop > 0.0:
                after = cut.force[s.stop : real_records.CUT_SAMPLES]
                fallen = int(np.argmax(after <= after[0] - s.drop + 1e-12))
                assert fallen > 0
                assert after[0] == after[: fallen + 1].max()
                n += 1
    assert n > len(cuts)


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["real_records.py", *map(str, arguments)])
    return real_records.main()


@recorded
def test_the_script_prints_a_row_for_every_trial_and_draws_cuts_and_trials(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from matplotlib.image import imread

    assert run(monkeypatch, "--out", tmp_path / "new") == 0
    printed = capsys.readouterr().out
    assert len(re.findall(r"^T\d+ ", printed, re.MULTILINE)) == 36
    assert printed.count("\nall ") == 2
    assert "nan" not in printed
    assert sorted(file.name for file in (tmp_path / "new").iterdir()) == ["real_cuts.png", "real_trials.png"]
    for file in (tmp_path / "new").iterdir():
        inked = np.mean(np.any(imread(file)[..., :3] < 0.9, axis=-1))
        assert 0.005 < inked < 0.7


def test_a_missing_file_is_exit_code_2_and_the_cure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "--data", tmp_path / "none.csv") == 2
    assert "--data" in capsys.readouterr().err


def test_another_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.csv"
    path.write_text("# a comment\ntime,force\n0,1\n")
    with pytest.raises(ValueError, match=r"there is no column .* there are time, force"):
        real_records.read_cuts(path)


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
    page = Path(__file__).parents[3] / "docs" / "validation" / "real-cuts.md"
    text = " ".join(page.read_text(encoding="utf-8").split())
    found = {
        each.metric: each.reliability.single.value for each in scored.findings if isinstance(each.reliability, OneWay)
    }
    least, *_, second, best = sorted(found, key=found.__getitem__)
    assert (least, {second, best}) == ("force_variation", {"force_rate", "force_time_integral"})
    said = re.search(r"best \(reliability of one cut ([\d.]+) and ([\d.]+)\), .* least \(([\d.]+)\)", text)
    assert said is not None
    assert said.groups() == (f"{found[second]:.2f}", f"{found[best]:.2f}", f"{found[least]:.2f}")


@recorded
def test_cuts_of_a_trial_are_alike_in_every_metric(scored: Study) -> None:
    for each in scored.findings:
        assert isinstance(each.reliability, OneWay)
        found = one_way_reliability(list(each.series.values()))
        assert found.single.low > 0.1
        assert (found.people, found.total) == (18, 207)


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


def test_a_missing_file_of_cuts_to_score_is_exit_code_2_and_the_cure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["score_real_records.py", "--data", str(tmp_path / "none.csv")])
    assert score_real_records.main() == 2
    assert "--data" in capsys.readouterr().err
