"""Table 4.3: the sizes of the three models; the printed numbers among themselves."""

from __future__ import annotations

import pytest
from printed_digits import check_printed

from cutenv.tissue.tables import table

T = table("4.3")
BRICK = T["n_equations"][0]


@pytest.mark.parametrize("row", range(3))
def test_equations_are_nodes_times_dimensions(row):
    assert T["n_equations"][row] == T["n_nodes"][row] * T["dimensions"][row]


@pytest.mark.parametrize("row", range(3))
def test_relative_size_is_that_of_the_equations(row):
    check_printed(T["n_equations"][row] / BRICK, T["relative_model_size"][row], T.resolution["relative_model_size"])


def test_the_0_3_of_the_text_is_not_the_relative_size_of_the_8_node_model():
    assert any("1.0:0.3:0.04" in erratum for erratum in T.errata)
    with pytest.raises(AssertionError, match="is not printed as"):
        check_printed(T["n_equations"][1] / BRICK, 0.3, 0.1)
