"""`hhsim verify`."""

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hhsim.table.table import Table, number, words

from .arguments import options, solver_options
from .console import print_json, print_line, print_notes, print_table, progress

if TYPE_CHECKING:
    from hhsim.verify.verify import Verification

SHOWN = (
    words("claim", "name"),
    words("verdict"),
    number("worst", lambda claim: _two_digits(claim.worst)),
    number("let pass", lambda claim: _two_digits(claim.tolerance)),
    words("unit"),
    number("at tick", "tick"),
    number("looked at", "checked"),
)
WHY = words("what is claimed; why so much is let pass", lambda claim: "; ".join(filter(None, (claim.says, claim.why))))


@click.command(cls=options.Command)
@click.argument("result", type=options.FILE)
@click.option(
    "--every",
    type=options.COUNT,
    default=None,
    metavar="K",
    help="Measure the true mesh at every K-th tick and at stated maxima. Default: 1 below 10,000 ticks, else 50.",
)
@click.option("--why", is_flag=True, help="Show what each claim says, and the reason of its tolerance.")
@click.option(
    "--again", is_flag=True, help="Make the motion and run the ticks once more, and compare everything but the times."
)
@solver_options.trust
@options.Printing.argument("printing")
def command(result: Path, every: int | None, again: bool, why: bool, trust: bool, printing: options.Printing) -> int:
    """Check every claim of a result with independent code.

    RESULT is a file that hhsim replay or hhsim live wrote; of two hands, each is checked. Joints, depths, forces,
    optimality, times and the summary are computed anew from the stored hands; of a session also its periods, its
    latency and what the fingers were told. Where the collision library coal is installed, it gives a second opinion on
    the nearest distances. The exit code is 1 where a claim is false.

    \b
    Examples:
      hhsim verify results/grasp.h5
      hhsim verify grasp.h5 --why
      hhsim verify grasp.h5 --again
      hhsim verify session.h5 --every 100 --json
    """
    from hhsim.result.reader import load_result
    from hhsim.verify.verify import verify

    begin = time.perf_counter()
    results = list(load_result(result).hands.values())
    with progress(quiet=printing.quiet) as report:
        all_found = [verify(one, every=every, again=again, trust=trust, progress=report) for one in results]
    if printing.as_json:
        documents = {one.name: found.to_json() for one, found in zip(results, all_found)}
        whole = {"result": str(result), **(documents[results[0].name] if len(results) == 1 else {"hands": documents})}
        print_json({**whole, "seconds": time.perf_counter() - begin})
    elif not printing.quiet:
        for one, found in zip(results, all_found):
            _print(one.label, found, why=why)
    return 0 if all(found.passed for found in all_found) else 1


def _print(label: str, found: "Verification", *, why: bool) -> None:
    from hhsim.verify.claim import NOT_JUDGED

    # What failed first, and with its reason, whether that was asked for or not.
    failed, others = ([claim for claim in found.claims if claim.failed is wanted] for wanted in (True, False))
    columns = (*SHOWN, WHY) if why else SHOWN
    print_table(Table(columns, [*failed, *others], label), optional=("looked at",))
    for claim in failed if not why else ():
        print_line(f"FALSE: {claim.name}: {WHY.shown(claim)}")
    spheres, mesh = 1e6 * found.sphere_penetration, 1e6 * found.mesh_penetration
    deep = "deepest in the " + ("" if math.isnan(spheres) else f"spheres {spheres:.3f} µm, in the ")
    deep += "mesh not judged" if math.isnan(mesh) else f"mesh {mesh:.3f} µm"
    false = [claim.name for claim in found.claims if claim.failed]
    verdict = f"FALSE: {', '.join(false)}" if false else "every claim that could be judged holds"
    rest = [claim.name for claim in found.claims if claim.verdict == NOT_JUDGED]
    print_line(f"{found.looked}; {deep}; not judged: {', '.join(rest)}; {verdict}")
    print_notes([f"{claim.name}: {claim.note}" for claim in found.claims if claim.note])


def _two_digits(value: float) -> str:
    return "—" if math.isnan(value) else f"{value:.2g}"
