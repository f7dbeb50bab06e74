"""The comparison of agents: what is on disk is not done again, and the table says what the cuts say."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from program import run

pytest.importorskip("sb3_contrib", reason="the learners are an extra: pip install 'cutenv[rl]'")
pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from benchmark import runs as program
from benchmark.aggregate import Line, disagreements, read_summary, rows_of, verdict
from benchmark.intervals import Interval
from benchmark.protocol import BEST_FEED, ENTRIES, SCRIPTED, Protocol, keep_protocol, kept_protocol, slug
from benchmark.robustness import settings
from benchmark.runs import Benchmark, Part, differs
from benchmark.table import markdown, origin_of, publish, read_table, write_leaderboard, write_tables

from cutenv._base.parameter import parameter_table
from cutenv.learning.arguments import PPOArguments
from cutenv.learning.evaluation import workers
from cutenv.learning.seeds import ENVIRONMENT, TEST_SEEDS, TRAINING_SEEDS, VALIDATION_SEEDS
from cutenv.policy import Features, Network, save_policy
from cutenv.tissue.description import TissueDescription

TINY = Protocol(
    version="tiny", classes=("mixed", "liver"), training_seeds=(0, 1), training_minutes=0.02, demonstrations=300,
    specimens=4, feed_specimens=2, sweep_specimens=2, resamples=50,
)  # fmt: skip
NAMES = ("PPO", "PPO without force", "probe and creep", "nothing")


def pretend_trained(folder: Path, name: str, seed: int) -> None:
    """A run as training leaves it, of a network that goes on and knows nothing."""
    features = {"history": 0} | ({"force": False} if "without force" in name else {})
    rng = np.random.default_rng(seed)
    weights = rng.normal(scale=0.05, size=(2, Features(**features).size)).astype(np.float32)
    where = folder / "runs" / f"{slug(name)}-seed{seed}"
    save_policy(
        where / "policy",
        Network(((weights, np.array([0.8, 1.0], np.float32)),)),
        environment=ENVIRONMENT,
        environment_arguments={"control_hz": 10},
        features=features,
        training={"decisions": 1000},
    )
    (where / "learning_curve.csv").write_text("decisions,seconds\n1000,1.0\n2000,2.0\n")
    facts = {"training_minutes": 0.1, "commit": "0" * 40, "versions": {"numpy": np.__version__}}
    facts |= {"agent": "PPO", "arguments": {"demonstrations": 500}}
    (where / "run.json").write_text(json.dumps(facts))


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("benchmark")
    keep_protocol(folder, TINY)
    for name in NAMES[:2]:
        for seed in TINY.training_seeds:
            pretend_trained(folder, name, seed)
    whole = Benchmark(folder, TINY, NAMES, processes=1)
    with pytest.MonkeyPatch.context() as patch:
        few = list(settings())
        patch.setattr(program, "settings", lambda: [few[0], few[-1]])  # one of the drive, one of the tissue
        with workers(1) as pool:
            whole.cut(pool)
            whole.sweep(pool)
        assert whole.uncut() == []
        assert whole.unswept() == []
    write_tables(folder, TINY)
    return folder


def test_what_is_done_is_not_left_and_what_is_lost_is_done_again_to_the_last_digit(compared):
    whole = Benchmark(compared, TINY, NAMES, processes=1)
    lost = whole.cuts_of(Part("PPO", 1), "liver")
    before = lost.read_bytes()
    lost.unlink()
    assert whole.uncut() == [(Part("PPO", 1), "liver")]
    with workers(1) as pool:
        whole.cut(pool)
    assert lost.read_bytes() == before


def test_the_table_is_written_again_from_the_cuts_alone(compared):
    names = ("summary.csv", "sweeps.csv", "leaderboard.md")  # a page's drawings carry numbers of their own
    before = {name: (compared / name).read_bytes() for name in names}
    for name in names:
        (compared / name).unlink()
    write_tables(compared, kept_protocol(compared))
    assert {name: (compared / name).read_bytes() for name in names} == before


def test_a_value_is_the_mean_of_the_middle_half_of_the_cuts(compared):
    values = sorted(
        float(row["return"]) for seed in (0, 1) for row in rows_of(compared / "cuts" / f"ppo-seed{seed}--mixed.csv")
    )
    line = read_table(compared).line("PPO", "mixed", "return")
    assert line is not None
    assert line.cuts == 8
    assert line.interval.value == pytest.approx(np.mean(values[2:6]))
    assert line.interval.low <= line.interval.value <= line.interval.high


def test_everyone_met_the_same_specimens_and_every_metric_of_the_score_card(compared):
    files = sorted((compared / "cuts").glob("*--mixed.csv"))
    assert len(files) == 6
    assert {tuple(row["seed"] for row in rows_of(path)) for path in files} == {tuple(map(str, TINY.test_seeds))}
    assert all("metric_peak_force_per_depth_N_per_m" in rows_of(path)[0] for path in files)


def test_a_loss_by_another_constant_is_read_off_the_first_row_of_the_same_specimens(compared):
    heading, (unchanged, *others) = read_table(compared).robustness()
    assert unchanged[:3] == ["as in training", "–", "–"]
    assert [row[0] for row in others] == ["motor_lag [s]", "eta90 [1]"]
    values = sorted(
        float(row["return"])
        for seed in (0, 1)
        for row in rows_of(compared / "cuts" / f"ppo-seed{seed}--mixed.csv")[: TINY.sweep_specimens]
    )
    assert TINY.sweep_specimens < TINY.specimens
    shown = unchanged[heading.index("PPO")]
    assert float(shown.split(" [")[0]) == pytest.approx(np.mean(values[1:3]), abs=6e-4)


def test_runs_of_a_checkout_with_changes_and_commits_that_others_went_on_at_are_marked(tmp_path):
    keep_protocol(tmp_path, TINY)
    for seed in TINY.training_seeds:
        pretend_trained(tmp_path, "PPO", seed)
    assert origin_of(tmp_path)["commits"] == ["0" * 40]
    for seed, more in ((0, {"uncommitted_changes": True}), (1, {"resumed_at_commits": ["1" * 40]})):
        path = tmp_path / "runs" / f"ppo-seed{seed}" / "run.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | more))
    assert origin_of(tmp_path)["commits"] == ["0" * 40, "0" * 40 + "+changes", "1" * 40]


def test_an_agent_that_loses_is_said_to_lose(compared):
    text = markdown(compared)
    assert "PPO against probe and creep: does not beat it: " in text  # worse, or level: four specimens
    assert "No agent beats the best script" in (compared / "leaderboard.html").read_text()
    assert "| the force is not felt | PPO without force |" in text
    assert "| eta90 [1] | 0.34 | 0.45 |" in text


@pytest.mark.parametrize(
    ("low", "high", "said"), [(0.01, 0.1, "beats it"), (-0.1, 0.1, "level"), (-0.2, -0.1, "worse"), (0.0, 0.1, "level")]
)
def test_the_interval_of_the_difference_decides(low, high, said):
    assert said in verdict(Interval((low + high) / 2.0, low, high))


def test_the_page_fetches_nothing(compared):
    text = (compared / "leaderboard.html").read_text()
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert "https://" not in text


def test_what_is_published_prints_the_same_table_and_page(compared, tmp_path):
    kept, page = tmp_path / "published", tmp_path / "page.html"
    kept.mkdir()
    (kept / "summary.csv").write_text("of an earlier comparison")
    publish(compared, kept)
    assert markdown(kept) == markdown(compared)
    assert sorted(path.name for path in kept.iterdir()) == [
        "origin.json", "protocol.json", "summary.csv", "sweeps.csv",
    ]  # fmt: skip
    write_leaderboard(page, kept)
    for text in (page.read_text(), (compared / "leaderboard.html").read_text()):
        assert "0" * 40 in text
        assert f"<dd>{np.__version__}</dd>" in text


def test_two_tables_agree_where_their_intervals_meet_and_only_there(compared, tmp_path, capsys):
    lines = read_summary(compared / "summary.csv")
    apart, count = disagreements(lines, lines)
    assert apart == []
    moved = [
        Line(one.contestant, one.specimen_class, one.score, one.statistic, Interval(9.0, 8.0, 10.0), one.cuts)
        if (one.contestant, one.score, one.specimen_class) == ("PPO", "success", "mixed")
        else one
        for one in lines
    ]
    apart, _ = disagreements(lines, moved)
    assert ["PPO, mixed, success, mean" in text for text in apart] == [True]
    apart, fewer = disagreements(lines, [one for one in moved if one.contestant != "PPO"])
    assert apart == []
    assert 0 < fewer < count
    publish(compared, tmp_path / "published")
    assert differs(tmp_path / "published" / "summary.csv", compared) == 0
    assert f"0 of {count} numbers" in capsys.readouterr().out
    keep_protocol(tmp_path / "other", Protocol())
    with pytest.raises(SystemExit, match="are two protocols; compare results of one protocol"):
        differs(tmp_path / "published" / "summary.csv", tmp_path / "other")


def test_the_cost_of_training_counts_all_that_was_tried_and_shown(compared):
    table = read_table(compared)
    decisions = table.line("PPO", "", "training_decisions", "mean")
    assert decisions is not None
    assert decisions.interval == Interval(2500.0, 2500.0, 2500.0)  # of which the policy that was kept saw 1000


def test_a_part_of_the_comparison_has_a_table_too(compared, tmp_path):
    (tmp_path / "cuts").mkdir()
    for path in (compared / "cuts").glob("nothing--*.csv"):
        (tmp_path / "cuts" / path.name).write_bytes(path.read_bytes())
    keep_protocol(tmp_path, TINY)
    write_tables(tmp_path, TINY)
    table = read_table(tmp_path)
    assert table.contestants == ["nothing"]
    assert table.verdicts() == []
    assert "No agent has been trained" in (tmp_path / "leaderboard.html").read_text()


def test_results_of_another_protocol_are_not_mixed_in(compared):
    with pytest.raises(SystemExit, match="another protocol"):
        keep_protocol(compared, Protocol())
    assert kept_protocol(compared) == TINY


def test_specimens_that_are_not_the_protocols_are_refused(compared, tmp_path):
    (tmp_path / "cuts").mkdir()
    for path in (compared / "cuts").iterdir():
        (tmp_path / "cuts" / path.name).write_text(path.read_text().replace(f",{TINY.test_seeds[1]},", ",5,"))
    with pytest.raises(SystemExit, match="cut other specimens of"):
        write_tables(tmp_path, TINY)


def test_an_interrupted_training_goes_on_and_one_without_checkpoint_begins_anew(tmp_path):
    benchmark = Benchmark(tmp_path, TINY, ("behaviour cloning",), processes=1)
    assert [part.slug for part in benchmark.untrained()] == ["behaviour-cloning-seed0", "behaviour-cloning-seed1"]
    torn = tmp_path / "runs" / "behaviour-cloning-seed0"
    torn.mkdir(parents=True)
    (torn / "run.json").write_text("{}")  # as left by a kill while the first checkpoint was written
    (torn / "checkpoint.1a2b3c4d.part.safetensors").write_bytes(b"half of it")
    benchmark.train()
    assert benchmark.untrained() == []
    facts = json.loads((torn / "run.json").read_text())
    assert facts["arguments"]["demonstrations"] == TINY.demonstrations
    del facts["training_minutes"]  # as left by an interruption after one
    (torn / "run.json").write_text(json.dumps(facts))
    assert [part.slug for part in benchmark.untrained()] == ["behaviour-cloning-seed0"]
    benchmark.train()
    assert benchmark.untrained() == []
    assert "resuming after" in (tmp_path / "runs" / "behaviour-cloning-seed0.log").read_text()


def test_a_training_that_fails_says_where_to_look(tmp_path, monkeypatch):
    benchmark = Benchmark(tmp_path, TINY, ("behaviour cloning",), processes=1)
    monkeypatch.setattr(Benchmark, "training_arguments", lambda *_: ["--no-such-option"])
    with pytest.raises(SystemExit, match=r"see .*behaviour-cloning-seed0\.log"):
        benchmark.train()


def test_the_whole_comparison_is_planned_within_two_hours_on_two_cores(tmp_path, capsys):
    assert Benchmark(tmp_path, Protocol(), (), processes=2).plan() < 7200.0
    assert "together" in capsys.readouterr().out


def test_everything_that_is_asked_for_takes_part():
    assert Protocol().specimens == 1000
    assert len(Protocol().training_seeds) == 3
    assert {"PPO", "recurrent PPO", "behaviour cloning"} <= ENTRIES.keys()
    assert {BEST_FEED, "probe and creep", "planner (nominal)", "planner with truth"} <= set(SCRIPTED)
    assert {entry.change for entry in ENTRIES.values()} - {""} == {
        "the blade stays upright", "the force is not felt", "the critic does not see the truth",
        "the six past decisions are seen besides",
    }  # fmt: skip


def test_seeds_of_training_runs_validation_and_test_are_disjoint():
    of_runs = [set(PPOArguments(seed=seed).training_seeds) for seed in Protocol().training_seeds]
    assert len(set.union(*of_runs)) == sum(map(len, of_runs))
    assert all(seeds <= set(TRAINING_SEEDS) for seeds in of_runs)
    assert max(TRAINING_SEEDS) < min(VALIDATION_SEEDS)
    assert set(Protocol().test_seeds) <= set(TEST_SEEDS)
    assert not set(Protocol().test_seeds) & set(TEST_SEEDS[: PPOArguments().specimens])  # those that every run prints
    assert len(Protocol().test_seeds) == Protocol().specimens


def test_every_constant_of_the_parameter_table_that_has_a_range_is_swept(tmp_path):
    swept = {setting.constant for setting in settings()}
    assert {"motor_lag", "acceleration", "force_noise", "force_delay", "force_limit_per_depth"} <= swept
    assert {row["name"] for row in parameter_table(TissueDescription) if row["sensitivity"]} <= swept
    for setting in settings():
        env = gymnasium.make(ENVIRONMENT, **setting.arguments(tmp_path))
        env.reset(seed=1)
        if setting.of_tissue:
            tissue = TissueDescription.from_json((tmp_path / f"{setting.name}.json").read_text())
            assert getattr(tissue, setting.constant) == setting.value
        assert setting.value != setting.default


def test_who_takes_no_part_is_refused_with_those_who_do(tmp_path):
    done = run("scripts/benchmark_agents.py", tmp_path, "--only", "PPPO")
    assert done.returncode == 2
    assert "'PPPO' takes no part" in done.stderr
    assert "recurrent PPO" in done.stderr
