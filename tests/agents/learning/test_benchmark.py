"""The comparison of agents: what is on disk is not done again, and the table says what the cuts say."""

from __future__ import annotations

import dataclasses
import json
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import TextIO

import gymnasium
import numpy as np
import pytest
from program import run

pytest.importorskip("sb3_contrib", reason="the learners are an extra: pip install 'cutenv[rl]'")
pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from cutenv._base.validation import parameter_table
from cutenv.agents.learning import benchmark
from cutenv.agents.learning.arguments import PPOArguments
from cutenv.agents.learning.benchmark import (
    QUICK,
    Protocol,
    Submission,
    entry_digest,
    entry_files,
    entry_seeds,
    submitted_run,
    write_submission,
)
from cutenv.agents.learning.evaluation import contestant, evaluate
from cutenv.agents.learning.seeds import ENVIRONMENT, TEST_SEEDS, TRAINING_SEEDS, VALIDATION_SEEDS
from cutenv.agents.learning.statistics import Interval
from cutenv.agents.policy import Features, Network, save_policy
from cutenv.commands.train import LEARNERS, training_options
from cutenv.sim.tissue.description import TissueDescription
from scripts.benchmarks.leaderboard import runs as program
from scripts.benchmarks.leaderboard.aggregate import Line, disagreements, read_summary, verdict
from scripts.benchmarks.leaderboard.kept_cuts import file_of, read_run, read_runs, write_run
from scripts.benchmarks.leaderboard.protocol import ENTRIES, keep_protocol, kept_protocol, slug
from scripts.benchmarks.leaderboard.robustness import settings
from scripts.benchmarks.leaderboard.runs import Benchmark, Part, differs
from scripts.benchmarks.leaderboard.table import (
    add_submission,
    markdown,
    publish,
    read_table,
    summarise_cuts,
    write_leaderboard,
    write_tables,
)

TINY = Protocol(
    version="tiny", classes=("mixed", "liver"), most_seeds=2, specimens=4, feed_specimens=2, sweep_specimens=2,
    resamples=50, training=("--demonstrations", "300", "--minutes", "0.02"),
)  # fmt: skip
NAMES = ("PPO", "PPO without force", "return stroke", "nothing")


def pretend_trained(runs: Path, name: str, seed: int, protocol: Protocol = TINY) -> Path:
    """A run as training leaves it, of a network that goes on and knows nothing."""
    features = {"history": 0} | ({"force": False} if "without force" in name else {})
    rng = np.random.default_rng(seed)
    weights = rng.normal(scale=0.05, size=(2, Features(**features).size)).astype(np.float32)
    where = runs / f"{slug(name)}-seed{seed}"
    save_policy(
        where / "policy",
        Network(((weights, np.array([0.8, 1.0], np.float32)),)),
        environment=ENVIRONMENT,
        environment_arguments={"control_hz": 10},
        features=features,
        training={"decisions": 2_000_000},
    )
    curve = "decisions,cuts,seconds,validation_return\n1000,90,1.0,0.1\n2000,900,2.0,0.3\n"
    (where / "learning_curve.csv").write_text(curve)
    entry = ENTRIES[name]
    own = ("--name", where.name, "--seed", str(seed), "--specimens", "0", *protocol.training, *entry.arguments)
    facts = {"training_minutes": 0.1, "commit": "0" * 40, "agent": LEARNERS[entry.learner][0]}
    facts["arguments"] = dataclasses.asdict(training_options(entry.learner, own))
    (where / "run.json").write_text(json.dumps(facts))
    return where


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("benchmark")
    keep_protocol(folder, TINY)
    for name in NAMES[:2]:
        for seed in range(2):
            pretend_trained(folder / "runs", name, seed)
    whole = Benchmark(folder, TINY, NAMES, processes=1)
    with pytest.MonkeyPatch.context() as patch:
        few = list(settings())
        patch.setattr(program, "settings", lambda: [few[0], few[-1]])  # one of the drive, one of the tissue
        with ThreadPoolExecutor(1) as pool:
            whole.cut(whole.uncut(), pool)
            whole.sweep(pool)
        assert whole.uncut() == []
        assert whole.unswept() == []
    write_tables(folder, TINY)
    return folder


def cut_only(compared: Path, folder: Path, *names: str) -> Path:
    """A comparison of which only some files of cuts are done."""
    keep_protocol(folder, TINY)
    (folder / "cuts").mkdir()
    for name in names:
        (folder / "cuts" / f"{name}.csv.gz").write_bytes((compared / "cuts" / f"{name}.csv.gz").read_bytes())
    return folder


def returns_of(compared: Path, name: str, seeds: tuple[int | None, ...] = (0, 1)) -> list[float]:
    rows = [read_run(file_of(compared, name, seed), TINY).by_class["mixed"] for seed in seeds]
    return [float(row["return"]) for own in rows for row in own]


def test_what_is_done_is_not_left_and_what_is_lost_is_done_again_to_the_last_digit(compared):
    whole = Benchmark(compared, TINY, NAMES, processes=1)
    lost = file_of(compared, "PPO", 1)
    before = read_run(lost, TINY)
    lost.unlink()
    assert whole.uncut() == [Part("PPO", 1)]
    with ThreadPoolExecutor(1) as pool:
        whole.cut(whole.uncut(), pool)
    assert read_run(lost, TINY) == before


def test_a_value_is_the_mean_of_the_middle_half_of_the_cuts(compared):
    values = sorted(returns_of(compared, "PPO"))
    line = read_table(compared).line("PPO", "mixed", "return")
    assert line is not None
    assert line.cuts == 8
    assert line.interval.value == pytest.approx(np.mean(values[2:6]))
    assert line.interval.low <= line.interval.value <= line.interval.high


def test_a_difference_is_that_of_means_on_the_same_specimens(compared):
    line = read_table(compared).difference("PPO", "return stroke")
    script = returns_of(compared, "return stroke", (None,))
    expected = np.mean(returns_of(compared, "PPO")) - np.mean(script)
    assert line is not None
    assert line.interval.value == pytest.approx(expected)


def test_cuts_of_other_specimens_and_damaged_files_are_refused(compared, tmp_path):
    keep_protocol(tmp_path, TINY)
    run = read_run(file_of(compared, "nothing", None), TINY)
    rows = {"mixed": [row | {"seed": "5"} for row in run.by_class["mixed"]]}
    write_run(tmp_path, run.facts, rows, "mixed")
    with pytest.raises(SystemExit, match="holds other specimens of class mixed"):
        read_runs(tmp_path, TINY)
    path = file_of(tmp_path, "nothing", None)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(SystemExit, match="is damaged"):
        read_runs(tmp_path, TINY)


def test_a_loss_by_another_constant_is_read_off_the_first_row_of_the_same_specimens(compared):
    heading, (unchanged, *others) = read_table(compared).robustness()
    assert unchanged[:3] == ["as in training", "–", "–"]
    assert [row[0] for row in others] == ["motor_lag [s]", "eta90 [1]"]
    own = returns_of(compared, "PPO")
    values = sorted([*own[: TINY.sweep_specimens], *own[TINY.specimens :][: TINY.sweep_specimens]])
    shown = unchanged[heading.index("PPO")]
    assert float(shown.split(" [")[0]) == pytest.approx(np.mean(values[1:3]), abs=6e-4)


def test_an_agent_that_loses_is_said_to_lose(compared):
    text = markdown(compared)
    assert "PPO against return stroke: does not beat it: " in text  # worse, or level: four specimens
    assert "No agent beats the best script" in (compared / "leaderboard.html").read_text()
    assert "| the force is not felt | PPO without force |" in text
    assert "| eta90 [1] |" in text


def test_an_idle_policy_is_in_the_table_but_not_in_the_plot_and_has_no_rank(compared):
    table = read_table(compared)
    page = (compared / "leaderboard.html").read_text()
    plot = page[page.index("minus that of return stroke: ") :].partition(">")[0]
    assert "PPO without force" in plot
    assert "nothing " not in plot
    ranks = {row[1]: row[0] for row in table.main()[1]}
    assert ranks["nothing"] == "–"
    assert sorted(ranks[name] for name in NAMES[:2]) == ["1", "2"]
    assert ranks["return stroke"] == "1"  # among scripts


def test_the_cost_of_training_counts_all_that_was_tried_and_shown(compared):
    table = read_table(compared)
    decisions = table.line("PPO", "", "training_decisions", "mean")
    assert decisions is not None
    assert decisions.interval == Interval(2300.0, 2300.0, 2300.0)
    heading, rows = table.origins()
    (row,) = (row for row in rows if row[0] == "PPO")
    told = dict(zip(heading, row, strict=True))
    assert told["code"] == "0" * 9
    assert told["after 100 cuts"].startswith("0.100 ")
    assert told["after 1,000 cuts"].startswith("0.300 ")


def test_a_part_of_the_comparison_has_a_table_that_says_how_much_of_it_is_done(compared, tmp_path):
    cut_only(compared, tmp_path, "nothing", "return-stroke")
    write_tables(tmp_path, TINY)
    table = read_table(tmp_path)
    assert table.contestants == ["return stroke", "nothing"]
    assert table.verdicts() == []
    assert "No agent has been trained" in (tmp_path / "leaderboard.html").read_text()
    assert f"Not yet run: {', '.join(ENTRIES)}." in markdown(tmp_path)


def test_comparisons_of_two_machines_make_one_table(compared, tmp_path):
    one, other, published = (tmp_path / name for name in ("one", "other", "published"))
    for folder, names in (
        (one, ("return-stroke", "ppo-seed1")),
        (other, ("nothing", "ppo-seed0", "ppo-without-force-seed0")),
    ):
        folder.mkdir()
        cut_only(compared, folder, *names)
    publish(one, published)
    assert read_table(published).seeds("PPO") == "1 of 2 *"
    assert "A star marks rows with fewer training runs" in markdown(published)
    publish(other, published)
    table, whole = read_table(published), read_table(compared)
    assert table.seeds("PPO") == "2"
    assert table.line("PPO", "mixed", "return") == whole.line("PPO", "mixed", "return")
    assert table.difference("PPO without force", "PPO") is not None  # by the one seed that both have
    left = Benchmark(published, TINY, NAMES, processes=1).uncut()
    assert left == [Part("PPO without force", 1)]


def test_what_is_published_prints_the_same_table_and_page(compared, tmp_path):
    kept, page = tmp_path / "published", tmp_path / "page.html"
    publish(compared, kept)
    assert markdown(kept) == markdown(compared)
    assert sorted(path.name for path in kept.iterdir()) == ["cuts", "protocol.json", "summary.csv", "sweeps.csv"]
    write_leaderboard(page, kept)
    assert "0" * 9 in page.read_text()


def test_a_submission_becomes_a_row_unless_it_is_damaged_or_its_name_is_taken(compared, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(benchmark.read_submission, "__defaults__", ((TINY, QUICK),))
    published, file = tmp_path / "published", tmp_path / "submission.json"
    publish(compared, published)
    kind, digest = "with demonstrations", entry_digest([entry_files("ppo-free")])
    seeds = entry_seeds(digest, TINY)
    run = submitted_run(contestant("ppo-free"), {"100": 0.25}, TINY, seeds)
    entry = Submission("theirs", "A. Name", "https://example.org", "2026-11-23", kind, digest, "", TINY, (run,))
    write_submission(file, entry)
    add_submission(file, published, ["ppo-free"])
    assert "every return of 4 cuts repeated" in capsys.readouterr().out
    table = read_table(published)
    assert table.kind("theirs") == kind
    assert table.seeds("theirs") == "1 of 5 *"
    line = table.line("theirs", "mixed", "return", "mean")
    assert line is not None
    assert line.interval.value == pytest.approx(np.mean(run.returns), abs=1e-4)
    (row,) = (row for row in table.origins()[1] if row[0] == "theirs")
    assert row[1:4] == ["A. Name", "2026-11-23", "https://example.org"]
    assert any(sentence.startswith("theirs against return stroke") for sentence in table.verdicts())
    script = evaluate({"it": contestant("return stroke")}, seeds, {"specimen_class": "mixed"}, processes=1)
    difference = np.mean(run.returns) - np.mean([row["return"] for row in script])  # on the entry's own specimens
    assert table.difference("theirs", "return stroke").interval.value == pytest.approx(difference, abs=2e-4)
    assert "Entries by others cut specimens that are drawn from their own files" in markdown(published)
    with pytest.raises(ValueError, match="the name 'theirs' is taken"):
        add_submission(file, published)
    altered = dataclasses.replace(run, returns=(0.9, *run.returns[1:]))
    write_submission(file, dataclasses.replace(entry, policy="other", runs=(altered,)))
    with pytest.raises(ValueError, match=f"specimen {seeds[0]}: its replay returns"):
        add_submission(file, published)
    assert "other" not in read_table(published).contestants


def renamed(folder: Path, name: str, seed: int, **facts) -> None:
    """Keep the cuts of PPO's run as those of another agent."""
    run = read_run(file_of(folder, "PPO", seed), TINY)
    write_run(folder, {**run.facts, "contestant": name, **facts}, run.by_class, "mixed")


@pytest.mark.parametrize(("kept", "as_begun"), [((True, True), True), ((True, False), False)])
def test_an_agent_that_kept_its_start_with_every_seed_has_no_rank(compared, tmp_path, kept, as_begun):
    publish(compared, tmp_path)
    for seed in range(2):
        renamed(tmp_path, "SAC", seed, kept_its_start=kept[seed])
        file_of(tmp_path, "PPO", seed).unlink()
    summarise_cuts(tmp_path, TINY)
    table = read_table(tmp_path)
    assert table.as_begun("SAC") is as_begun
    assert ("SAC" not in table.competitors()) is as_begun


@pytest.mark.parametrize(("decisions", "kept"), [(400_000, True), (464_000, False)])
def test_a_policy_from_before_the_actor_learned_is_recorded_as_its_start(tmp_path, decisions, kept):
    """PPO's critic learns alone for a tenth of four million decisions."""
    benchmark = Benchmark(tmp_path, TINY, ("PPO",), processes=1)
    card = pretend_trained(tmp_path / "runs", "PPO", 0) / "policy" / "card.json"
    content = json.loads(card.read_text())
    content["training"]["decisions"] = decisions
    card.write_text(json.dumps(content))
    assert benchmark.facts(Part("PPO", 0))["kept_its_start"] is kept


def trained_here(command: list[str], *, cwd: Path, stdout: TextIO, **_: object) -> subprocess.CompletedProcess[str]:
    """Run ``python -m cutenv COMMAND`` in this process, which has the learners loaded."""
    done = run(command[3], cwd, *command[4:])
    stdout.write(done.stdout + done.stderr)
    return done


def test_an_interrupted_training_goes_on_and_one_without_checkpoint_begins_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(program, "subprocess", SimpleNamespace(run=trained_here))
    benchmark = Benchmark(tmp_path, TINY, ("behaviour cloning",), processes=1, seeds=1)
    assert [part.slug for part in benchmark.untrained()] == ["behaviour-cloning-seed0"]
    torn = tmp_path / "runs" / "behaviour-cloning-seed0"
    torn.mkdir(parents=True)
    (torn / "run.json").write_text("{}")  # as left by a kill while the first checkpoint was written
    (torn / "checkpoint.1a2b3c4d.part.safetensors").write_bytes(b"half of it")
    assert len(list(benchmark.train())) == 1
    assert benchmark.untrained() == []
    facts = json.loads((torn / "run.json").read_text())
    assert facts["arguments"]["demonstrations"] == 300
    del facts["training_minutes"]  # as left by an interruption after one
    (torn / "run.json").write_text(json.dumps(facts))
    assert [part.slug for part in benchmark.untrained()] == ["behaviour-cloning-seed0"]
    list(benchmark.train())
    assert benchmark.untrained() == []
    assert "resuming after" in (tmp_path / "runs" / "behaviour-cloning-seed0.log").read_text()


def test_a_run_that_was_trained_by_hand_counts_if_its_options_are_the_protocols(tmp_path):
    benchmark = Benchmark(tmp_path, Protocol(), ("PPO",), 1, runs=tmp_path / "runs")
    run = pretend_trained(tmp_path / "runs", "PPO", 3, Protocol())
    assert [part.seed for part in benchmark.untrained()] == [0, 1, 2, 4, 5, 6, 7, 8, 9]
    facts = json.loads((run / "run.json").read_text())
    facts["arguments"] |= {"specimens": 200, "name": "by-hand"}  # these change nothing that is learned
    (run / "run.json").write_text(json.dumps(facts))
    assert len(benchmark.untrained()) == 9
    facts["arguments"]["timesteps"] = 400_000
    (run / "run.json").write_text(json.dumps(facts))
    with pytest.raises(SystemExit, match="ppo-seed3 was trained with timesteps 400000; the protocol wants 4000000"):
        benchmark.untrained()


def test_a_training_that_fails_says_where_to_look(tmp_path, monkeypatch):
    benchmark = Benchmark(tmp_path, TINY, ("behaviour cloning",), processes=1)
    monkeypatch.setattr(Benchmark, "training_arguments", lambda *_: ["--no-such-option"])
    with pytest.raises(SystemExit, match=r"see .*behaviour-cloning-seed0\.log"):
        list(benchmark.train())


def test_seeds_of_training_runs_validation_and_test_are_disjoint():
    of_runs = [set(PPOArguments(seed=seed).training_seeds) for seed in ENTRIES["PPO"].training_seeds(Protocol())]
    assert len(set.union(*of_runs)) == sum(map(len, of_runs))
    assert all(seeds <= set(TRAINING_SEEDS) for seeds in of_runs)
    assert max(TRAINING_SEEDS) < min(VALIDATION_SEEDS)
    assert set(Protocol().test_seeds) <= set(TEST_SEEDS)
    assert not set(Protocol().test_seeds) & set(TEST_SEEDS[: PPOArguments().specimens])  # those that every run prints
    assert len(Protocol().test_seeds) == Protocol().specimens


def test_the_held_out_specimens_change_with_the_version():
    assert Protocol().first_specimen == 10_000 * (int(Protocol().version) - 2)


def test_the_table_is_written_again_from_the_cuts_alone(compared):
    names = ("summary.csv", "sweeps.csv", "leaderboard.md")  # a page's drawings carry numbers of their own
    before = {name: (compared / name).read_bytes() for name in names}
    for name in names:
        (compared / name).unlink()
    write_tables(compared, kept_protocol(compared))
    assert {name: (compared / name).read_bytes() for name in names} == before


@pytest.mark.parametrize(
    ("low", "high", "said"), [(0.01, 0.1, "beats it"), (-0.1, 0.1, "level"), (-0.2, -0.1, "worse"), (0.0, 0.1, "level")]
)
def test_the_interval_of_the_difference_decides(low, high, said):
    assert said in verdict(Interval((low + high) / 2.0, low, high))


def test_the_page_fetches_nothing(compared):
    text = (compared / "leaderboard.html").read_text()
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert "https://" not in text


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


def test_results_of_another_protocol_are_not_mixed_in(compared):
    with pytest.raises(SystemExit, match="another protocol"):
        keep_protocol(compared, Protocol())
    assert kept_protocol(compared) == TINY


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
    done = run("scripts/benchmarks/leaderboard/benchmark_agents.py", tmp_path, "--only", "PPPO")
    assert done.returncode == 2
    assert "'PPPO' takes no part" in done.stderr
    assert "recurrent PPO" in done.stderr
