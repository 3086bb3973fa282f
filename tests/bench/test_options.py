"""What the suites refuse before the work: unknown names, numbers out of range, paths that cannot be."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from conftest import Run

from hhsim.bench.paper.bench import PaperOptions
from hhsim.bench.peers import PeersOptions
from hhsim.bench.robustness.random_targets import StressOptions
from hhsim.bench.speed_error import SpeedErrorOptions
from hhsim.bench.trees import TreesOptions
from hhsim.errors import InputError, UnknownNameError

UNKNOWN: tuple[tuple[type, str, str, str], ...] = (
    (SpeedErrorOptions, "objects", "buny", "unknown object 'buny': did you mean bunny"),
    (SpeedErrorOptions, "motions", "grip", "unknown trajectory 'grip'"),
    (SpeedErrorOptions, "methods", "couple", "unknown method 'couple': did you mean coupled"),
    (SpeedErrorOptions, "backends", "quadprg", "unknown QP solver 'quadprg'"),
    (SpeedErrorOptions, "surfaces", "mash", "unknown surface 'mash': did you mean mesh"),
    (TreesOptions, "objects", "bunyn", "bunny"),
    (PaperOptions, "methods", "best", "best"),
    (PaperOptions, "objects", "mug", "mug"),
)
IMPOSSIBLE: tuple[tuple[type, dict[str, Any], str], ...] = (
    (SpeedErrorOptions, {"motions": ("never",)}, "'never' touches nothing"),
    (SpeedErrorOptions, {"levels": (6,)}, "whole number from 1 to 5"),
    (SpeedErrorOptions, {"surfaces": (), "methods": ("coupled",)}, "surfaces = .*at least one name"),
    (SpeedErrorOptions, {"surfaces": ("mesh",), "methods": ("coupled", "paper")}, "takes the surface spheres"),
    (PeersOptions, {"motions": ("never",)}, "touches nothing"),
    (PeersOptions, {"objects": ()}, "objects = .*at least one name"),
    (TreesOptions, {"spheres": (40_000,)}, "32768"),
    (PaperOptions, {"methods": ()}, "methods = .*at least one name"),
    (PaperOptions, {"repetitions": 0}, "repetitions = 0"),
    (PaperOptions, {"threads": 6}, "= 6; expected a whole number from 1 to 5"),
    (StressOptions, {"hold": 0}, "hold"),
    (StressOptions, {"bound": "finger"}, "unknown bound 'finger': known: hand, none, palm"),
    (StressOptions, {"flexion_range": (0.5, 1.5)}, "flexion_range"),
    (StressOptions, {"flexion_range": (0.6, 0.5)}, "flexion_range"),
)
COMMANDS = (
    ("stress --surface mesh --method paper", "method paper takes the surface spheres, not mesh: "),
    ("stress bunyn", "unknown object 'bunyn': did you mean bunny?"),
    ("speed-error --motion never", "touches nothing"),
    ("speed-error --level 0", "expected whole numbers from 1 to 5"),
    ("speed-error --out none/a.h5", "there is no folder"),
    ("stress --out x.csv", "x.csv must end in .h5: the CSV file of the same name goes beside it"),
    ("hard fast-swip", "unknown hard case 'fast-swip': did you mean fast-swipe?"),
    ("hard flat-finger", "hard case 'flat-finger' is made of triangles alone: it takes --surface mesh"),
    ("hard --method couple", "unknown method 'couple': did you mean coupled?"),
    ("trees --plot a.h5", "no picture by its ending"),
    ("paper --quick --plot thesis.parquet", "thesis.parquet"),
    ("recorded nowhere", "nowhere: no such file or folder"),
)


@pytest.mark.parametrize(("options", "field", "name", "message"), UNKNOWN)
def test_an_unknown_name_is_refused(options: type, field: str, name: str, message: str) -> None:
    assert field in {one.name for one in fields(options)}
    with pytest.raises(UnknownNameError, match=message):
        options(**{field: (name,)})


@pytest.mark.parametrize(("options", "values", "message"), IMPOSSIBLE)
def test_impossible_values_are_refused(options: type, values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        options(**values)


@pytest.mark.parametrize(("words", "message"), COMMANDS)
def test_a_command_refuses_before_the_work(run: Run, tmp_path: Path, words: str, message: str) -> None:
    (tmp_path / "thesis.parquet").write_text("no programs")
    answer = run("bench", *words.split())
    assert (answer.code, answer.out) == (2, "") and message in answer.err
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["thesis.parquet"]
