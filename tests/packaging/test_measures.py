"""Each measure of the code base is counted right on a small made-up tree with known answers."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from scripts.documentation import measure_codebase

ROOT = Path(__file__).parents[2]


FILES = {
    "README.md": "# Made up\n\nThree lines.\n",
    "pyproject.toml": """
        [[tool.importlinter.contracts]]
        type = "forbidden"
        [[tool.importlinter.contracts]]
        type = "layers"
        exhaustive = true
        layers = ["(cli)", "(rig) | (task)", "(loose)"]
    """,
    "cutenv/__init__.py": '''
        """A made-up package."""
        import gymnasium
        for version in (2, 10, 9):
            gymnasium.register(id=f"cutenv/GentleCut-v{version}", entry_point=f"cutenv.task:Version{version}")
    ''',
    "cutenv/__main__.py": "",
    "cutenv/cli.py": '''
        """What was told: TOLD."""
        from cutenv.rig import stop


        def told() -> int:
            """Of the count."""
            return stop
    ''',
    "cutenv/loose.py": '''
        """As it is."""

        WIDTH: float = 1.0
        """How wide [m]."""
        HEIGHT, _HIDDEN = 1.0, 2.0
        """Offshore height, which begins with no fragment [m]."""
        "no docstring of an attribute, since a string precedes it"


        class Blade:
            """Blade of the rig."""

            angle = 1.0
            """Whether upright."""

            async def turn(self) -> None:
                """Turns the blade."""

                def inner() -> None:
                    pass
    ''',
    "cutenv/rig/__init__.py": "from . import stop\nHEIGHT = 2.0\n",
    "cutenv/rig/stop.py": "from . import axis\nfrom .. import loose\n",
    "cutenv/rig/axis.py": "def move():\n    from .hidden import depth\n",
    "cutenv/rig/hidden.py": "import cutenv.rig.stop\ndepth = 1\nclass Blade: ...\n",
    "cutenv/rig/alone.py": "import cutenv.rig.alone\n",
    "cutenv/task/__init__.py": '''
        """Environments, of which the newest needs the rig."""
        from gymnasium.envs.classic_control import CartPoleEnv


        class Version9(CartPoleEnv):
            pass


        class Version10(CartPoleEnv):
            made_up = True

            def __init__(self):
                import cutenv.rig.alone; super().__init__()
    ''',
    "agents/learn.py": '"""Where learning happens."""\n',
    "scripts/draw.py": 'def draw():\n    """Draw."""\n    "Of a string"\n',
    "examples/first.py": "print(1)\nprint(2)\n",
    "examples/_common.py": "print(0)\n",
    "tests/test_it.py": "def test_it():\n    'What was told'\n    assert True\n",
    "docs/index.md": "one\ntwo\n",
    "docs/how-to/train.md": "three\n",
    "docs/how-to/first.ipynb": "{}\n",
    "docs/picture.svg": "<svg/>\n",
}


def dedented(text: str) -> str:
    """Take off the margin of a text that begins with an empty line."""
    lines = text.split("\n")
    margin = len(lines[1]) - len(lines[1].lstrip()) if len(lines) > 1 and not lines[0] else 0
    return "\n".join(line[margin:] for line in (lines[1:] if margin else lines)).rstrip(" ")


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("made_up")
    for name, text in FILES.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(dedented(text), encoding="utf-8")
    return root


@pytest.fixture(scope="module")
def measured(tree: Path) -> measure_codebase.Measures:
    return measure_codebase.measures(tree)


@pytest.mark.parametrize(
    ("measure", "value"),
    [
        ("readme_lines", 3),
        ("layers", 3),
        ("wings", 2),
        ("loose_modules", 2),
        ("import_cycles", 1),
        ("loaded_cutenv", 7),  # all but __main__, cli and hidden
        ("loaded_rig", 4),
        ("step_functions", 0),  # those of Gymnasium alone
        ("both_modules", 0),
        ("repeated_names", 2),
        ("docstrings", 12),
        ("fragments", 6),
        ("d401", 1),  # "Turns the blade."
        ("word", 3),
        ("files", 10),
        ("file_median", 2.5),
        ("file_p90", 13),
        ("file_largest", 20),
        ("function_median", 2),
        ("function_longest", 5),
        ("lines_agents", 1),
        ("lines_scripts", 3),
        ("lines_examples", 3),
        ("lines_tests", 3),
        ("lines_docs", 3),
        ("pages", 3),
        ("examples", 1),
    ],
)
def test_a_measure_of_the_made_up_tree(measured: measure_codebase.Measures, measure: str, value: float) -> None:
    assert measured[measure] == value


def test_lines_of_the_package_are_those_of_its_files(tree: Path, measured: measure_codebase.Measures) -> None:
    assert measured["lines_cutenv"] == sum(
        path.read_text(encoding="utf-8").count("\n") for path in (tree / "cutenv").rglob("*.py")
    )


def test_what_was_counted_is_named(tree: Path) -> None:
    assert measure_codebase.import_cycles(tree) == [["cutenv.rig.axis", "cutenv.rig.hidden", "cutenv.rig.stop"]]
    assert measure_codebase.repeated_names(tree) == {
        "Blade": ["cutenv.loose", "cutenv.rig.hidden"],
        "HEIGHT": ["cutenv.loose", "cutenv.rig"],
    }
    assert [line.partition(": ")[2] for line in measure_codebase.fragments(tree)] == [
        "Where learning happens.",
        "What was told: TOLD.",
        "Of the count.",
        "As it is.",
        "How wide [m].",
        "Whether upright.",
    ]


def test_two_files_that_import_each_other_are_a_cycle(tree: Path, tmp_path: Path) -> None:
    (tmp_path / "cutenv").mkdir()
    (tmp_path / "cutenv" / "one.py").write_text("from cutenv import two\n")
    (tmp_path / "cutenv" / "two.py").write_text("def f():\n    from cutenv.one import g\n")
    assert measure_codebase.import_cycles(tmp_path) == [["cutenv.one", "cutenv.two"]]
    (tmp_path / "cutenv" / "two.py").write_text("if TYPE_CHECKING:\n    from cutenv import one\n")
    assert measure_codebase.import_cycles(tmp_path) == [["cutenv.one", "cutenv.two"]]
    (tmp_path / "cutenv" / "two.py").write_text("")
    assert measure_codebase.import_cycles(tmp_path) == []


def test_an_environment_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "cutenv").mkdir()
    (tmp_path / "cutenv" / "__init__.py").write_text("raise ImportError('no engine')\n")
    with pytest.raises(SystemExit, match="no engine"):
        measure_codebase.loaded_modules(tmp_path)


def test_the_table_has_a_column_for_each_set_and_a_row_for_each_measure() -> None:
    one = dict.fromkeys(measure_codebase.LABELS, 1234.0) | {"d401": None, "file_median": 127.5}
    table = measure_codebase.markdown({"before": one, "now": {"layers": 7}}).splitlines()
    assert table[0] == "|  | before | now |"
    assert len(table) == 2 + len(measure_codebase.LABELS)
    assert "| layers of the import contract | 1,234 | 7 |" in table
    assert "| lines a file, median | 127.5 | not measured |" in table
    assert "| ... not in the imperative (ruff D401) | not measured | not measured |" in table


def test_kept_numbers_are_of_every_measure() -> None:
    before = json.loads((ROOT / measure_codebase.BEFORE).read_text(encoding="utf-8"))
    assert list(before) == ["f7f4067", "7b6279b", "f9e2294"]
    for column in before.values():
        assert set(column) <= set(measure_codebase.LABELS)
        assert all(value >= 0 for value in column.values())
    newest = before["f9e2294"]
    assert list(newest) == list(measure_codebase.LABELS)
    assert newest["step_functions"] < newest["both_functions"] < newest["step_functions"] + newest["batch_functions"]


def test_missing_numbers_name_the_command_that_makes_them(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"measure_codebase --at REVISION --json"):
        measure_codebase.kept(tmp_path / "none.json")


def test_the_page_has_the_table_between_its_markers() -> None:
    page = (ROOT / "docs" / "development" / "measures.md").read_text(encoding="utf-8")
    table = page.partition("<!-- measures -->")[2].partition("<!-- /measures -->")[0].strip().splitlines()
    assert table[0] == "|  | f7f4067 | 7b6279b | f9e2294 | now |"
    labels = [line.split(" | ")[0].removeprefix("| ") for line in table[2:]]
    assert labels == list(measure_codebase.LABELS.values())
