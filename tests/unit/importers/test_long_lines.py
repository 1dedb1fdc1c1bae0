"""What is hostile or damaged is refused in linear time. A pattern that gives digits back needs half an hour."""

from __future__ import annotations

import pytest

from pmsm_ctrl.datasheet import QUESTIONS, read_answer
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.importers.layout import is_number
from pmsm_ctrl.importers.names import split_header

LONG = 200_000


@pytest.mark.parametrize(
    "cell", ["1" * LONG + "x", "." + "1" * LONG + "x", "1" * LONG + "." + "1" * LONG + "e", "1e" + "2" * LONG + "x"]
)
def test_a_cell_of_digits_that_is_no_number(cell: str) -> None:
    assert not is_number(cell)


def test_a_long_number_is_one() -> None:
    assert is_number("1" * LONG)
    assert is_number(" " * LONG + "1e5" + " " * LONG)


@pytest.mark.parametrize("part", ["(", "[ ", "a(", "_", "()", " (", "a_", ")]"])
def test_a_header_of_brackets_is_a_name_without_unit(part: str) -> None:
    assert split_header(part * (LONG // 10) + "x")[1] == ""


def test_an_answer_of_digits_and_spaces() -> None:
    with pytest.raises(RequestError):
        read_answer(QUESTIONS[0], "1" * LONG + " " * LONG + "x")
