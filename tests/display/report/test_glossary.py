"""The glossary of a report holds what the task does: every term of its reward, and its numbers."""

from __future__ import annotations

import re

import pytest

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

import made_up_result as made_up

from cutenv.display.report import page
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.task.depth import DEPTH_CUT
from cutenv.task.path import PATH_CUT

MEANINGS = dict(page.MEANINGS)


def test_every_term_of_the_reward_has_a_title_of_its_own():
    assert tuple(page.term_meanings()) == (*DEPTH_CUT.all_terms, *tuple(cost.name for cost in PATH_CUT.costs))
    assert all(page.term_meanings().values())
    assert len(set(page.term_meanings().values())) == len(page.term_meanings())


def test_the_return_of_doing_nothing_is_that_of_the_environment_s_docstring():
    (stated,) = re.findall(r"Doing nothing returns (-[\d.]+)\.  ", GentleCutEnv.__doc__)
    (printed,) = re.findall("Doing nothing gets \u2212([\\d.]+)\\.$", MEANINGS["Return"])
    assert -float(printed) == float(stated)


def test_limits_are_those_of_the_environment_s_docstring():
    assert "within 3 mm of the target and the blade within 10 degrees" in MEANINGS["Success"]
    assert "tip within 3 mm of the target, blade within 10 degrees" in GentleCutEnv.__doc__
    assert "Above 400 N/m it costs" in MEANINGS["Force per depth"]
    assert "above 400 N/m" in GentleCutEnv.__doc__
    assert MEANINGS["Lag"].endswith("it costs above 10 mm.")


def test_a_term_that_is_not_of_this_reward_is_refused():
    rows = [{**row, "score": row["score"].replace("reward_jump", "reward_jumps")} for row in made_up.result().summary]
    with pytest.raises(ValueError, match=r"'jumps'.*Did you mean 'jump'"):
        made_up.result(summary=rows)
