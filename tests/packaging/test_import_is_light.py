"""``import cutenv`` costs what Gymnasium costs: what is heavy waits until it is used."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("torch", "stable_baselines3", "matplotlib", "pygame", "numba", "scipy", "skfem")


def check_nothing_heavy_is_loaded(statement: str, heavy: tuple[str, ...] = HEAVY) -> None:
    code = f"import sys\n{statement}\nprint(*(name for name in {heavy!r} if name in sys.modules))"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.split() == []


def test_import_cutenv_loads_nothing_heavy() -> None:
    check_nothing_heavy_is_loaded("import cutenv")


def test_an_environment_needs_no_finite_elements() -> None:
    """They have found what it takes of the slab, and that is stored."""
    heavy = ("skfem", "scipy.optimize", "scipy.sparse", "matplotlib")
    check_nothing_heavy_is_loaded("import cutenv.envs.gentle_cut, cutenv.envs.rig_cut", heavy)


def test_help_loads_nothing_heavy() -> None:
    check_nothing_heavy_is_loaded(
        "from cutenv.commands import cli; cli._GroupParser('cutenv', cli.PROGRAM).format_help()"
    )


def test_help_of_training_needs_no_learner() -> None:
    """Such help is for those, too, who have not installed the extra."""
    code = (
        "import sys\n"
        "class Absent:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name in ('torch', 'stable_baselines3', 'sb3_contrib', 'tqdm', 'matplotlib'):\n"
        "            raise ModuleNotFoundError(name, name=name)\n"
        "sys.meta_path.insert(0, Absent())\n"
        "from cutenv.commands.cli import main\n"
        "for command in ('train', 'evaluate', 'datasets'):\n"
        "    try: main([command, '--help'])\n"
        "    except SystemExit as done: assert done.code == 0\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert all(option in ran.stdout for option in ("--timesteps", "--specimen-class", "--target-length"))


@pytest.mark.parametrize("statement", ["import cutenv, numba", "import cutenv, matplotlib.pyplot"])
def test_a_heavy_import_is_noticed(statement: str) -> None:
    with pytest.raises(AssertionError):
        check_nothing_heavy_is_loaded(statement)
