"""`hhsim verify`."""

import math
import time
from pathlib import Path

from hhsim.table.table import Table, number, words

from .arguments.command import argument, make_command, option
from .arguments.options import Count, Printing
from .arguments.scene_options import TRUST
from .console import print_notes, progress

SHOWN = (
    words("checked", "group"),
    words("verdict"),
    number("worst", lambda claim: _two_digits(claim.worst)),
    number("limit", lambda claim: _two_digits(claim.tolerance)),
    words("unit"),
    number("at tick", "tick"),
    words("by", lambda claim: " ".join(filter(None, (claim.name, claim.hand and f"({claim.hand})")))),
)
WHY = words("what is claimed; why so much is let pass", lambda claim: "; ".join(filter(None, (claim.says, claim.why))))


@make_command
def command(
    *,
    result: Path = argument(),
    every: Count | None = option(
        "Measure the true mesh at every K-th tick and at stated maxima. Default: 1 below 10,000 ticks, else 50.", "K"
    ),
    why: bool = option("Show every claim, with what it says and the reason of its tolerance."),
    trust: bool = TRUST,
    printing: Printing,
) -> int:
    """Check a result: seal, second run, physics by other code.

    RESULT is a file that hhsim replay or hhsim live wrote; of two hands, both are checked. The scene is run again, and
    everything that a run writes is compared but measured times. Distances, forces, friction, motion, joints and the
    cover of the trees are judged by code that shares nothing with the solver. Where the collision library coal is
    installed, it gives a second opinion on the nearest distances. The exit code is 1 where something is false.

    \b
    Examples:
      hhsim verify results/grasp.h5
      hhsim verify grasp.h5 --why
      hhsim verify session.h5 --every 100 --json
    """
    from hhsim.result.reader import load_result
    from hhsim.verify.claim import NOT_JUDGED
    from hhsim.verify.verify import verify

    begin = time.perf_counter()
    with progress(quiet=printing.quiet) as report:
        found = verify(load_result(result), every=every, trust=trust, progress=report)
    failed = [claim for claim in found.claims if claim.failed]
    spheres, mesh = 1e6 * found.sphere_penetration, 1e6 * found.mesh_penetration
    deep = "deepest in the " + ("" if math.isnan(spheres) else f"spheres {spheres:.3f} µm, in the ")
    deep += "mesh not judged" if math.isnan(mesh) else f"mesh {mesh:.3f} µm"
    rest = dict.fromkeys(claim.name for claim in found.claims if claim.verdict == NOT_JUDGED)
    unjudged = f"; not judged: {', '.join(rest)}" if rest else ""
    false = ", ".join(dict.fromkeys(claim.name for claim in failed))
    verdict = f"FALSE: {false}" if failed else "every claim that could be judged holds"
    printing.show(
        {"result": str(result), **found.to_json(), "seconds": time.perf_counter() - begin},
        Table((*SHOWN, WHY) if why else SHOWN, found.claims if why else found.worst, str(result)),
        *(f"FALSE: {claim.name}: {WHY.shown(claim)}" for claim in failed if not why),
        f"{found.looked}; {deep}{unjudged}; {verdict}",
    )
    if printing.for_people:
        told = found.claims if why else [claim for claim in found.claims if claim.failed or claim.name in rest]
        print_notes(list(dict.fromkeys(f"{claim.name}: {claim.note}" for claim in told if claim.note)))
    return 0 if found.passed else 1


def _two_digits(value: float) -> str:
    return "—" if math.isnan(value) else f"{value:.2g}"
