"""A kernel may not use a record whose memory it has given back."""

import ast
import inspect
from pathlib import Path

import numpy as np

import cutenv
from cutenv._engine.intrinsics import first_row, keep_alive
from cutenv._engine.jit import njit

PACKAGE = Path(inspect.getfile(cutenv)).parent
LANES = np.dtype((np.record, [("value", "f8", (64,))]))


@njit
def _kept(other: float) -> float:
    rows = np.zeros(1, LANES)
    row = first_row(rows)
    row.value[1] = 1.0
    for _ in range(10):  # the allocator gives a block that was freed to the next that asks
        again = np.full(64, other)
        row.value[0] += 0.0 * again[1]
    found = row.value[1]
    keep_alive(rows)
    return found


def test_memory_of_a_row_is_not_given_to_another_array():
    assert _kept(-7.0) == 1.0


def _made_and_viewed(function: ast.FunctionDef) -> set[str]:
    """Return the names of the arrays that a function makes and takes the first row of."""
    made, viewed = set(), set()
    inside = {
        id(part)
        for each in ast.walk(function)
        if isinstance(each, ast.FunctionDef) and each is not function
        for part in ast.walk(each)
    }  # of functions within it, which are looked at by themselves
    for node in (each for each in ast.walk(function) if id(each) not in inside):
        if isinstance(node, ast.Assign) and "np.zeros" in ast.unparse(node.value):
            made |= {name.id for target in node.targets for name in ast.walk(target) if isinstance(name, ast.Name)}
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "first_row" and isinstance(node.args[0], ast.Name):
            viewed.add(node.args[0].id)
    return made & viewed


def test_arrays_that_a_kernel_makes_are_kept_to_its_end():
    found = 0
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            for name in _made_and_viewed(node) if isinstance(node, ast.FunctionDef) else ():
                assert f"keep_alive({name})" in [ast.unparse(line) for line in node.body], f"{path.name}: {node.name}"
                found += 1
    assert found >= 4
