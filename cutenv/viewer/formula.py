"""Formulas of the scene: written once as text, evaluated here with NumPy, and handed as trees to the page's script."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

Tree = float | str | list[Any]
"""A number, a name, or a list of a function's name and its arguments."""

_SIGNS: dict[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "abs": np.abs,
    "acos": np.arccos,
    "atan2": np.arctan2,
    "clip": np.clip,
    "cos": np.cos,
    "max": np.maximum,
    "min": np.minimum,
    "sin": np.sin,
    "sqrt": np.sqrt,
    "tan": np.tan,
}


class SceneFormula:
    """SceneFormula of numbers, names, the four operations, and a few functions.

    Parameters
    ----------
    text : str
        As in Python: ``"blade - depth / tan(angle)"``.

    Attributes
    ----------
    tree : Tree
        The formula as JSON can hold it.

    Raises
    ------
    ValueError
        If the text holds anything else.
    """

    def __init__(self, text: str) -> None:
        self.tree = _tree(ast.parse(text, mode="eval").body, text)

    def __call__(self, values: Mapping[str, Any]) -> Any:
        """Return the value; names, and functions that are no formula's own, are looked up in ``values``."""
        return _value(self.tree, values)


def _tree(node: ast.expr, text: str) -> Tree:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id=name):
            return name
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return ["-", 0.0, _tree(operand, text)]
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _SIGNS:
            return [_SIGNS[type(sign)], _tree(left, text), _tree(right, text)]
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            return [name, *(_tree(each, text) for each in arguments)]
    raise ValueError(f"formula = {text!r} holds {ast.unparse(node)!r}; use numbers, names, + - * / and functions.")


def _value(tree: Tree, values: Mapping[str, Any]) -> Any:
    if isinstance(tree, float):
        return tree
    if isinstance(tree, str):
        return values[tree]
    name, *arguments = tree
    function = _FUNCTIONS.get(name) or values[name]
    return function(*(_value(each, values) for each in arguments))
