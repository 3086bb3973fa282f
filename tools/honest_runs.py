"""Honest runs before the referee: `python -m tools.honest_runs FOLDER --runs 400`.

Each run is a random command line of `hhsim replay`, short and drawn from seed and number, of one of `KINDS`: fixed and
driven objects, free ones, two hands, moving parts, several things; both surfaces, 1 g to 10 kg, μ of 0 to 2, torsion,
tremor, 100 Hz to 5 kHz. Results and verdicts stay in FOLDER: what is there is not run again, and with `--judge` judged
anew. The table has each claim's worst figure, its allowance and their ratio. Exit code 1: a claim is false.
"""

import argparse
import contextlib
import importlib
import io
import json
import re
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from importlib.resources import files
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.errors import HhsimError
from hhsim.mesh.catalogue import object_names
from hhsim.result.reader import load_result
from hhsim.table.table import Table, number, words
from hhsim.verify.claim import FAILS, HOLDS
from hhsim.verify.verify import verify

TICKS = 300, 800
"""Least and most ticks of a run."""
RATES = 100.0, 5000.0
"""Least and greatest rate of the ticks [Hz], between which its logarithm is uniform; half of the runs have 1 kHz."""
SPEEDS = 0.4, 6.0
"""Least and greatest speed of a motion, as a share of the catalogue's; what does not fit into the ticks is cut off."""
FAR = 0.12
"""Way of a catalogue script's approach [m]: a short run begins nearer."""
ROWS = "verdicts.jsonl"
KEPT = ("name", "verdict", "worst", "tolerance", "unit", "tick", "hand")
THINGS = (
    ("blocks", "stack"),
    ("chest", "lift"),
    ("door", "swing"),
    ("drawer", "shut"),
    ("peg", "insert"),
    ("pot", "lift"),
)
PARTS = ("laptop", "close"), ("laptop", "open"), ("scissors", "cut"), ("book", "grasp")
TWO = ("cube", "lift-both"), ("cube", "turn-both"), ("handle-box", "lift-both"), ("cup", "hand-over"), ("bunny", "lift")


class Drawn:
    """Random choices of one run, and the files that it needs."""

    def __init__(self, folder: Path, seed: int, run: int) -> None:
        self.rng = np.random.default_rng([seed, run])
        self.folder, self.run, self.speed = folder / f"{run}", run, 1.0
        self.ticks = int(self.rng.integers(*TICKS, endpoint=True))
        self.rate = 1000.0 if self.rng.random() < 0.5 else round(self.between(*RATES), 1)

    def one(self, *words: Any) -> Any:
        """Return one of some words."""
        return words[int(self.rng.integers(len(words)))]

    def between(self, least: float, most: float) -> float:
        """Return a number whose logarithm is uniform between two."""
        return float(np.exp(self.rng.uniform(np.log(least), np.log(most))))

    def some(self, share: float, *words: str) -> list[str]:
        """Return words, or with the rest of the share none."""
        return list(words) if self.rng.random() < share else []

    def written(self, name: str, text: str) -> str:
        """Write a file of the run, its durations and the times of its joints by the speed, and return its name."""
        slower = 1.0 / self.speed
        text = re.sub(r"^(duration = )([\d.]+)", lambda of: f"{of[1]}{float(of[2]) * slower:.6f}", text, flags=re.M)
        for motion in re.findall(r"(?<== \[)\[.*\](?=\])", text):
            quicker = re.sub(r"\[([\d.]+),", lambda of: f"[{float(of[1]) * slower:.6f},", motion)
            text = text.replace(motion, quicker)
        self.folder.mkdir(exist_ok=True)
        path = self.folder / f"{name}.toml"
        path.write_text(text, encoding="utf-8")
        return str(path)

    def script(self, name: str) -> str:
        """Write a script of the catalogue, as quick as its ticks at this rate demand, or as `SPEEDS` let it be."""
        text = (files("hhsim.trajectories") / f"{name}.toml").read_text(encoding="utf-8")
        whole = sum(map(float, re.findall(r"^duration = ([\d.]+)", text, re.MULTILINE)))
        self.speed = float(np.clip(whole * self.rate / self.ticks, *SPEEDS))
        if "[joint]" not in text and "start_distance" not in text:
            near = self.rng.uniform(0.01, 0.06)
            text = re.sub(r"duration = ([\d.]+)", lambda of: f"duration = {float(of[1]) * near / FAR}", text, count=1)
            text = f"start_distance = {near:.4f}\n{text}"
        return self.written(name, text)

    def things(self, name: str) -> str:
        """Write a file of bodies with other masses and friction, and return its name."""
        source = files("hhsim.objects") / "bodies"
        text = (source / f"{name}.toml").read_text(encoding="utf-8").replace('mesh = "', f'mesh = "{source}/')
        heavier = self.between(0.02, 20.0)
        text = re.sub(r"^mass = ([\d.]+)", lambda of: f"mass = {float(of[1]) * heavier:.6g}", text, flags=re.M)
        text = re.sub(r"^(friction|torsion) = .*\n", "", text, flags=re.M)
        rough = f"friction = {self.rng.uniform(0.0, 2.0):.3f}\ntorsion = {self.one(0.0, 0.003, 0.01)}"
        return self.written(name, re.sub(r'^name = "(?!table).*', lambda of: f"{of[0]}\n{rough}", text, flags=re.M))

    def common(self, on_mesh: float = 0.5) -> list[str]:
        """Return options that every kind takes; a share of the runs is on the mesh."""
        found = ["--rate", f"{self.rate}", "--ticks", f"{self.ticks}", "--seed", f"{self.run}"]
        # Things beside others may have 1,024 spheres.
        found += self.some(on_mesh, "--surface", "mesh") or ["--level", "3"] * (on_mesh > 0.5)
        found += self.some(0.3, "--tremor", f"{self.rng.uniform(0.0, 0.5):.2f},{self.rng.uniform(0.0, 0.5):.2f}")
        soft = (self.between(100.0, 10_000.0), self.between(0.5, 50.0), self.between(0.05, 5.0))
        return found + self.some(0.3, "--stiffness", ",".join(f"{k:.3g}" for k in soft))

    def free(self) -> list[str]:
        """Return the options of a free object."""
        found = [
            "--free",
            "--mass",
            f"{self.between(1e-3, 10.0):.4g}",
            "--friction",
            f"{self.rng.uniform(0.0, 2.0):.3f}",
        ]
        found += self.some(0.5, "--torsion", f"{self.rng.uniform(0.0, 10.0):.2f}")
        found += self.some(0.3, "--table-friction", f"{self.rng.uniform(0.0, 2.0):.3f}")
        return found + self.some(0.15, "--table", "none")


def fixed(of: Drawn) -> list[str]:
    """One hand at a fixed object, or at one that goes along an arc."""
    name = of.one("touch", "pinch", "grasp", "whole-hand", "slide", "carry", "carry", "sequence")
    found = [of.one(*object_names()), of.script(name), *of.common(), *of.some(0.2, "--hand", "left")]
    if of.rng.random() < 0.25:
        return [*found, "--method", of.one("progressive", "progressive", "paper", "penalty")]
    return found + of.some(0.3, "--self-contact", "on")


def free(of: Drawn) -> list[str]:
    """One hand and a free object."""
    name = of.one("grasp", "lift", "shake", "turn", "push", "slip", "stack")
    return [of.one(*object_names()), of.script(name), *of.common(), *of.free(), *of.some(0.2, "--hand", "left")]


def two_hands(of: Drawn) -> list[str]:
    """Two hands, at a fixed object or at a free one."""
    if of.rng.random() < 0.25:
        return [
            of.one("bunny", "teapot", "handle-box"),
            of.script(of.one("grasp", "touch")),
            "--hands",
            "both",
            *of.common(),
        ]
    object_, name = of.one(*TWO)
    return [object_, of.script(name), "--hands", "both", *of.common(), *of.free()]


def parts(of: Drawn) -> list[str]:
    """One or two hands at a thing whose parts move."""
    object_, name = of.one(*PARTS)
    return [object_, of.script(name), *of.common(), *of.some(0.3 * (object_ == "laptop"), "--hands", "both")]


def several(of: Drawn) -> list[str]:
    """One or two hands at several things, free, fixed, driven and on joints."""
    object_, name = of.one(*THINGS)
    script = of.script(name)
    return [of.things(object_), script, *of.common(0.9), *of.some(0.3 * (name in {"lift", "stack"}), "--hands", "both")]


KINDS: dict[str, Callable[[Drawn], list[str]]] = {
    "fixed": fixed,
    "free": free,
    "two-hands": two_hands,
    "parts": parts,
    "several": several,
}
"""Kinds of runs by their names: a run is of the kind of its number."""


def judged_run(folder: Path, seed: int, run: int, kept: bool = False) -> dict[str, Any]:
    """Make a run, unless its result was `kept`, and judge it; return the row of its verdicts."""
    import click

    kind, out = list(KINDS)[run % len(KINDS)], folder / f"{run}.h5"
    row: dict[str, Any] = {"run": run, "kind": kind, "claims": []}
    try:
        if not kept:
            # What lies there is of a run that was cut short.
            out.unlink(missing_ok=True)
            line = [*KINDS[kind](Drawn(folder, seed, run)), "--out", str(out), "--json"]
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                importlib.import_module("hhsim.cli.replay").command.main(line, standalone_mode=False)
        found = verify(load_result(out))
        row |= {
            "ticks": found.ticks,
            "claims": [{name: asdict(claim)[name] for name in KEPT} for claim in found.claims],
        }
    except (HhsimError, click.ClickException) as error:
        row["error"] = str(error.format_message() if isinstance(error, click.ClickException) else error)
    return row


def margins(rows: Sequence[dict[str, Any]]) -> Table:
    """Return the table of each claim's worst figure as a share of its allowance."""
    claims: dict[str, dict[str, Any]] = {}
    for row in rows:
        for claim in row["claims"]:
            if claim["verdict"] not in {HOLDS, FAILS} or np.isnan(claim["worst"]):
                continue
            share = claim["worst"] / (claim["tolerance"] or 0.5)
            held = claims.setdefault(claim["name"], {**claim, "share": -1.0, "files": 0, "failed": 0})
            held["files"] += 1
            held["failed"] += claim["verdict"] == FAILS
            if not share <= held["share"]:
                held |= {**claim, "share": share, "run": row["run"]}
    columns = [
        words("claim", lambda of: of["name"]),
        number("results", lambda of: of["files"]),
        number("judged false", lambda of: of["failed"]),
        words("allowance there", lambda of: f"{of['tolerance']:.2g} {of['unit']}" if of["tolerance"] else "none"),
        words("worst", lambda of: f"{of['worst']:.2g}"),
        words("share", lambda of: f"{of['share']:.2g}"),
        words("run, tick", lambda of: f"{of['run']}, {of['tick']}"),
    ]
    return Table(columns, list(claims.values()))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.honest_runs", description=__doc__)
    parser.add_argument("folder", type=Path, help="of results and verdicts")
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--first", type=int, default=0, help="number of the first run")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--judge", action="store_true", help="judge the results that are there anew")
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args(arguments)
    log, numbers = given.folder / ROWS, range(given.first, given.first + given.runs)
    kept = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()] if log.exists() else []
    rows = {row["run"]: row for row in kept if row["run"] in numbers}
    todo = [n for n in numbers if n not in rows or (given.judge and rows[n]["claims"])]
    given.folder.mkdir(exist_ok=True, parents=True)
    with ProcessPoolExecutor(given.processes, get_context("spawn")) as pool, log.open("a", encoding="utf-8") as file:
        for done in as_completed([pool.submit(judged_run, given.folder, given.seed, n, n in rows) for n in todo]):
            rows[done.result()["run"]] = done.result()
            print(json.dumps(done.result()), file=file, flush=True)
    print(margins(list(rows.values())).markdown())
    refused = [row for row in rows.values() if "error" in row]
    print(f"\n{len(rows) - len(refused)} runs, {sum(row.get('ticks', 0) for row in rows.values()):,} ticks")
    for row in refused:
        print(f"refused: run {row['run']}: {row['error']}")
    return int(any(claim["verdict"] == FAILS for row in rows.values() for claim in row["claims"]))


if __name__ == "__main__":
    sys.exit(main())
