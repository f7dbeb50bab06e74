"""A crossover: the difference within people, freed of learning, against other routes to the same numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_up_study import sawing
from scipy.stats import t as student
from scipy.stats import ttest_rel

from cutenv.display.report.study_page import crossed_conditions, table_lines, write_study
from cutenv.records.scoring import score
from cutenv.records.scoring.study import StudiedCut, Study, condition_of, crossover, crossovers

EFFECT, LEARNING = -2.0, 5.0


def people(first: int, second: int, *, seed: int = 0) -> dict[str, list[tuple[str, float]]]:
    """Three cuts in each half: shown is EFFECT above hidden, and the second half LEARNING above the first."""
    rng = np.random.default_rng(seed)
    values = {}
    for n in range(first + second):
        order = ("shown", "hidden") if n < first else ("hidden", "shown")
        level = rng.normal(50.0, 20.0)
        values[f"P{n:02d}"] = [
            (condition, level + LEARNING * half + EFFECT * (condition == "shown") + rng.normal(0.0, 1.0))
            for half, condition in enumerate(order)
            for _ in range(3)
        ]
    return values


def test_it_is_the_least_squares_fit_with_a_level_for_each_person() -> None:
    values = people(5, 3)
    found = crossover(values)
    rows, y = [], []
    for n, cuts in enumerate(values.values()):
        for half, condition in enumerate(dict(cuts)):
            y.append(np.mean([value for each, value in cuts if each == condition]))
            rows.append([float(condition == "hidden"), float(half), *(float(n == k) for k in range(8))])
    X, y = np.array(rows), np.array(y)
    fit, *_ = np.linalg.lstsq(X, y, rcond=None)
    variance = ((y - X @ fit) ** 2).sum() / (len(y) - X.shape[1])
    errors = np.sqrt(np.diag(np.linalg.inv(X.T @ X)) * variance)
    reach = student.ppf(0.975, 6) * errors
    assert found.conditions == ("hidden", "shown")
    assert found.people == (3, 5)
    for estimate, k in ((found.difference, 0), (found.order, 1)):
        assert estimate is not None
        assert (estimate.value, estimate.low, estimate.high) == pytest.approx(
            (fit[k], fit[k] - reach[k], fit[k] + reach[k])
        )


def test_learning_is_told_apart_from_the_difference_only_if_the_order_is_balanced() -> None:
    balanced, one = crossover(people(8, 8)), crossover(people(16, 0))
    assert balanced.difference.low < -EFFECT < balanced.difference.high
    assert balanced.order is not None
    assert balanced.order.low < LEARNING < balanced.order.high
    assert (one.order, one.carry_over) == (None, None)
    assert one.difference.low > -EFFECT  # learning is taken for the condition
    means = [
        [np.mean([v for c, v in cuts if c == each]) for each in ("hidden", "shown")] for cuts in people(16, 0).values()
    ]
    interval = ttest_rel(*np.transpose(means)).confidence_interval()
    assert (one.difference.low, one.difference.high) == pytest.approx((interval.low, interval.high))


def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    held = [(d := crossover(people(3, 4, seed=n)).difference).low < -EFFECT < d.high for n in range(2000)]
    assert np.mean(held) == pytest.approx(0.95, abs=0.015)


def test_too_few_people_three_conditions_and_cuts_in_turns_are_refused() -> None:
    with pytest.raises(ValueError, match="2 people cut under both"):
        crossover(people(1, 1) | {"P99": [("shown", 1.0)]})
    with pytest.raises(ValueError, match="here are 3: hidden, other, shown"):
        crossover(people(2, 2) | {"P99": [("other", 1.0)]})
    with pytest.raises(ValueError, match="P99 cut 'hidden' and 'shown' in turns"):
        crossover(people(2, 2) | {"P99": [("shown", 1.0), ("hidden", 1.0), ("shown", 1.0)]})


def test_the_condition_is_in_the_records_of_a_crossover_alone() -> None:
    facts = {"course": "c", "feedback": "never", "crossover": True, "end": "finished"}
    assert condition_of(facts) == "never"
    assert condition_of(facts | {"end": "given up"}) == ""
    assert condition_of({"feedback": "never"}) == ""


def test_a_study_tells_it_for_every_metric_in_millimetres_and_newtons(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    cuts = []
    for n in range(6):
        for condition in ("always", "never") if n % 2 else ("never", "always"):
            for _ in range(2):
                card = score(sawing(0.2 if condition == "always" else 0.5, rng))
                cuts.append(StudiedCut(card=card, operator=f"P{n}", condition=condition))
    study = Study(name="made up", cuts=cuts, metrics=("force_rate",))
    assert list(crossovers(study)) == ["overall_score", "force_rate"]
    crossed = crossed_conditions(study)
    assert crossed is not None
    row = crossed.table.rows[1]
    assert (row.heading, row.marked) == (("force rate", "N/s"), True)
    text = "\n".join(table_lines(study))
    assert "3 began with always, 3 with never." in text
    pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")
    write_study(tmp_path / "study.html", study)
    assert "always minus never, within operators" in (tmp_path / "study.html").read_text(encoding="utf-8")
    assert "force rate [N/s]" in text
    plain = Study(name="made up", cuts=[StudiedCut(card=cut.card, operator=cut.operator) for cut in cuts])
    assert crossed_conditions(plain) is None
    assert "Feedback" not in "\n".join(table_lines(plain))
