"""Results of all kinds of scenes: faults that are caught or named, and a walk over all that a file holds."""

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
from conftest import Run
from file_faults import Fault, at, attribute, with_name
from planted_faults import failing, planted
from sampled import first_of_each, sampled

from hhsim.errors import InputError
from hhsim.result.reader import Result, load_result
from hhsim.verify.claim import NOT_JUDGED
from hhsim.verify.coverage import items, judges
from hhsim.verify.verify import Verification, verify

MESH = ("--surface", "mesh")
SCENES: dict[str, tuple[str, ...]] = {
    "fixed": ("cube", "grasp"),
    "driven": ("cube", "carry"),
    "free": ("cube", "lift", "--free", *MESH),
    "laptop": ("laptop", "open", *MESH),
    "door": ("door", "swing", *MESH),
    "chest": ("chest", "lift", *MESH),
    "two": ("cube", "lift-both", "--hands", "both", "--free", *MESH),
    "two at a laptop": ("laptop", "close", "--hands", "both", *MESH),
}
"""Arguments of `hhsim replay`, at 25 ticks a second."""
LATE = 55
"""A tick in which hands hold."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    folder = tmp_path_factory.mktemp("scenes")
    main = importlib.import_module("hhsim.cli.main").main

    @cache
    def replayed(scene: str) -> Path:
        path = folder / f"{scene}.h5"
        words = ("--rate", "25", "--level", "3", "--out", str(path), "--quiet")
        with patch("sys.argv", ["hhsim", "replay", *SCENES[scene], *words]), pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code in (0, None)
        return path

    return replayed


def verified(result: Result) -> Verification:
    """Verdicts on the last hand of a result, and on all bodies."""
    # What the tick after a sampled one begins with is judged there: that of `LATE` is.
    return verify(list(result.hands.values())[-1], every=(LATE - 1) // 2)


@pytest.fixture(scope="module")
def honest(made: Callable[[str], Path]) -> Callable[[str], Verification]:
    return cache(lambda scene: verified(load_result(made(scene))))


def named(found: Verification) -> set[str]:
    """Items that the verdict names as not judged."""
    (claim,) = [claim for claim in found.claims if claim.name == "unjudged"]
    assert claim.verdict == NOT_JUDGED
    return set(claim.note.split(", "))


@pytest.mark.parametrize("scene", sampled(SCENES, lambda place, _: place < 1))
def test_an_honest_result_passes_and_names_what_nothing_judges(
    honest: Callable[[str], Verification], made: Callable[[str], Path], scene: str
) -> None:
    found = honest(scene)
    assert not failing(found)
    made_claims = {claim.name for claim in found.claims if claim.verdict != NOT_JUDGED}
    of_file = items(list(load_result(made(scene)).hands.values())[-1])
    assert {item for item in of_file if not judges(item) & made_claims} == named(found)
    assert {"@machine", "scene.motion_source"} <= named(found)


STRANGERS = {
    "jf-slider-s": ("--surface", "spheres", "--level", "2", "--ticks", "150"),
    "jf-hinge-limits": ("--surface", "mesh", "--ticks", "580"),
}
"""Hands that spread their fingers in contact, and a leaf at its limit whose last program takes a turn back."""


@pytest.mark.slow
@pytest.mark.parametrize("name", STRANGERS)
def test_an_honest_run_of_a_stranger_passes(run: Run, shared_data: Path, tmp_path: Path, name: str) -> None:
    folder, out = shared_data / "field" / "inputs" / "honest", str(tmp_path / "run.h5")
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    inputs = (str(folder / f"{name}.toml"), str(folder / f"{name}.motion.h5"), "--place-object", "recorded")
    assert run("replay", *inputs, *STRANGERS[name], "--out", out, "--quiet").code in (0, None)
    assert not failing(verified(load_result(Path(out))))


# Faults, each in a scene; what is named is given as the item, with its point or its @.


def of_label(name: str, change: Callable[[dict[str, Any]], object]) -> Fault:
    """Change the labels of the scene that all hands have."""

    def fault(file: h5py.File) -> None:
        scene = json.loads(file.attrs["scene"])
        change(scene)
        file.attrs["scene"] = json.dumps(scene)

    return with_name(name, fault)


def of_body(name: str, body: str, change: Callable[[dict[str, Any]], object]) -> Fault:
    """Change the physical properties, or the joint, of a body."""

    def fault(file: h5py.File) -> None:
        properties = json.loads(file[f"bodies/{body}"].attrs["properties"])
        change(properties)
        file[f"bodies/{body}"].attrs["properties"] = json.dumps(properties)

    return with_name(name, fault)


def kind(name: str, body: str, said: str) -> Fault:
    return attribute(name, f"bodies/{body}", "kind", lambda _: said)


def shape(name: str, body: str, change: Callable[[Any], Any]) -> Fault:
    """Change the mesh of a body, and the checksums with it."""
    return at(name, f"bodies/{body}/mesh/vertices", ..., change)


def late_hand(file: h5py.File) -> None:
    """The left hand's rows three ticks late."""
    for path, item in _datasets(file["hands/left/tick"]):
        item[3:] = item[:-3]
        assert path


def _datasets(group: h5py.Group) -> list[tuple[str, h5py.Dataset]]:
    found: list[tuple[str, h5py.Dataset]] = []
    group.visititems(lambda path, item: found.append((path, item)) if isinstance(item, h5py.Dataset) else None)
    return found


def frozen(name: str, body: str, *columns: str) -> Fault:
    def fault(file: h5py.File) -> None:
        for column in columns:
            file[f"bodies/{body}/tick/{column}"][...] = file[f"bodies/{body}/tick/{column}"][0]

    return with_name(name, fault)


def of_left_contact(name: str, column: str, change: Callable[[Any], Any]) -> Fault:
    """Change the contact of the left hand that bears most, or slips most."""

    def fault(file: h5py.File) -> None:
        a, most = file["contact/a"][...], file["contact/slip" if column == "slip" else "contact/normal_force"][...]
        row = int(np.where((a >= 16) & (a < 32), most, -1.0).argmax())
        file[f"contact/{column}"][row] = change(file[f"contact/{column}"][row])

    return with_name(name, fault)


def moved_along(file: h5py.File) -> None:
    """The user's hand and the shown one aside, in ticks in which nothing touches."""
    for name in ("haptic/position", "graphic/position", "graphic/joints"):
        file[f"hands/right/tick/{name}"][3] += 1e-4


FAULTS: dict[str, dict[Fault, str]] = {
    "two": {
        at("nearer hands", "tick/between/graphic", LATE, lambda x: x - 1e-3): "between hands",
        at("hands in each other", "tick/between/haptic", LATE, lambda x: -x): "between hands",
        at("hands nowhere", "tick/between/graphic", LATE, lambda x: np.nan): "between hands",
        of_label("hands that meet", lambda scene: scene.update(hands_apart=False)): "scene",
        with_name("late hand", late_hand): "between hands",
        attribute("stopped", "/", "complete", lambda _: 0): "complete",
        of_left_contact("forged point", "point", lambda x: x + 1e-3): "hand on object",
        of_left_contact("forged force", "normal_force", lambda x: 1.1 * x + 0.01): "hand on object",
        of_left_contact("no slip", "slip", lambda x: 0.0): "sticks",
        of_left_contact("turned friction", "friction_force", lambda x: -x): "hand on object",
        at("left hand eased", "hands/left/tick/force/total", LATE, lambda x: 0.9 * x): "equal and opposite",
        of_body("lighter", "cube", lambda of: of.update(mass=0.98 * of["mass"])): "Newton",
        of_body("other table", "cube", lambda of: of.update(table=of["table"] - 1e-5)): "table",
        at("thrown", "bodies/cube/tick/velocity", LATE, lambda x: x + 1e-4): "object velocity",
        at("spun", "bodies/cube/tick/angular_velocity", LATE, lambda x: x + 1e-4): "object angular",
        at("floating", "bodies/cube/tick/table_distance", LATE, lambda x: x + 1e-6): "table",
        at("sure of friction", "bodies/cube/tick/friction_residual", LATE, lambda x: x + 1e-2): "balanced",
        of_label("other law", lambda scene: scene.update(friction_law="Coulomb")): "scene",
    },
    "door": {
        at("leaf off its hinge", "bodies/leaf/tick/position", ..., lambda x: x + 5e-3): "hinge",
        at("leaf that jumps", "bodies/leaf/tick/position", LATE, lambda x: x + 5e-3): "object velocity",
        of_body("wider limits", "leaf", lambda of: of["hinge"].update(limits=[-1.7, 1.7])): "bodies as declared",
        of_body("smooth hinge", "leaf", lambda of: of["hinge"].update(friction=0.01)): "hinge",
        of_body("other axis", "leaf", lambda of: of["hinge"].update(axis=[0.0, 0.1, 1.0])): "hinge",
        of_body("other origin", "leaf", lambda of: of["hinge"].update(origin=[0.0, 0.0, 0.0])): "hinge",
        of_body("other inertia", "leaf", lambda of: of.update(inertia=np.eye(3).tolist())): "bodies as declared",
        of_body("other bearer", "leaf", lambda of: of["hinge"].update(on="stop")): "bodies as declared",
        of_body("rougher", "leaf", lambda of: of.update(friction=0.9)): "bodies as declared",
        of_body("torsion", "leaf", lambda of: of.update(torsion=0.01)): "bodies as declared",
        shape("post elsewhere", "post", lambda x: x + [5e-3, 0.0, 0.0]): "bodies as declared",
        shape("thinner post", "post", lambda x: x * [0.9, 1.0, 1.0]): "bodies as declared",
        at("post that jumps", "bodies/post/tick/position", LATE, lambda x: x + 0.02): "scene",
        kind("free post", "post", "free"): "bodies as declared",
        at("helped", "bodies/leaf/tick/hand_wrench", LATE, lambda x: x + 1e-2): "hand on object",
    },
    "laptop": {
        at("other value", "bodies/lid/tick/joint", LATE, lambda x: x + 1e-3): "joints",
        at("lid that jumps", "bodies/lid/tick/position", LATE, lambda x: x + 5e-3): "joints",
        frozen("frozen lid", "lid", "position", "orientation"): "joints",
        frozen("lid and joint frozen", "lid", "position", "orientation", "joint"): "bodies as declared",
        at("lid off its hinge", "bodies/lid/tick/position", ..., lambda x: x + 5e-3): "bodies as declared",
        shape("thinner lid", "lid", lambda x: x * [1.0, 1.0, 0.8]): "bodies as declared",
        at("base that jumps", "bodies/base/tick/position", LATE, lambda x: x + 0.02): "joints",
        of_body("lid beyond its limits", "lid", lambda of: of["joint"].update(limits=[2.2, 2.4])): "joints",
        of_body("lid of wider limits", "lid", lambda of: of["joint"].update(limits=[0.0, 3.0])): "bodies as declared",
        of_body("lid the other way", "lid", lambda of: of["joint"].update(axis=[1.0, 0.0, 0.0])): "joints",
        of_body("hinge elsewhere", "lid", lambda of: of["joint"].update(origin=[0.0, 0.0, 0.0])): "joints",
        of_body("lid on the world", "lid", lambda of: of["joint"].update(on="")): "bodies as declared",
        of_body("lid that slides", "lid", lambda of: of["joint"].update(type="slider")): "joints",
        of_label("own parts", lambda scene: scene["solver"].update(self_contact=True)): "scene",
        of_label("friction modelled", lambda scene: scene["modelled"].update(not_modelled=["deformation"])): "scene",
        kind("still lid", "lid", "fixed"): "scene",
    },
    "driven": {
        of_label("said to be still", lambda scene: scene.update(object_pose="fixed")): "carried",
        at("nudged", "bodies/cube/tick/position", LATE, lambda x: x + 1e-6): "carried",
        at("opposite quaternion", "bodies/cube/tick/orientation", LATE, lambda x: -x): "body poses",
        at("begun elsewhere", "bodies/cube/position", 0, lambda x: x + 1e-6): "body at first",
    },
    "fixed": {
        with_name("other unit", lambda file: file["tick/time"].attrs.update(units="ms")): "columns",
        with_name("other words", lambda file: file["hands/right/tick/lag"].attrs.update(long_name="none")): "columns",
        kind("cube said to move", "cube", "driven"): "scene",
        of_label("larger budget", lambda scene: scene["solver"].update(budget=1)): "scene.solver.budget",
        of_label("other placement", lambda scene: scene.update(placement={"found": 1})): "scene.placement.found",
        attribute("other machine", "/", "machine", lambda _: '{"cpu": "faster"}'): "@machine",
        attribute("other command", "/", "command", lambda _: '["hhsim"]'): "@command",
        with_name("moved along", moved_along): "@packages",
    },
    "chest": {
        at(
            "tray not as recorded", "bodies/tray/tick/recorded_position", LATE, lambda x: x + 1e-5
        ): "bodies as declared",
        at("lid off the chest", "bodies/lid/tick/position", 5, lambda x: x + 1e-4): "joint",
        of_body("lid of other limits", "lid", lambda of: of["hinge"].update(limits=[-1.7, 0.0])): "bodies as declared",
        at("unequal", "bodies/lid/tick/body_wrench", LATE, lambda x: x + 1e-2): "between bodies",
        at("chest in the tray", "bodies/chest/tick/position", 2, lambda x: x - [0.0, 0.0, 1e-4]): "bodies apart",
    },
    "two at a laptop": {
        at("later hands", "tick/between/haptic", 3, lambda x: x + 1e-6): "between hands",
        at("lid for nobody", "bodies/lid/tick/orientation", LATE, lambda x: x[[0, 2, 1, 3]]): "joints",
    },
}
"""What finds each fault, by scenes: a claim, or the item that is named as not judged."""
BY_SCENE = {(scene, fault): claim for scene, faults in FAULTS.items() for fault, claim in faults.items()}


@pytest.mark.parametrize(
    ("scene", "fault"), first_of_each(BY_SCENE), ids=lambda value: getattr(value, "__name__", value)
)
@pytest.mark.quick(
    "two-nearer hands", "driven-said to be still", "fixed-larger budget", "fixed-other placement", "fixed-moved along"
)
def test_a_planted_fault_is_caught_or_named(
    made: Callable[[str], Path], honest: Callable[[str], Verification], tmp_path: Path, scene: str, fault: Fault
) -> None:
    claim = BY_SCENE[scene, fault]
    found = verified(planted(made(scene), tmp_path, fault))
    if claim.startswith(("@", "scene.")):
        assert claim in named(found)
    else:
        assert claim in failing(found) - failing(honest(scene))


def test_there_are_sixty_faults_over_all_kinds_of_scenes() -> None:
    assert len(BY_SCENE) >= 60 and len({fault.__name__ for _, fault in BY_SCENE}) == len(BY_SCENE)


# The walk: an item that is made larger, or smaller, or another word, is caught by one of the claims that judge it.

WALKED = ("fixed", "driven", "free", "laptop", "door", "two")
MARGIN, STEPS, OFF_MESH = "scene.solver.margin", "scene.solver.linearisations", "summary@contact_error_max"
NOT_REACHED = {
    "free": {MARGIN},
    "laptop": {MARGIN, STEPS, "hand/tick/contacts/candidates", "hand/tick/work/bodies"},
    "door": {STEPS, OFF_MESH},
    "two": {MARGIN, OFF_MESH},
}
"""Limits that no sampled tick of a scene comes to, and counts that are judged at rest: another one is as true there."""
LOADED = {"hand/tick/duration/total_cpu"}
"""Judged by the time of the wall, which on a machine with much to do is much longer."""


def changes(path: Path, judged: set[str]) -> Iterator[tuple[str, Fault]]:
    """Yield changes of each judged dataset, attribute and label of a file, with the item that each is of."""
    hand = list(load_result(path).hands.values())[-1].name
    with h5py.File(path) as file:
        bodies = json.loads(file["bodies"].attrs["names"])
        for item in sorted(judged):
            if item.startswith(("scene.", "body.")):
                yield from ((item, partial(_change_label, hand, bodies, item, up)) for up in (True, False))
                continue
            name, _, key = item.partition("@")
            places = [f"bodies/{body}{name.removeprefix('body')}" for body in bodies] if name.startswith("body") else []
            places += [name.replace("hand", f"hands/{hand}", 1) if name.startswith("hand") else name or "/"]
            places += [f"summary/{hand}"] if name == "summary" else []
            place = next(one for one in places if one in file and (not key or key in file[one].attrs))
            for up in (True, False):
                if key:
                    yield item, attribute(item, place, key, partial(other, up=up))
                elif len(file[place]):
                    row = min(LATE, len(file[place]) - 1)
                    yield item, at(item, place, row, partial(_other_number, file[place].dtype, up))


OTHER_WORDS = {"kkt": "paper", "coupled": "progressive", "spheres": "mesh", "mesh": "spheres"}
"""What an option could have been, too."""


def other(value: Any, up: bool = True) -> Any:
    """Return another value of the same type."""
    if isinstance(value, bool | np.bool_):
        return not value
    if isinstance(value, str | bytes | None):
        return OTHER_WORDS.get(str(value), "other")
    if isinstance(value, list):
        return [other(one, up) for one in value] or ["other"]
    if isinstance(value, Mapping):
        return {"other": 1}
    if isinstance(value, int | np.integer):
        return 1 - value if value in (0, 1) else value + (1 if up else -1)
    # A tenth of what is rounding would be rounding, too.
    return 1.0 if np.isnan(value) else (1.1 if up else 0.9) * (value if abs(value) > 1e-9 else 1.0)


def _other_number(dtype: np.dtype[Any], up: bool, value: Any) -> Any:
    if dtype.kind in "SO":
        return b"other"
    if dtype.kind == "u":
        return 1 - value
    if dtype.kind == "i":
        return 2 * value + 1_000_000 if up else value // 2 - 1
    # What lies infinitely far off would stay there.
    return np.where(np.isinf(value), 1.0, 1.01 * np.asarray(value) + (1e-3 if up else -1e-3))


def _change_label(hand: str, bodies: list[str], item: str, up: bool, file: h5py.File) -> None:
    whose, *path = item.split(".")
    places = [(file[f"bodies/{body}"], "properties") for body in bodies] if whose == "body" else []
    places += [(file, "scene"), (file[f"hands/{hand}"], "scene")] if whose == "scene" else []
    for group, key in places:
        document = json.loads(group.attrs[key])
        try:
            last = document
            for name in path[:-1]:
                last = last[name]
            last[path[-1]] = other(last[path[-1]], up)
        except (KeyError, TypeError):
            continue
        group.attrs[key] = json.dumps(document)
        return


@pytest.mark.parametrize("scene", sampled(WALKED, lambda place, _: False))
def test_each_judged_item_is_judged(
    made: Callable[[str], Path], honest: Callable[[str], Verification], tmp_path: Path, scene: str
) -> None:
    path = made(scene)
    judged = items(list(load_result(path).hands.values())[-1]) - named(honest(scene))
    caught: set[str] = set()
    for item, change in changes(path, judged):
        if item not in caught:
            try:
                verdict = verified(planted(path, tmp_path, with_name(item, change)))
                # What can be judged no more is named.
                found = failing(verdict) & judges(item) | named(verdict) & {item}
            except (InputError, ValueError, KeyError):
                # A file of this is refused as damaged.
                found = {item}
            caught |= {item} if found else set()
    assert " ".join(sorted(judged - caught - LOADED - NOT_REACHED.get(scene, set()))) == ""
