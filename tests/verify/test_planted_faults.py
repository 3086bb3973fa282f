"""Faults planted in results of all kinds are named by a check, and honest results of the same kinds pass."""

import importlib
import json
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import h5py
import numpy as np
import pytest
from conftest import sampled
from fault_table import AGAIN, FAULTS, LATE, PROGRAMS, WORDS
from file_faults import Fault, at, attribute, with_name
from planted_faults import failing, planted

from hhsim.errors import InputError
from hhsim.result.reader import load_result
from hhsim.verify.free_object_checks import free_claims
from hhsim.verify.second_run import OF_A_MACHINE, OF_NO_RUN, is_measured
from hhsim.verify.verify import physics, verify

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    folder = tmp_path_factory.mktemp("results")
    main = importlib.import_module("hhsim.cli.main").main

    @cache
    def result(kind: str) -> Path:
        path = folder / f"{kind}.h5"
        if kind in PROGRAMS:
            PROGRAMS[kind](path)
            return path
        given = [str(result(word[1:-1])) if word.startswith("{") else word for word in WORDS[kind]]
        words = ["hhsim", "replay", *given, "--out", str(path), "--quiet"]
        with patch("sys.argv", words), pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code in (0, None)
        return path

    return result


@pytest.mark.parametrize("kind", sampled([*WORDS, *PROGRAMS], lambda _, kind: kind == "two"))
def test_an_honest_result_passes(made: Callable[[str], Path], kind: str) -> None:
    found = verify(load_result(made(kind)), every=LATE)
    assert not failing(found)
    again = next(claim for claim in found.claims if claim.name == AGAIN)
    assert again.verdict == "holds" and again.checked > 250
    # A program may describe what it likes, and run a part of a file of bodies.
    assert kind in PROGRAMS or "which nothing else shows" not in again.note


BY_KIND = [(kind, fault, check) for kind, faults in FAULTS.items() for fault, check in faults.items()]
FIRST = {check: fault for kind, fault, check in reversed(BY_KIND) if kind != "halves"}


@pytest.mark.parametrize(
    ("kind", "fault", "check"),
    sampled(BY_KIND, lambda _, case: case[1] in FIRST.values()),
    ids=lambda value: getattr(value, "__name__", value),
)
def test_a_planted_fault_is_named(
    made: Callable[[str], Path], tmp_path: Path, kind: str, fault: Fault, check: str
) -> None:
    result = planted(made(kind), tmp_path, fault)
    claims = free_claims(result) if len(result.hands) == 1 else []
    if check not in {claim.name for claim in claims if claim.failed}:
        # The scene is run again only for what nothing else shows.
        claims = [*(verify if check == AGAIN else physics)(result, every=LATE).claims]
    claim = next(claim for claim in claims if claim.name == check and claim.failed)
    assert not claim.worst <= claim.tolerance


def test_each_fault_has_a_name() -> None:
    assert len(BY_KIND) > 90 and len({(kind, fault.__name__) for kind, fault, _ in BY_KIND}) == len(BY_KIND)


# The walk: an item that is made larger, or smaller, or another word.

OTHER_WORDS = {"kkt": "paper", "coupled": "progressive", "spheres": "mesh", "mesh": "spheres"}
"""What an option could have been, too."""
STEERS = {
    *(f"scene.solver.{name}" for name in ("budget", "linearisations", "margin", "skin", "contact_response", "qp")),
    *(f"scene.solver.{name}" for name in ("snap_speed", "response", "frustum_ends", "threads", "tolerance", "touch")),
    *("scene.solver.stiffness.penalty", "scene.solver.stiffness.contact", "scene.solver.period", "scene.seed"),
    *("scene.samples", "scene.place_object", "scene.trajectory", "scene.object", "scene.tree", "scene.hand_file"),
}
"""Labels whose change need not change a run: options that bound or steer it, and words that then name nothing."""


def changes(path: Path) -> Iterator[tuple[str, Fault]]:
    """Yield changes of each dataset, figure and label that a run writes, with the item that each is of."""
    with h5py.File(path) as file:
        items: list[str] = []
        file.visit(items.append)
        for item in items:
            dataset = file[item] if isinstance(file[item], h5py.Dataset) else None
            if dataset is not None and len(dataset) and "/duration/" not in item:
                row = min(LATE, len(dataset) - 1)
                yield item, at(item, item, row, partial(_other_number, dataset.dtype))
            for name, value in file[item].attrs.items():
                if name in ("scene", "properties"):
                    labels = sorted({*_labels(json.loads(value))} - OF_A_MACHINE)
                    yield from ((f"{name}.{label}", partial(_change_label, item, name, label)) for label in labels)
                elif not is_measured(name):
                    yield f"{item}@{name}", attribute(name, item, name, other)
        for label in sorted({*_labels(json.loads(file.attrs["scene"]))} - OF_A_MACHINE):
            yield f"scene.{label}", partial(_change_label, "/", "scene", label)
        yield from ((f"@{name}", attribute(name, "/", name, other)) for name in file.attrs if name not in OF_NO_RUN)


def _labels(stated: Mapping[str, Any], before: str = "") -> Iterator[str]:
    for name, value in stated.items():
        if isinstance(value, Mapping) and value:
            yield from _labels(value, f"{before}{name}.")
        else:
            yield f"{before}{name}"


def other(value: Any) -> Any:
    """Return another value of the same type."""
    if isinstance(value, bool | np.bool_):
        return not value
    if isinstance(value, str | bytes | None):
        return OTHER_WORDS.get(str(value), "other")
    if isinstance(value, list):
        return [other(one) for one in value] or ["other"]
    if isinstance(value, Mapping):
        return {"other": 1}
    if isinstance(value, int | np.integer):
        return 1 - value if value in (0, 1) else value + 1
    return 1.0 if np.isnan(value) else 1.1 * (value if abs(value) > 1e-9 else 1.0)


def _other_number(dtype: np.dtype[Any], value: Any) -> Any:
    if dtype.kind in "SO":
        return b"other"
    if dtype.kind in "iu":
        return 1 - value if dtype.kind == "u" else value + 1
    return np.where(np.isfinite(value), np.nextafter(value, np.inf), 1.0)


def _change_label(group: str, key: str, label: str, file: h5py.File) -> None:
    document = json.loads(file[group].attrs[key])
    last, path = document, label.split(".")
    for name in path[:-1]:
        last = last[name]
    last[path[-1]] = other(last[path[-1]])
    file[group].attrs[key] = json.dumps(document)


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["fixed", "driven", "free", "laptop", "door", "two"])
def test_each_item_that_a_run_writes_is_judged(made: Callable[[str], Path], tmp_path: Path, kind: str) -> None:
    missed = set()
    for item, change in changes(made(kind)):
        try:
            found = failing(verify(planted(made(kind), tmp_path, with_name(item, partial(change))), every=LATE))
        except (InputError, ValueError, KeyError):
            # A file of this is refused as damaged.
            found = {"refused"}
        missed |= set() if found else {item}
    assert missed <= STEERS
