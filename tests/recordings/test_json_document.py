"""JSON of any maker: one document or one a line, and what is no number."""

import math

import pytest

from hhsim.errors import TrajectoryError
from hhsim.recordings.json_document import keys_of, number, read_json, vector


def test_one_document_or_one_a_line() -> None:
    assert read_json('{"a": 1}') == {"a": 1}
    assert read_json('{"a": 1}\n\n{"a": 2}\n') == [{"a": 1}, {"a": 2}]
    for text, words in (("{", "not JSON"), ("[" * 100_000, "not JSON"), ('{"a": 1}\n{"a"', "line 2 is not JSON")):
        with pytest.raises(TrajectoryError, match=words):
            read_json(text)


def test_what_is_no_number_is_missing() -> None:
    assert number(3) == 3.0
    for value in (True, "3", None, 10**400, [1]):
        assert math.isnan(number(value))
    assert vector([1, 2, 3]) == vector({"z": 3, "y": 2, "x": 1}) == [1.0, 2.0, 3.0]
    assert all(map(math.isnan, vector([1, 2]))) and len(vector([1, 2], "wxyz")) == 4


def test_what_a_document_holds_is_said_briefly() -> None:
    assert keys_of({"b": 1, "a": 2}) == "an object with b, a"
    assert keys_of([{"t": 0}]) == "a list of 1, the first an object with t"
    assert keys_of([]) == "an empty list" and keys_of({}) == "an object with nothing" and keys_of("x" * 90)[-1] == "x"
