"""The page of a training run says what the numbers say, shows data as text, and fetches nothing."""

from __future__ import annotations

import itertools
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from reading import Page

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

import made_up_result as made_up
from made_up_result import AGENT, BOUND, OTHER, SCRIPT, result

from cutenv.display.report import training_page, write_training_page
from cutenv.display.report.training_page import training_headline
from cutenv.display.report.training_result import COLUMNS, DIFFERENCES, TrainingResult


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page of the made-up result."""
    path = tmp_path_factory.mktemp("run") / "report.html"
    write_training_page(path, result())
    return path.read_text(encoding="utf-8")


def printed(row: Mapping[str, Any], factor: float, digits: int, share: bool) -> str:
    """A mean with its interval, written independently of the page."""
    low, mean, high = (factor * row[name] for name in ("low_95", "mean", "high_95"))
    if share:
        low, high = max(low, 0.0), min(high, 100.0)
    text = f"{mean:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"
    return re.sub(r"-(?=0(\.0+)?(?![\d.]))", "", text).replace("-", "\u2212")


def test_every_policy_stands_in_the_comparison_with_its_scores_the_best_first(document: str) -> None:
    rows, shown = Page(document).rows, result()
    names = [row[0] for row in rows[1 : 1 + len(shown.policies)]]

    def best(name: str) -> float:
        policy = next(policy for policy in shown.policies if name.startswith(policy))
        return -float(shown.score(policy, "return")["mean"])

    assert [name.split("  ")[0] for name in names] == sorted(names, key=best)
    for policy in shown.policies:
        row = next(row for row in rows[1:] if row[0].startswith(policy))
        expected = [
            printed(shown.score(policy, column.name), column.factor, column.digits, column.unit == "%")
            for column in COLUMNS
        ]
        assert row[1:] == expected, policy


def test_agent_best_script_and_bound_are_marked(document: str) -> None:
    names = [row[0] for row in Page(document).rows]
    assert f"{AGENT} learned" in names
    assert f"{SCRIPT} best script" in names
    assert f"{BOUND} upper bound: sees hidden state" in names
    assert OTHER in names


def test_paired_differences_stand_in_their_table_with_what_they_decide(document: str) -> None:
    rows = Page(document).rows
    start = next(k for k, row in enumerate(rows) if row[0] == "baseline")
    found = {row[0].partition(" best script")[0].partition(" upper bound")[0]: row[1:] for row in rows[start + 1 :]}
    shown = result()
    for baseline, decision in ((SCRIPT, "better"), (OTHER, "better"), (BOUND, "worse")):
        cells = []
        for column in DIFFERENCES:
            row = shown.difference(baseline, column.name)
            assert row is not None
            cells.append(printed(row, column.factor, column.digits, share=False))
        assert found[baseline] == [*cells, decision]


def test_terms_of_the_reward_stand_as_numbers_too(document: str) -> None:
    rows = Page(document).rows
    found = {row[0]: row[1:] for row in rows if len(row) == 4}
    shown = result()
    names = {"progress": "progress", "accuracy": "accuracy", "stored": "left loaded", "wedge": "wedge left"}
    for term, name in names.items():
        expected = [printed(shown.score(policy, f"reward_{term}"), 1.0, 3, share=False) for policy in shown.compared()]
        assert found[name] == expected
    assert "No cost was incurred for: wedge left" in document


def test_every_cell_of_the_grid_is_shown_and_one_is_the_best(document: str) -> None:
    rows = [row for row in Page(document).rows if len(row) == 5]
    assert rows[0] == ["speed [cm/s]", "45\u00b0", "60\u00b0", "75\u00b0", "90\u00b0"]
    cells = {(row[0], angle): cell for row in rows[1:] for angle, cell in zip(made_up.ANGLES, row[1:], strict=True)}
    assert len(cells) == 28
    for row in made_up.grid():
        best = " best" if row["mean"] == max(other["mean"] for other in made_up.grid()) else ""
        mean = f"{row['mean']:.2f}".replace("-", "\u2212")
        assert cells[f"{row['speed_cm_s']:g}", row["angle_deg"]] == f"{mean} \u00b10.07 50 %{best}"
    assert [place for place, cell in cells.items() if "best" in cell] == [("0.64", 60.0)]


def test_sections_come_in_the_order_of_reading_and_headings_skip_no_level(document: str) -> None:
    headings = Page(document).headings
    assert [text for level, text in headings if level == 2] == [
        "Agent and scripts",
        "Agent minus each baseline",
        "Where the reward goes",
        "Constant feed at every speed and angle",
        "A cut above its force trace",
        "Learning curve",
        "What the numbers mean",
        "Facts of the run",
    ]
    levels = [level for level, _ in headings]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(later <= earlier + 1 for earlier, later in itertools.pairwise(levels))
    assert document.index("PPO beats") < document.index("<h2")


def test_every_picture_says_what_it_shows(document: str) -> None:
    pictures = [attributes for name, attributes in Page(document).elements if name == "img"]
    assert len(pictures) == 5
    assert all(len(picture["alt"]) > 40 for picture in pictures)
    assert f"{AGENT} 0.64 [" in pictures[0]["alt"]
    assert "the crack tip ends 1.0 mm beyond the target of 78 mm" in pictures[2]["alt"]
    assert "The checkpoint after 122,880 decisions was kept." in pictures[4]["alt"]


def test_facts_captions_and_limits_are_on_the_page(document: str) -> None:
    text = Page(document).text
    for fact in (*result().facts, *result().facts.values(), *(cut.caption for cut in result().cuts)):
        assert fact in text
    assert "Nothing here has been validated for assessing or credentialing people" in " ".join(text.split())


@pytest.mark.parametrize(
    ("mean", "half", "kind", "claim", "numbers"),
    [
        (0.13, 0.05, "good", "PPO beats the best script", "higher by 0.13 (95 % interval 0.08 to 0.18)"),
        (-0.13, 0.05, "bad", "PPO does not beat the best script", "lower by 0.13 (95 % interval 0.08 to 0.18)"),
        (0.02, 0.05, "open", "Whether PPO beats the best script", "differs by 0.02 (95 % interval \u22120.03 to 0.07)"),
        (0.05, 0.05, "open", "Whether PPO beats the best script", "differs by 0.05 (95 % interval 0.00 to 0.10)"),
        (0.0104, 0.01, "good", "PPO beats the best script", "higher by 0.0104 (95 % interval 0.0004 to 0.0204)"),
        (0.0, 0.0, "open", "Whether PPO beats the best script", "differs by 0.00 (95 % interval 0.00 to 0.00)"),
    ],
    ids=["beats", "loses", "undecided", "touches 0", "just beats", "the same"],
)
def test_the_headline_is_what_the_paired_difference_says(
    mean: float, half: float, kind: str, claim: str, numbers: str
) -> None:
    found, _, sentences = training_headline(result(differences=made_up.differences(mean, half)))
    sentences = sentences.replace("\u00a0", " ")
    assert found == kind
    assert sentences.startswith(f"{claim} ({SCRIPT})")
    assert numbers in sentences
    assert "Over 100 held-out specimens of class liver" in sentences
    assert "it succeeds 17.0 points more often (95 % interval 8.0 to 26.0)" in sentences
    assert f"On 100 of them the upper bound ({BOUND}) gets 0.83, 0.19 more than the agent." in sentences


@pytest.mark.parametrize(
    ("mean", "against"),
    [(-0.13, "does not beat its teacher"), (0.02, "is level with its teacher")],
    ids=["behind its teacher", "level with it"],
)
def test_an_agent_may_beat_every_script_but_its_teacher(mean: float, against: str) -> None:
    compared = made_up.differences(mean, 0.05)
    kind, word, sentences = training_headline(result(differences=compared, rival_script=OTHER))
    sentences = sentences.replace("\u00a0", " ")
    assert (kind, word) == ("good", "Better than every script but its teacher")
    assert sentences.startswith(f"PPO beats {OTHER}, the best script that did not teach it. Over 100 held-out")
    assert f"It {against} ({SCRIPT}): there, its return" in sentences
    assert sentences.index(f"higher by {made_up.RETURNS[AGENT] - made_up.RETURNS[OTHER]:.2f}") < sentences.index(
        against
    )


def test_an_agent_that_beats_its_teacher_is_told_so_first_and_one_that_beats_none_is_not_praised() -> None:
    wins = training_headline(result(rival_script=OTHER))
    assert wins == training_headline(result())
    worse = [row | {"mean": -0.3, "low_95": -0.4, "high_95": -0.2} for row in made_up.differences(-0.13)]
    assert training_headline(result(differences=worse, rival_script=OTHER))[0] == "bad"


def test_it_says_how_much_less_often_the_agent_succeeds() -> None:
    changed = [
        row | {"mean": -0.17, "low_95": -0.26, "high_95": -0.08} if row["score"] == "success" else row
        for row in made_up.differences()
    ]
    sentences = training_headline(result(differences=changed))[2].replace("\u00a0", " ")
    assert "it succeeds 17.0 points less often (95 % interval 8.0 to 26.0)" in sentences


def test_without_a_bound_nothing_is_said_of_it() -> None:
    assert "bound" not in training_headline(result(bound=None))[2]


def test_an_agent_above_the_bound_has_nothing_left() -> None:
    changed = made_up.summary()
    for row in changed:
        if (row["policy"], row["score"]) == (BOUND, "return"):
            row.update(made_up.row(0.6, 0.01))
    above = {"mean": 0.04, "low_95": 0.03, "high_95": 0.05}
    paired = [row | (above if row["baseline"] == BOUND else {}) for row in made_up.differences()]
    sentences = training_headline(result(summary=changed, differences=paired))[2]
    assert f"Nothing is left to the upper bound ({BOUND}), which gets 0.60" in sentences


def test_a_script_above_the_best_one_is_not_hidden(tmp_path: Path) -> None:
    assert "got more than" not in written(tmp_path, result())
    other = result(best_script=OTHER, differences=[made_up.row(0.4, 0.1, policy=AGENT, baseline=OTHER, score="return")])
    assert f"{SCRIPT} got more than {OTHER}" in written(tmp_path, other)


def written(folder: Path, shown: TrainingResult) -> str:
    """The page of a result."""
    write_training_page(folder / "report.html", shown)
    return (folder / "report.html").read_text(encoding="utf-8")


ODD = '<script>alert("1")</script> & $\\frac$ \u00e9'


def renamed(name: str) -> TrainingResult:
    """The made-up result with every text of it replaced or followed by a name."""

    def rename(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return [row | {key: name for key in ("policy", "baseline") if row.get(key) == OTHER} for row in rows]

    return result(
        title=name,
        subtitle=name,
        facts={"specimen class": name, name: name},
        summary=rename(made_up.summary()),
        differences=rename(made_up.differences()),
        bound=name,
        cuts=[made_up.cut(name, caption=name)],
    )


def test_text_from_data_is_shown_and_never_run(tmp_path: Path) -> None:
    page = Page(written(tmp_path, renamed(ODD)))
    for name, attributes in page.elements:
        assert name not in ("script", "link", "iframe", "object", "embed", "base", "form")
        assert not any(attribute.startswith("on") for attribute in attributes)
    assert page.text.count(ODD) >= 8
    assert any(ODD in attributes.get("alt", "") for _, attributes in page.elements)


def test_the_page_fetches_nothing(document: str) -> None:
    page = Page(document)
    assert page.addresses()
    for address in page.addresses():
        assert address.startswith(("#", "data:image/svg+xml;base64,")), address[:80]
    assert not re.findall(r"https?://|@import|url\(", document)
    policies = [part["content"] for name, part in page.elements if part.get("http-equiv") == "Content-Security-Policy"]
    assert policies == ["default-src 'none'; img-src data:; style-src 'unsafe-inline'"]
    keys = {attributes["id"] for _, attributes in page.elements if "id" in attributes}
    assert {address[1:] for address in page.addresses() if address.startswith("#")} <= keys


def test_long_sawing_cuts_stay_below_3_MB(tmp_path: Path) -> None:
    sawing = made_up.readings(seconds=30.0, sawing_hz=3.0)
    cuts = [made_up.cut(policy, readings=sawing) for policy in (AGENT, SCRIPT)]
    assert len(written(tmp_path, result(cuts=cuts)).encode()) < 3e6


def test_what_was_not_recorded_is_said(tmp_path: Path) -> None:
    page = " ".join(Page(written(tmp_path, result(cuts=[], curve=[], chosen_at=None, bound=None))).text.split())
    assert "No cut was kept to be drawn." in page
    assert "No learning curve was recorded." in page


def without(rows: list[dict[str, Any]], **words: Any) -> list[dict[str, Any]]:
    """Rows less those that have all of the words."""
    return [row for row in rows if not words.items() <= row.items()]


def changed(rows: list[dict[str, Any]], place: int, **values: Any) -> list[dict[str, Any]]:
    """Rows, one of them with other values."""
    return [*rows[:place], rows[place] | values, *rows[place + 1 :]]


NAN = float("nan")
SUMMARY, DIFFERENCE, GRID, CURVE = made_up.summary(), made_up.differences(), made_up.grid(), made_up.curve()


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"agent": "DQN"}, r"agent must be one of .*'PPO'.*, got 'DQN'"),
        ({"summary": without(SUMMARY, policy=AGENT)}, r"agent must be one of .*, got 'PPO'"),
        ({"best_script": "fast"}, "best_script must be one of"),
        ({"bound": "planer that knows the truth"}, "Did you mean 'planner that knows the truth'"),
        ({"bound": AGENT}, "agent, best_script and bound must differ"),
        ({"summary": []}, "summary is empty"),
        ({"summary": changed(SUMMARY, 2, mean=NAN)}, r"mean of summary\[2\] \(.*tip_error_mm\) = nan is outside"),
        ({"summary": changed(SUMMARY, 2, high_95=NAN)}, "needs two specimens or more"),
        ({"summary": changed(SUMMARY, 2, low_95=9.0)}, r"summary\[2\].* outside of its interval 9 to"),
        ({"summary": changed(SUMMARY, 1, mean=31.0, high_95=40.0)}, "not a percentage"),
        ({"summary": changed(SUMMARY, 2, cuts=30)}, "count 30, 100 cuts"),
        ({"summary": [*SUMMARY, SUMMARY[0]]}, "comes twice"),
        ({"summary": without(SUMMARY, policy=OTHER, score="time_s")}, "no score 'time_s' for policy 'constant"),
        (
            {"summary": without(SUMMARY, policy=BOUND, score="reward_jump")},
            "no score 'reward_jump' for policy 'planner",
        ),
        ({"differences": without(DIFFERENCE, baseline=OTHER), "rival_script": OTHER}, f"{OTHER!r}, the rival_script"),
        ({"differences": without(DIFFERENCE, baseline=SCRIPT)}, "no row of score 'return' with baseline 'fast-then-sl"),
        ({"differences": changed(DIFFERENCE, 0, policy=BOUND)}, r"differences\[0\].policy must be one of 'PPO'"),
        ({"differences": changed(DIFFERENCE, 1, score="time_s")}, r"differences\[1\].score must be one of 'return'"),
        ({"differences": changed(DIFFERENCE, 0, mean=NAN)}, r"mean of differences\[0\]"),
        ({"grid": GRID[1:]}, "grid has 0 rows for 0.1 cm/s at 45 degrees"),
        ({"grid": [*GRID, GRID[0]]}, "grid has 2 rows for 0.1 cm/s at 45 degrees"),
        ({"grid": changed(GRID, 4, success=50.0)}, r"success of grid\[4\] = 50 is outside 0 to 1"),
        ({"grid": changed(GRID, 4, mean=NAN)}, r"mean of grid\[4\]"),
        ({"grid": [{"speed_cm_s": 1.0}]}, r"grid\[0\] lacks 'angle_deg'"),
        ({"curve": changed(CURVE, 4, success=NAN)}, r"success of curve\[4\] = nan"),
        ({"chosen_at": NAN}, "chosen_at = nan"),
        ({"facts": {"seed": "0"}}, "facts must hold 'specimen class'"),
        ({"cuts": [made_up.cut("DQN")]}, r"cuts\[0\].policy must be one of"),
    ],
)
def test_a_bad_result_is_refused_by_name(bad: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        result(**bad)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"readings": made_up.readings()[:0]}, "readings of 'PPO' are empty"),
        ({"readings": made_up.readings()[["force", "tip"]]}, "lack the field 'time'"),
        ({"depth": made_up.cut(AGENT).depth * NAN}, "depth of 'PPO' = nan m"),
        ({"depth": made_up.cut(AGENT).depth[:0]}, r"depth of 'PPO' must have shape \(n,\)"),
        ({"target_length": 78.0}, "target_length of 'PPO' = 78 m is outside 0 to 1 m"),
        ({"force_limit_per_depth": NAN}, "force_limit_per_depth of 'PPO' = nan N/m"),
    ],
)
def test_a_bad_cut_is_refused_by_name(bad: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        made_up.cut(AGENT, **bad)


def test_a_failure_leaves_the_older_page_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    older = written(tmp_path, result(cuts=[]))

    def curve_figure(*_: Any, **__: Any) -> None:
        raise OSError("no space left")

    for owner, name in ((training_page, "curve_figure"), (Path, "replace")):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, curve_figure)
            with pytest.raises(OSError, match="no space left"):
                write_training_page(tmp_path / "report.html", result(title="newer", cuts=[]))
        assert (tmp_path / "report.html").read_text(encoding="utf-8") == older
    assert "newer" in written(tmp_path, result(title="newer", cuts=[]))
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]


def test_a_missing_matplotlib_is_named_with_the_cure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=re.escape("pip install 'cutenv[view]'")):
        write_training_page(tmp_path / "report.html", result())
    assert list(tmp_path.iterdir()) == []


def test_importing_the_report_loads_no_matplotlib() -> None:
    code = "import sys, cutenv.display.report; print('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "False\n"


def test_no_interval_of_a_share_reaches_beyond_a_hundred() -> None:
    low, high = ({"mean": sign * 0.83, "low_95": sign * 0.83 - 0.33, "high_95": sign * 0.83 + 0.33} for sign in (-1, 1))
    share, points = COLUMNS[1], DIFFERENCES[1]
    assert share.cell(high) == "83 [50, 100]"
    assert points.cell(high) == "83 [50, 100]"
    assert points.cell(low) == "\u221283 [\u2212100, \u221250]"
