"""Tables of text: what they may be like, and what a strict reader refuses that another counts as missing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.errors import HhsimError
from hhsim.motion.csv_table import NewColumn, edited, read_table


def test_tables_of_many_makers() -> None:
    texts = ("a,b\n1,2\n", "a;b\n1;2\n", "a\tb\n1\t2\n", "a b\n1  2\n", "# by: me\n\na , b\r\n1,2\r\n", "a,b\n1,2\n3")
    for text in texts:
        table = read_table(text)
        values, broken = table.numbers(["b", "a"])
        assert table.header == ("a", "b") and values.tolist() == [[2.0, 1.0]] and broken == 0
    assert read_table("# by: me\na\n1\n").remarks == {"by": "me"}


@pytest.mark.parametrize("sign", [";", "\t", " "])
def test_decimal_commas_are_found_where_no_comma_parts_cells_and_told(sign: str) -> None:
    for text in ("\ufeffa;b;c\r\n3;-2,5e1;x, y\r\n1,5;2;z\r\n", "a;b\n3;-25\n1,5;2\n", "a;b\n3;-25,0\n1,50;2,\n"):
        table = read_table(text.removeprefix("\ufeff").replace(", ", ",").replace(";", sign))
        assert table.numbers(["a", "b"])[0].tolist() == [[3.0, -25.0], [1.5, 2.0]]
        assert table.notes[0].startswith("decimal commas") and table.decimal == ","
    if sign != " ":
        bare = f"0,5{sign}1{sign}-1,25\n1,5{sign}2{sign}2,75\n"
        table = read_table(bare, names=("a", "b", "c"))
        assert table.numbers(["a", "b", "c"])[0].tolist() == [[0.5, 1.0, -1.25], [1.5, 2.0, 2.75]]
        with pytest.raises(HhsimError, match="no header line"):
            read_table(bare)


def test_a_sample_is_no_header() -> None:
    with pytest.raises(HhsimError, match="no header line"):
        read_table("0.5,1,1\n1.5,2,2\n")
    assert read_table("0,1,2\n1.5,2,2\n").header == ("0", "1", "2"), "as pandas names columns without names"
    assert len(read_table("0.5 1\n1.5 2\n", names=("a", "b")).rows) == 2


def test_what_cannot_be_read_is_missing_and_counted_or_refused() -> None:
    text = "a,b\n" + "1,2\n" * 8 + "x,2\n1,2,3\n1,nan\n1,\n1_0,2\n1,2"
    table = read_table(text)
    values, broken = table.numbers(["a", "b"])
    assert len(values) == 12 and broken == 2 and np.isnan(values).sum() == 4
    assert [sentence[:20] for sentence in table.notes] == ["line 15, the last on", "1 line with another "]
    with pytest.raises(HhsimError, match="line 11 has 3 values; expected 2"):
        read_table(text, strict=True)
    with pytest.raises(HhsimError, match="line 10: a is 'x'; expected a number"):
        read_table(text.replace("1,2,3\n", ""), strict=True).numbers(["a"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# only: remarks\n", "no header line"),
        ("a,b\n", "no line below the header"),
        ("a,a\n1,2\n", "column a twice"),
        ("a,b\n1\n2\n3,4\n", "line 2 has 1 value; expected 2"),
        ("a;b\n0,5;1.5\n0,6;2.5\n", "line 2: a is '0,5'; expected a number with a decimal point"),
        ('a,b\n"0,5",1\n"0,6",2\n', "line 2: a is '0,5'; expected a number with a decimal point"),
        ("c,b\n1,1\n1,2\n", "unknown column 'a'"),
    ],
)
def test_what_is_no_table_is_refused(text: str, words: str) -> None:
    with pytest.raises(HhsimError, match=words):
        read_table(text).numbers(["a"])


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
        ("1,50", 2.25, 1, "2,25"),
    ],
)
def test_a_number_keeps_its_decimals_or_gets_those_it_needs(old: str, value: float, decimals: int, new: str) -> None:
    text = f"a;b\n{old};x\n"
    table = read_table(text)
    assert edited(text, table, [0], {"a": NewColumn(np.array([value]), decimals)}) == f"a;b\n{new};x\n"


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
    made = edited(text, table, picked, {name: NewColumn(new, 12)})
    again = read_table(made)
    for k, (one, other) in enumerate(zip(table.rows, again.rows, strict=True)):
        assert [cell for j, cell in enumerate(one) if j != column] == [c for j, c in enumerate(other) if j != column]
        if k not in picked:
            assert one == other
    assert np.allclose(again.numbers([name])[0][picked, 0], new, atol=1e-12)
    assert made.count(end) == text.count(end)


def test_words_between_blanks_are_cells_too() -> None:
    text = "t  x   y\n0  1.0   2.0  \n 1  3.0 4.0\n"
    new = {"y": NewColumn(np.array([7.0, 8.0]), 0)}
    assert edited(text, read_table(text), [0, 1], new) == "t  x   y\n0  1.0   7.0  \n 1  3.0 8.0\n"
