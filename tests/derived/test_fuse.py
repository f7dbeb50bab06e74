"""Formulas become one function: the same numbers, and a clear word about what cannot be done."""

from __future__ import annotations

import math

import pytest

from cutenv._engine.fuse import expression, fuse

SCALE = 4.0
FIRST, SECOND = (lambda a: a + 1.0), (lambda a, b: a * b)
SAME, AGAIN = (lambda a: a - SCALE), (lambda a: a - SCALE)
ONE, TWO, WHOLE = (lambda a: a + 1.0), (lambda a: a + 2.0), (lambda a: a + 2)
(LONG,) = (
    lambda a, b: (
        a
        if a > b  # the larger
        else b
    ),
)
MADE = eval("lambda a: a")


def fused(*formulas, **renamed):
    """A function of a and b that returns the values of formulas."""
    lines = [f"found[{n}] = {expression(each, ('a', 'b'), renamed)}" for n, each in enumerate(formulas)]
    function = fuse("found_by", ["a", "b", "found"], lines, [__name__])

    def values(a, b):
        found = [math.nan] * len(formulas)
        function(a, b, found)
        return found

    return values


@pytest.mark.parametrize(("a", "b"), [(2.0, 5.0), (7.0, -1.0)])
def test_formulas_on_one_line_and_on_several_are_told_apart(a, b):
    assert fused(FIRST, SECOND, SAME, AGAIN, LONG)(a, b) == [a + 1.0, a * b, a - 4.0, a - 4.0, max(a, b)]
    assert [expression(each, ("a",)) for each in (ONE, TWO, WHOLE)] == ["(a + 1.0)", "(a + 2.0)", "(a + 2)"]


def test_parameters_are_renamed_and_nothing_else():
    total = lambda total, a: total + a * len("total")  # noqa: E731
    assert expression(total, ("a",), {"total": "count.total[k]"}) == "(count.total[k] + a * len('total'))"
    assert expression(lambda b: b * (1.0 + b), (), {"b": "x - y"}) == "((x - y) * (1.0 + (x - y)))"


def test_an_unknown_quantity_is_named_with_file_and_line():
    unknown = lambda a, humidity: a * humidity  # noqa: E731
    place = f"{__file__}:{unknown.__code__.co_firstlineno}"
    with pytest.raises(ValueError, match=r"asks for 'humidity'; here there are: a, b\.") as error:
        expression(unknown, ("b", "a"))
    assert str(error.value).startswith(place)


def test_what_is_not_a_lambda_in_a_file_is_refused():
    def defined(a: float) -> float:
        return a

    for formula in (defined, MADE):
        with pytest.raises(ValueError, match="cannot be read; give a lambda of one expression"):
            expression(formula, ("a",))


def test_a_traceback_shows_the_fused_line():
    with pytest.raises(ZeroDivisionError) as error:
        fused(lambda a, b: a / b)(1.0, 0.0)
    assert str(error.traceback[-1].statement).strip() == "found[0] = (a / b)"
