"""The score card: what it shows and does not claim, where the faults are, and what a trainee is told."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import re

import numpy as np
import pytest
from made_up_study import sawing
from scored_cuts import CUTS, TARGET, changed, cut

from cutenv.records.scoring import METRICS, ReferenceSet, ScoreCard, Truth, score
from cutenv.records.scoring.cut_metrics import FORCE_WEIGHTS
from cutenv.records.scoring.doubts import DOUBT
from cutenv.records.scoring.points import ACCURACY_POINTS, LIMIT_POINTS, SUCCESS_POINTS, WAY_POINTS, ScorePoints
from cutenv.records.scoring.reference import FEWEST_REFERENCE_CUTS
from cutenv.records.scoring.score_card import FEWEST_WEIGHT
from cutenv.records.scoring.study.learning import mean_points, next_tries, outcome_counts
from cutenv.records.scoring.technique import TechniqueFault
from cutenv.records.scoring.truth import TIP_AT_END
from cutenv.sim.quantities import CLOSE, TIP_TOLERANCE
from cutenv.sim.trace import Trace

UPRIGHT = "upright, and back"
ALONE = "force alone, 30 Hz"


def reference(force_unit: str = "N", cuts: int = 40, **columns: object) -> ReferenceSet:
    """Cuts whose every metric runs from 0 to 1 times what is given, by default twice that of the upright cut."""
    card = score(cut(UPRIGHT) if force_unit == "N" else cut(ALONE), target_length=TARGET)
    share = (np.arange(cuts) + 0.5) / cuts
    values = {
        name: 2.0 * max(scored.value, 1e-9) * share for name, scored in card.metrics.items() if scored.value is not None
    }
    values |= columns  # type: ignore[arg-type]
    return ReferenceSet(
        name="made up", about="even spread", force_unit=force_unit, groups=("someone",) * cuts, values=values
    )


@functools.cache
def cards() -> dict[str, ScoreCard]:
    """Of every cut, with a reference set of its unit."""
    return {kind: score(cut(kind), target_length=TARGET, reference=reference(cut(kind).force_unit)) for kind in CUTS}


def check_no_nan(card: ScoreCard) -> None:
    """Every metric has a finite value or a reason, and JSON says so, too."""
    for name, scored in card.metrics.items():
        assert (scored.value is None) == bool(scored.unavailable), name
        assert scored.value is None or math.isfinite(scored.value), name
    told = json.loads(card.to_json(), parse_constant=lambda constant: pytest.fail(constant))
    assert list(told["metrics"]) == list(METRICS)


@pytest.mark.parametrize("kind", CUTS)
def test_what_is_not_known_is_unavailable_and_never_nan(kind: str) -> None:
    check_no_nan(cards()[kind])
    check_no_nan(score(cut(kind)))


def test_the_card_is_printed_in_the_units_of_people() -> None:
    card = score(cut(UPRIGHT), target_length=TARGET, reference=reference())
    tip_error = f"{1e3 * card['tip_error']:.4g}"
    assert card.readable("tip_error") == (tip_error, "mm")
    assert card.readable("force_drops") == (f"{card['force_drops']:.0f}", "")
    assert abs(card["wedge"]) < 1e-15  # the cosine of a right angle
    assert card.readable("wedge") == ("0", "")
    assert not re.search(r"\d 1( |$)|e-1\d", str(card), re.MULTILINE)
    assert re.search(rf"tip_error +{re.escape(tip_error)} mm +better than \d+ % of the reference", str(card))


def test_one_depth_for_a_whole_cut_is_doubted_unless_it_is_simulated() -> None:
    trace = dataclasses.replace(cut(UPRIGHT), metadata={})
    even = changed(trace, depth=np.full(len(trace), float(trace.depth.max())))
    short = changed(even, position=0.2 * even.position)

    def doubts(of: Trace) -> list[str]:
        return [note for note in score(of, target_length=TARGET).notes if note.startswith(DOUBT)]

    (doubt,) = doubts(even)
    assert "mm at every reading of" in doubt
    assert "caliper" in doubt
    assert not doubts(trace)
    assert not doubts(short)
    assert not doubts(even.with_metadata({"specimen_class": "uniform"}))


def test_without_a_reference_force_alone_has_metrics_and_no_claim() -> None:
    card = score(cut(ALONE))
    assert card.overall_score is None
    assert not card.points
    assert all(scored.percentile is None for scored in card.metrics.values())
    assert "no reference set" in card.headline()
    assert card["force_rate"] > 0.0


@pytest.mark.parametrize("kind", CUTS)
def test_the_points_add_up_to_the_overall_score(kind: str) -> None:
    card = cards()[kind]
    assert card.overall_score == pytest.approx(sum(each.points for each in card.points))
    assert all(0.0 <= each.points <= each.most for each in card.points)
    for each in card.points:
        (line,) = (line for line in str(card).splitlines() if re.match(rf"  {each.part} .* points: ", line))
        assert f"{each.points:.1f} of" in line


def test_force_alone_is_the_weighted_mean_of_percentiles() -> None:
    card = cards()[ALONE]
    by_hand = sum(weight * float(card.metrics[name].percentile or 0.0) for name, weight in FORCE_WEIGHTS.items())
    assert card.overall_score == pytest.approx(by_hand)


def told(tip_at_end: float, **metadata: object) -> ScoreCard:
    """The upright cut, as if a simulator had noted that its tip ended there [m]."""
    trace = cut(UPRIGHT)
    return score(
        changed(trace, metadata=dict(trace.metadata) | {TIP_AT_END: tip_at_end} | metadata), target_length=TARGET
    )


def test_every_success_has_more_than_any_failure() -> None:
    near = [told(TARGET + off).overall_score for off in (-0.0029, 0.0, 0.0029)]
    missed = [told(TARGET + off).overall_score for off in (-0.05, -0.0031, 0.0031, 0.0049)]
    given_up = told(TARGET, end="given up")
    assert max(*missed, given_up.overall_score) < min(near)
    assert "not finished: given up" in given_up.outcome
    most_of_a_failure = LIMIT_POINTS + WAY_POINTS + ACCURACY_POINTS  # uncharged, or by a blade that leans
    shortest = WAY_POINTS * (1.0 - TIP_TOLERANCE / 0.06) + ACCURACY_POINTS * (1.0 - TIP_TOLERANCE / CLOSE)
    assert most_of_a_failure < LIMIT_POINTS + shortest + SUCCESS_POINTS  # the least that a success has
    assert min(near) > LIMIT_POINTS + shortest + SUCCESS_POINTS


def test_a_part_that_was_cut_counts_by_how_far() -> None:
    scores = [told(share * TARGET).overall_score for share in (0.1, 0.4, 0.7, 0.95)]
    assert scores == sorted(scores)
    assert scores[0] < 12.0


@pytest.mark.parametrize(
    ("metadata", "end", "outcome"),
    [
        ({}, TARGET + 0.0061, "the cut is 6 mm too long"),
        ({"end": "overshoot"}, TARGET, "the cut is 5 mm too long"),
        ({"end": "force_limit"}, TARGET, "the force exceeded 1000 N per metre of depth"),
    ],
)
def test_beyond_a_limit_little_counts(metadata, end, outcome) -> None:
    card, within = told(end, **metadata), told(end, end="given up")
    assert card.outcome == outcome
    assert card.overall_score < LIMIT_POINTS  # what a cut has that is not begun, without any charge
    assert card.overall_score < 0.2 * within.overall_score or within.outcome == outcome


def test_runs_and_haste_cost_points() -> None:
    trace, still = jumped(0.0, 0.03)
    points = {each.part: each.points for each in score(trace, target_length=TARGET, truth=still).points}
    trace, run = jumped(0.012, 0.03)
    after = {each.part: each.points for each in score(trace, target_length=TARGET, truth=run).points}
    assert after["tissue"] < points["tissue"] - 5.0
    assert {name for name in points if after[name] != points[name]} == {"tissue"}
    flung = changed(trace, position=trace.position + 0.01 / (1.0 + np.exp((0.5 - trace.time) / 0.01)))
    hasty = score(flung, target_length=TARGET, truth=still)
    assert {each.part: each.points for each in hasty.points}["control"] < points["control"] - 5.0
    ((_, says),) = faults(hasty, "haste")
    assert says.startswith("the blade shot forward at 2")
    assert says.endswith(" s, too fast to stop within 9 mm")
    assert not faults(score(trace, target_length=TARGET, truth=still), "haste")


def test_weights_are_of_metrics_that_have_a_direction_and_sum_to_one() -> None:
    assert sum(FORCE_WEIGHTS.values()) == pytest.approx(1.0)
    assert all(METRICS[name].direction != "none" for name in FORCE_WEIGHTS)
    assert not {"peak_force", "peak_force_per_depth"} & set(FORCE_WEIGHTS)


def test_force_alone_is_scored_by_its_own_weights_and_says_so() -> None:
    card = cards()[ALONE]
    assert {each.part for each in card.points} == set(FORCE_WEIGHTS)
    assert card.tip_source == "unknown"
    assert "tip: unknown; force alone is judged" in card.notes
    assert "position was not recorded" in card.metrics["idle_time"].unavailable
    assert card.unit("force_rate") == "1/s"
    assert cards()[UPRIGHT].unit("force_rate") == "N/s"


def test_a_reference_of_another_force_unit_gives_no_percentile() -> None:
    card = score(cut(ALONE), target_length=TARGET, reference=reference("N"))
    assert card.overall_score is None
    assert "in unit 'N'" in card.no_score
    assert all(scored.percentile is None for scored in card.metrics.values())


def test_percentiles_are_the_share_that_is_worse() -> None:
    ladder = reference(duration=np.arange(20.0, 60.0), sparc=-np.arange(1.0, 41.0))
    assert ladder.percentile("duration", 10.0) == 100.0
    assert ladder.percentile("duration", 60.0) == 0.0
    assert ladder.percentile("duration", 29.5) == 75.0  # 10 of 40 are shorter
    assert ladder.percentile("duration", 30.0) == 100.0 * 29.5 / 40.0  # a tie counts half
    assert ladder.percentile("sparc", -3.0) is None  # smoothness is not ranked


def test_a_percentile_within_few_cuts_says_nothing() -> None:
    assert reference(cuts=FEWEST_REFERENCE_CUTS).percentile("duration", 0.0) == 100.0
    assert reference(cuts=FEWEST_REFERENCE_CUTS - 1).percentile("duration", 0.0) is None


def test_little_known_is_no_score_of_the_whole() -> None:
    """A reference set that knows only the time ranks nobody."""
    only_time = dataclasses.replace(reference(), values={"duration": np.arange(1.0, 41.0)})
    card = score(cut(UPRIGHT), reference=only_time)
    assert card.overall_score is None
    assert f"{FEWEST_WEIGHT:.0%} are needed" in card.no_score
    assert card.metrics["duration"].percentile is not None


def test_html_shows_markup_in_names_as_text() -> None:
    nasty = "<script>alert('cut')</script>"
    trace = changed(cut(UPRIGHT), metadata={"name": nasty})
    named = dataclasses.replace(reference(), name=nasty)
    page = score(trace, target_length=TARGET, reference=named)._repr_html_()
    assert "<script" not in page
    assert page.count("&lt;script&gt;") == 2


def test_a_reference_set_survives_its_file(tmp_path: object) -> None:
    path = tmp_path / "set.csv"  # type: ignore[operator]
    before = reference(tip_error=np.where(np.arange(40) < 3, np.nan, 0.001))
    before.save(path)
    after = ReferenceSet.load(path)
    assert (after.name, after.about, after.force_unit, after.groups) == ("made up", "even spread", "N", before.groups)
    for name, values in before.values.items():
        np.testing.assert_allclose(after.values[name], values, rtol=1e-4)
    path.write_text("time,force\n0,1\n")
    with pytest.raises(ValueError, match="is not a reference set"):
        ReferenceSet.load(path)


def faults(card: ScoreCard, kind: str) -> list[tuple[float, str]]:
    return [(fault.position or 0.0, fault.says) for fault in card.faults if fault.kind == kind]


def jumped(size: float, place: float) -> tuple[object, Truth]:
    """The upright cut, as if its crack had run once, by ``size`` with the blade at ``place`` [m]."""
    trace = cut("upright, one way")
    jump = np.zeros(len(trace))
    jump[int(np.argmax(trace.position >= place))] = size  # type: ignore[operator]
    tip = np.maximum(trace.position - 0.006, 0.0)  # type: ignore[operator]
    return trace, Truth(tip=tip, jump=jump, resistance=200.0)


@pytest.mark.parametrize(("size", "place"), [(0.004, 0.03), (0.009, 0.055)])
def test_a_lurch_is_told_with_its_place_and_size(size: float, place: float) -> None:
    trace, truth = jumped(size, place)
    ((position, says),) = faults(score(trace, target_length=TARGET, truth=truth), "lurch")  # type: ignore[arg-type]
    assert position == pytest.approx(place, abs=1e-4)
    seconds = trace.time[np.argmax(truth.jump)]  # type: ignore[attr-defined]
    assert says == f"the tissue tore on by {1e3 * size:.0f} mm at {1e2 * place:.1f} cm, after {seconds:.1f} s"


def test_a_small_run_is_no_lurch() -> None:
    trace, truth = jumped(0.0025, 0.03)
    assert not faults(score(trace, target_length=TARGET, truth=truth), "lurch")  # type: ignore[arg-type]


def test_a_lurch_in_the_force_is_found_where_it_was() -> None:
    """The tip is estimated from the force: a sudden fall by what nearly 5 mm of stiffness hold."""
    trace = cut("upright, one way")
    x = trace.position
    assert x is not None
    falls = x >= 0.07
    force = np.where(falls, trace.force * 0.3, trace.force)
    found = faults(score(changed(trace, force=force), target_length=TARGET), "lurch")
    assert any(position == pytest.approx(0.07, abs=0.5e-3) for position, _ in found)
    assert not faults(score(trace, target_length=TARGET), "lurch")


def test_ends_are_told_with_their_distance() -> None:
    trace, truth = jumped(0.0, 0.03)
    end = float(truth.tip[-1])
    for target, kind, says in (
        (end - 0.005, "overshoot", "cut 5 mm too far"),
        (end + 0.007, "short", "ended 7 mm short of the target"),
    ):
        card = score(trace, target_length=target, truth=truth)  # type: ignore[arg-type]
        assert [said for _, said in faults(card, kind)] == [says]
    card = score(trace, target_length=end, truth=truth)  # type: ignore[arg-type]
    assert not faults(card, "overshoot") + faults(card, "short")


def test_a_leaning_blade_and_too_much_force_are_told() -> None:
    assert [says for _, says in faults(score(cut("slicing, and back")), "wedge")] == [
        "ended with the blade at 45 degrees: a wedge of tissue stays uncut"
    ]
    hard = changed(cut(UPRIGHT), force=5.0 * cut(UPRIGHT).force)
    ((position, says),) = faults(score(hard), "force")
    per_depth = hard.force / np.maximum(hard.depth, 0.5e-3)  # type: ignore[arg-type]
    assert position == pytest.approx(hard.position[np.argmax(per_depth)])  # type: ignore[index]
    worst = int(np.argmax(per_depth))
    assert says.startswith(f"pressed with {hard.force[worst]:.1f} N at {100 * position:.1f} cm, after ")
    assert says.endswith(f"allows {1000 * hard.depth[worst]:.1f} N")  # type: ignore[index]
    assert not faults(score(cut(UPRIGHT)), "force") + faults(score(cut(UPRIGHT)), "wedge")


def test_a_pause_is_told_where_it_was() -> None:
    trace = cut("upright, one way")
    at = int(np.argmax(trace.position >= 0.04))  # type: ignore[operator]
    still = np.repeat(np.arange(len(trace)), np.where(np.arange(len(trace)) == at, 1201, 1))
    columns = {name: getattr(trace, name)[still] for name in trace.known if name != "speed"}
    columns["time"] = np.arange(len(still)) * 1e-3
    columns["force"] = columns["force"] + np.random.default_rng(1).normal(0.0, 0.02, len(still))
    paused = type(trace)(**columns)
    ((position, says),) = faults(score(paused), "pause")
    assert position == pytest.approx(0.04, abs=1e-3)
    assert says.startswith("rested for 1.2 s at 4.0 cm, after ")


@pytest.mark.parametrize(
    ("end", "kind", "says"),
    [
        ("deadline", "short", "stopped when the time was up, at 8.0 cm, after 7.3 s: 7 mm before the target"),
        ("given up", "short", "given up, at 8.0 cm, after 7.3 s: 7 mm before the target"),
        ("force_limit", "force", "stopped for too much force, at 8.0 cm, after 7.3 s: 7 mm before the target"),
        (
            "layer",
            "layer",
            "stopped because the layer below was opened, at 8.0 cm, after 7.3 s: 7 mm before the target",
        ),
    ],
)
def test_a_stop_is_told_once_with_its_place_and_time(end: str, kind: str, says: str) -> None:
    trace, truth = jumped(0.0, 0.03)
    stopped = trace.with_metadata({"end": end})  # type: ignore[attr-defined]
    card = score(stopped, target_length=float(truth.tip[-1]) + 0.007, truth=truth)
    assert [said for _, said in faults(card, kind)] == [says]


BEST = {"limits": 5.0, "way": 25.0, "accuracy": 10.0, "success": 10.0, "control": 25.0, "tissue": 20.0, "time": 5.0}


@pytest.fixture(scope="module")
def card() -> ScoreCard:
    """Any card, to be filled."""
    return score(sawing(0.3, np.random.default_rng(1)))


def filled(card: ScoreCard, faults: dict[str, str], **points: float) -> ScoreCard:
    """The card of a cut with these points, the best of all others, and faults with their advice."""
    parts = tuple(
        ScorePoints(part=part, points=points.get(part, best), most=best, reason="made up")
        for part, best in BEST.items()
    )
    found = tuple(
        TechniqueFault(kind=kind, time=1.0, position=None, says=f"{kind} seen", try_next=advice)
        for kind, advice in faults.items()
    )
    total = sum(each.points for each in parts)
    outcome = "success, 1.0 mm short of the target" if not faults else "5.0 mm short of the target"
    return dataclasses.replace(card, points=parts, overall_score=total, no_score="", outcome=outcome, faults=found)


def test_the_costliest_part_comes_first_with_the_advice_of_its_fault(card: ScoreCard) -> None:
    missed = filled(card, {"short": "lead on", "lurch": "lean"}, accuracy=0.0, success=0.0, tissue=12.0)
    tries = next_tries([filled(card, {}), missed, missed, filled(card, {"lurch": "lean"}, tissue=12.0)])
    assert [(each.part, each.advice, each.cuts) for each in tries] == [("target", "lead on", 2), ("tissue", "lean", 3)]
    assert (tries[0].points, tries[0].most) == (pytest.approx(50.0 - 40.0 / 3.0), 50.0)
    assert tries[1].seen == "lurch seen"


def test_only_the_last_cuts_count_and_a_good_one_needs_no_advice(card: ScoreCard) -> None:
    bad = filled(card, {"short": "lead on"}, success=0.0)
    assert next_tries([bad, *[filled(card, {})] * 3]) == ()
    assert next_tries([]) == ()


def test_a_loss_without_a_fault_has_its_own_advice(card: ScoreCard) -> None:
    (one,) = next_tries([filled(card, {}, control=2.0)])
    assert (one.part, one.seen, one.cuts) == ("control", "", 0)
    assert one.advice


def test_a_cut_beyond_a_limit_is_counted_as_one(card: ScoreCard) -> None:
    beyond = dataclasses.replace(
        filled(card, {"force": "slow down"}),
        points=(
            ScorePoints(part="limits", points=0.0, most=5.0, reason="too much force"),
            ScorePoints(part="way", points=3.0, most=25.0, reason="too much force"),
        ),
        outcome="the force exceeded the limit",
    )
    cards = [filled(card, {}), beyond]
    assert mean_points(cards)["tissue"] == (10.0, 20.0)
    assert next_tries(cards)[0].advice == "slow down"
    assert outcome_counts(cards) == {"success": 1, "missed": 0, "beyond a limit": 1}
    assert outcome_counts([card]) == {}
