"""Docstrings become Markdown: tables, links and headings."""

from __future__ import annotations

import pytest

from scripts.documentation.restructured import markdown, with_links, with_tables

TABLE = """\
===== =======
Name  Meaning
===== =======
a     one, or
      two
b     a|b
===== =======
"""


def test_a_simple_table_becomes_one_of_markdown() -> None:
    rows = [r"| Name | Meaning |", "| --- | --- |", "| a | one, or two |", r"| b | a\|b |"]
    assert with_tables(TABLE).splitlines() == rows


def test_a_table_without_an_end_is_refused() -> None:
    with pytest.raises(ValueError, match="three rules, this one 2"):
        with_tables("\n".join(TABLE.splitlines()[:-1]))


def test_a_role_becomes_a_link_that_may_lead_nowhere() -> None:
    link = with_links("see :class:`~cutenv.sim.trace.Trace`.")
    assert link == 'see <autoref optional identifier="cutenv.sim.trace.Trace"><code>Trace</code></autoref>.'


def test_a_name_of_the_same_class_becomes_code() -> None:
    assert with_links("as :meth:`reset` does") == "as `reset` does"


def test_section_titles_become_headings() -> None:
    assert markdown("First.\n\nEnds\n----\nAll.", level=3) == "First.\n\n### Ends\nAll."
