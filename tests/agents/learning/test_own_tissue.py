"""From twelve records to an agent on one's own tissue: the commands of the guide, in their order."""

from __future__ import annotations

import glob
import json
import re
import shlex
from pathlib import Path

import pytest
from virtual_session import traces

pytest.importorskip("stable_baselines3", reason="training is an extra: pip install 'cutenv[rl]'")

from cutenv.commands import cli
from cutenv.records import save
from cutenv.sim.tissue import load_description

GUIDE = Path(__file__).parents[3] / "docs" / "how-to" / "calibrate.md"
QUICKER = {
    "train": "--timesteps 256 --environments 4 --batch-size 64 --rollout 16 --demonstrations 200 --validations 1 "
    "--validation-specimens 2 --specimens 2",
    "evaluate": "--specimens 2 --processes 1",
    "demo": "--specimens 1",
}
"""The same commands, with less of everything."""


def test_the_guide_leads_from_records_to_an_agent_on_ones_own_tissue(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("records").mkdir()
    for number, trace in enumerate(traces(speeds=(0.0127, 0.0254))):  # twelve; slower ones have more readings
        liver = re.findall(r"\d+", str(trace.metadata["specimen"]))[0]
        save(trace, Path("records") / f"liver{liver}_{number:02d}.csv")
    (block,) = re.findall(
        r"## From twelve records to an agent\n\n```bash\n(.*?)```", GUIDE.read_text("utf-8"), re.DOTALL
    )
    lines = [shlex.split(line) for line in block.splitlines() if line.startswith("cutenv")]
    assert [words[1] for words in lines] == ["check", "calibrate", "train", "evaluate", "demo"]
    printed = {}
    for _, command, *words in lines:
        given = [each for word in words for each in (sorted(glob.glob(word)) if "*" in word else [word])]
        assert cli.main([command, *given, *shlex.split(QUICKER.get(command, ""))]) == 0, command
        printed[command] = capsys.readouterr().out
    mine = load_description("my_tissue.json")
    assert mine.name == "my_tissue"
    assert Path("card.html").is_file()
    assert Path("mine.png").is_file()
    run = json.loads(Path("runs/mine/run.json").read_text("utf-8"))
    assert run["arguments"]["tissue"] == "my_tissue.json"
    assert "of my_tissue.json" in printed["train"]
    assert "return stroke" in printed["evaluate"]
    assert "--tissue my_tissue.json" in printed["demo"]
