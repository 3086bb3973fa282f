"""Golden runs: 40 scenes of all kinds, kept small, that judge every change of the engine.

    python -m tools.golden                              what moved, and by how much; exit code 1 where anything did
    python -m tools.golden --write                      keep what is made now
    python -m tools.golden --against OTHER/bin/python   p50 and p99 of a tick in contact, in turns with another hhsim

A kept run has a digest of each dataset of its ticks but for the times, and poses, forces, depth and status at some of
its ticks in contact. Where no digest differs, nothing moved by a bit. Where one does, the change has to be within the
limits: at rest (where the user's hand stands still) poses within 1 µm and forces within 1 %; no deeper, no more stuck
ticks and no more with lag. Other ticks may end elsewhere, and the table says how far.
"""

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from cli.console import print_table
from hhsim.system.hdf5_input import open_hdf5
from hhsim.table.table import Table, number, words

ROOT = Path(__file__).resolve().parent.parent
GOLDEN = ROOT / "tests" / "golden"
SCENES = {
    "bunny-touch": "bunny touch",
    "bunny-grasp": "bunny grasp",
    "bunny-grasp-mesh": "bunny grasp --surface mesh",
    "bunny-grasp-level-3": "bunny grasp --level 3",
    "bunny-ears-progressive": "bunny ears --method progressive",
    "bunny-sequence-threads": "bunny sequence --method progressive --threads 2",
    "cube-pinch-mesh": "cube pinch --surface mesh",
    "cube-pinch-paper": "cube pinch --method paper",
    "cylinder-whole-hand-penalty": "cylinder whole-hand --method penalty",
    "rock-whole-hand-tremor": "rock whole-hand --tremor 0.2,0.3",
    "rock-whole-hand-progressive": "rock whole-hand --method progressive --surface mesh",
    "rock-from-above-paper": "rock from-above --method paper --frustum-ends flat",
    "teapot-slide": "teapot slide",
    "teapot-slide-mesh": "teapot slide --surface mesh",
    "teapot-knob-eq-14": "teapot knob --force paper",
    "cup-handle": "cup handle --fingers thumb,middle",
    "cup-handle-stiff": "cup handle --surface mesh --stiffness 3000,2,1",
    "shamrock-leaf-one": "shamrock leaf --linearisations 1",
    "cube-grasp-budget": "cube grasp --budget 1500",
    "rock-grasp-clarabel": "rock grasp --qp clarabel --ticks 500",
    "sphere-whole-hand-left": "sphere whole-hand --hand left --self-contact on",
    "cube-whole-hand-self-mesh": "cube whole-hand --surface mesh --self-contact on",
    "two-hands-teapot": "teapot grasp --hands both --tremor 0.2,0.3",
    "two-hands-progressive": "bunny grasp --hands both --method progressive",
    "carry-driven": "bunny carry",
    "finger-tap-recorded": "bunny finger-tap --rate 1000",
    "grab-recorded": "examples/mug.stl examples/grab.csv --unit mm --place-object auto --level 3",
    "free-lift": "cube lift --free --torsion 5 --surface mesh",
    "free-push": "cube push --free --surface mesh",
    "free-bunny-self": "bunny lift --free --self-contact on",
    "free-slip": "cube slip --free --torsion 5",
    "free-lift-both": "cube lift-both --hands both --free",
    "free-hand-over": "cup hand-over --hands both --free --surface mesh",
    "door-swing": "door swing --surface mesh --level 3",
    "drawer-shut": "drawer shut",
    "peg-insert": "peg insert --surface mesh",
    "blocks-stack": "blocks stack --surface mesh --level 3",
    "laptop-close": "laptop close --surface mesh",
    "laptop-open-both": "laptop open --hands both",
    "scissors-cut": "scissors cut --level 3",
}
"""Words of `hhsim replay` by the name of a scene. Trees that are not shipped are of level 3, in a sixth of the time."""
RATE = ("--rate", "250")
"""Of a kept run, unless its words say another: a few hundred ticks, whose steps are four times longer."""
KEPT_TICKS = 40
KEPT = (
    *("graphic/position", "graphic/orientation", "graphic/flexion", "graphic/joints", "force/total"),
    *("force/fingertip_normal", "penetration_depth", "status", "contacts/touching", "position", "orientation", "path"),
)
"""Datasets whose values are kept at some ticks; of all others but the times, a digest."""
ROUNDED = "clarabel"
"""Word of a scene whose solver promises no bits: its digests may differ."""
POSE, FORCE = 1e-6, 0.01
"""Limits at rest: of poses [m], of forces as a share."""
STUCK, LAG = 1, 2

Arrays = dict[str, NDArray[Any]]


def run(name: str, out: Path, *more: str) -> None:
    """Replay a scene of `SCENES` into a result file, in this process."""
    from cli.main import hhsim

    rate = () if "--rate" in SCENES[name] else RATE
    hhsim(["replay", *SCENES[name].split(), *rate, *more, "--out", str(out), "--quiet"], standalone_mode=False)


def _ticks(file: h5py.File) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the datasets of hands and bodies that have a row a tick, but for the times."""
    found: dict[str, NDArray[Any]] = {}

    def take(path: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and "tick" in path.split("/") and "duration" not in path:
            found[path] = item[()]

    file.visititems(take)
    yield from sorted(found.items())


def keep(result: Path) -> Arrays:
    """Return what is kept of a result: `digests` as JSON, `ticks`, and values at these by their datasets' names."""
    with open_hdf5(result) as file:
        arrays = dict(_ticks(file))
    touching = sum(values > 0 for path, values in arrays.items() if path.endswith("contacts/touching"))
    at = np.flatnonzero(touching)
    at = at[np.linspace(0, len(at) - 1, min(KEPT_TICKS, len(at))).astype(int)]
    digests = {
        path: hashlib.sha256(np.ascontiguousarray(values).data).hexdigest()[:16] for path, values in arrays.items()
    }
    kept = {path: values[at] for path, values in arrays.items() if path.split("tick/")[-1] in KEPT}
    counts = {
        "depth": max((float(v.max()) for p, v in arrays.items() if p.endswith("penetration_depth")), default=0.0),
        "stuck": sum(int(((v & STUCK) != 0).sum()) for p, v in arrays.items() if p.endswith("tick/status")),
        "lag": sum(int(((v & LAG) != 0).sum()) for p, v in arrays.items() if p.endswith("tick/status")),
    }
    haptic = [values for path, values in arrays.items() if "haptic/" in path]
    still = np.all([_still(values)[at] for values in haptic], axis=0)
    facts = {"digests": digests, **counts}
    return {"facts": np.array(json.dumps(facts)), "ticks": at, "still": still, **kept}


def _still(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Ticks whose input is that of the 20 ticks before."""
    same = np.concatenate([[False], (np.diff(values.reshape(len(values), -1), axis=0) == 0.0).all(axis=1)])
    since = np.arange(len(same)) - np.maximum.accumulate(np.where(same, 0, np.arange(len(same))))
    return np.asarray(since >= 20)


def moved(kept: Mapping[str, NDArray[Any]], made: Mapping[str, NDArray[Any]]) -> dict[str, Any] | None:
    """Return how a run differs from the kept one, as a row of `table`; None where every byte is the same."""
    old, new = (json.loads(str(of["facts"])) for of in (kept, made))
    names = [
        path for path in {**old["digests"], **new["digests"]} if old["digests"].get(path) != new["digests"].get(path)
    ]
    if not names:
        return None
    row: dict[str, Any] = {
        "datasets": len(names),
        "first": names[0],
        "faults": [
            f"{word}: {old[word]} to {new[word]}" for word in ("depth", "stuck", "lag") if new[word] > old[word]
        ],
        "pose": 0.0,
        "rest": 0.0,
        "force": 0.0,
    }
    if not np.array_equal(kept["ticks"], made["ticks"]):
        row["faults"].append("other ticks in contact")
        return row
    still = kept["still"]
    for path in set(kept) & set(made) - {"facts", "ticks", "still"}:
        change = (
            np.abs(np.asarray(made[path], float) - np.asarray(kept[path], float)).reshape(len(still), -1).max(axis=1)
        )
        if path.endswith(("graphic/joints", "tick/position")):
            row["pose"] = max(row["pose"], float(np.nanmax(change, initial=0.0)))
            row["rest"] = max(row["rest"], float(np.nanmax(change[still], initial=0.0)))
        elif path.endswith("force/total"):
            size = np.linalg.norm(kept[path], axis=1)
            share = change[still] / np.maximum(size[still], 0.1)
            row["force"] = max(row["force"], float(np.nanmax(share, initial=0.0)))
    row["faults"] += ["pose at rest"] if row["rest"] > POSE else []
    row["faults"] += ["force at rest"] if row["force"] > FORCE else []
    return row


def load(name: str) -> Arrays:
    """Return the kept run of a scene."""
    with np.load(GOLDEN / f"{name}.npz") as file:
        return dict(file)


def table(rows: Mapping[str, Mapping[str, Any]]) -> Table:
    """Table of what moved, a row a scene."""
    columns = (
        words("scene"),
        number("datasets"),
        words("first"),
        number("pose", unit="mm", digits=4),
        number("pose at rest", "rest", unit="µm", digits=3),
        number("force at rest, share", "force", digits=4),
        words("beyond the limits", lambda row: "; ".join(row["faults"])),
    )
    return Table(columns, [{"scene": name, **row} for name, row in rows.items()])


def times(python: str, name: str, out: Path) -> tuple[str, NDArray[np.float64]]:
    """Replay a scene at 1 kHz with some hhsim; return its revision and its ticks' CPU time [µs], NaN out of contact."""
    command = [str(Path(python).with_name("hhsim")), "replay", *SCENES[name].split(), "--out", str(out), "--quiet"]
    if subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL, check=False).returncode not in (0, 1):
        raise RuntimeError(f"{name}: {' '.join(command)} failed")
    with open_hdf5(out) as file:
        arrays = [hand["tick"] for hand in file["hands"].values()]
        touching = sum(hand["contacts/touching"][()] > 0 for hand in arrays)
        each = np.array([hand["duration/total_cpu"][()] for hand in arrays])
        # A tick of both hands by one program is of this time as a whole in the record of each.
        spent = np.where((each == each[0]).all(axis=0), each[0], each.sum(axis=0))
        revision = str(file.attrs["git_revision"])
    return revision, np.where(touching, 1e-3 * spent, np.nan)


def compare_times(other: str, names: Sequence[str], runs: int, folder: Path) -> Iterator[dict[str, Any]]:
    """Yield p50 and p99 [µs] of each scene by another hhsim and by this one, in turns; of each tick the least time."""
    for name in names:
        found: dict[str, list[NDArray[np.float64]]] = {}
        for _ in range(runs):
            for python in (other, sys.executable):
                revision, spent = times(python, name, folder / "run.h5")
                found.setdefault(revision, []).append(spent)
        if len(found) != 2:
            raise RuntimeError(f"{other} runs this same hhsim: every result is of revision {next(iter(found))}")
        row: dict[str, Any] = {"scene": name}
        for quantile in (50, 99):
            before, after = (float(np.nanpercentile(np.min(spent, axis=0), quantile)) for spent in found.values())
            row |= {f"p{quantile}": after, f"before {quantile}": before, f"ratio {quantile}": after / before}
        yield row


def main(arguments: Sequence[str]) -> int:
    """Run the scenes and print what moved, keep them, or compare times; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.golden", description=__doc__.split("\n\n")[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="default: all")
    parser.add_argument("--write", action="store_true", help="keep what is made now")
    parser.add_argument("--against", metavar="PYTHON", help="time the ticks in turns with the hhsim of this Python")
    parser.add_argument("--runs", type=int, default=3, help="runs of each scene by each hhsim with --against")
    chosen = parser.parse_args(arguments)
    names = chosen.scenes or list(SCENES)
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        if chosen.against:
            rows = list(compare_times(chosen.against, names, chosen.runs, folder))
            columns = [number(key, digits=3) for key in rows[0] if key != "scene"]
            print_table(Table([words("scene"), *columns], rows, "CPU time of a tick in contact [µs]"))
            print({key: round(float(np.median([row[key] for row in rows])), 3) for key in ("ratio 50", "ratio 99")})
            return 0
        found: dict[str, dict[str, Any]] = {}
        for name in names:
            run(name, folder / f"{name}.h5")
            made_now = keep(folder / f"{name}.h5")
            row = moved(load(name), made_now) if (GOLDEN / f"{name}.npz").exists() else None
            if row is not None:
                found[name] = row
            if chosen.write:
                np.savez_compressed(GOLDEN / f"{name}.npz", allow_pickle=False, **made_now)
    if found:
        print_table(table(found))
    print(f"{len(names) - len(found)} of {len(names)} runs are the same, byte for byte")
    return 1 if found and not chosen.write else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
