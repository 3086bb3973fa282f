"""Numbers replaced in texts: cells are those that the reader of tables finds, and the rest stays sign for sign."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.motion.csv_table import read_table
from hhsim.motion.text_edit import NewColumn, NumberEdit, cell_edits, edited


@pytest.mark.parametrize(
    ("old", "value", "decimals", "new"),
    [
        ("0.25", 0.5, 0, "0.50"),
        ("0.25", 0.25, 6, "0.25"),
        ("2.5e-1", 0.25, 6, "2.5e-1"),
        ("-1E-9", 0.25, 3, "0.250000000"),
        ("1e3", 1000.5, 2, "1000.50"),
        ("7", 7.04, 1, "7.0"),
        ("0.1", float("nan"), 6, "0.1"),
        ("", 1.0, 6, ""),
        ("n/a", 1.0, 6, "n/a"),
        ("0.000000000000000000001", 0.1, 2, "0.10000000000000001"),
    ],
)
def test_a_number_keeps_its_decimals_or_gets_those_it_needs(old: str, value: float, decimals: int, new: str) -> None:
    assert edited(f"a {old},", [NumberEdit(2, 2 + len(old), value, decimals)]) == f"a {new},"


def test_a_decimal_comma_stays_one() -> None:
    assert edited("1,50", [NumberEdit(0, 4, 2.25, 1)], ",") == "2,25"


CELLS = st.one_of(
    st.floats(-1e3, 1e3).map(repr), st.sampled_from(["", "nan", '"0.5"', ' "a ""b"" c"', "x", " 1.25 ", '"1e-3" '])
)


@given(
    st.lists(st.lists(CELLS, min_size=4, max_size=4), min_size=2, max_size=6),
    st.sampled_from([",", ";", "\t"]),
    st.sampled_from(["\n", "\r\n"]),
    st.integers(0, 3),
)
def test_the_cells_are_those_of_the_reader(rows: list[list[str]], sign: str, end: str, column: int) -> None:
    for row in rows:
        row[column] = row[column] if row[column].strip(' "')[-1:].isdigit() else "0.125"
    text = end.join(["# made: by hand", sign.join("abcd"), *(sign.join(row) for row in rows)]) + end
    table = read_table(text)
    name, picked = "abcd"[column], list(range(0, len(table.rows), 2))
    new = np.linspace(5.0, 6.0, len(picked))
    made = edited(text, cell_edits(text, table, picked, {name: NewColumn(new, 12)}))
    again = read_table(made)
    for k, (one, other) in enumerate(zip(table.rows, again.rows, strict=True)):
        assert [cell for j, cell in enumerate(one) if j != column] == [c for j, c in enumerate(other) if j != column]
        if k not in picked:
            assert one == other
    assert np.allclose(again.numbers([name])[0][picked, 0], new, atol=1e-12)
    assert made.count(end) == text.count(end)


def test_words_between_blanks_are_cells_too() -> None:
    text = "t  x   y\n0  1.0   2.0  \n 1  3.0 4.0\n"
    edits = cell_edits(text, read_table(text), [0, 1], {"y": NewColumn(np.array([7.0, 8.0]), 0)})
    assert edited(text, edits) == "t  x   y\n0  1.0   7.0  \n 1  3.0 8.0\n"
