"""What the solver refuses before it runs a tick: each in one line that says what is wrong."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from free_scenes import body_of, box, far_hand, solver_of
from sphere_scenes import sphere_tree

from hhsim.errors import HhsimError
from hhsim.hand.model import HandModel
from hhsim.motion.analytic_motion import still
from hhsim.scene.body import Free, Joint
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import QpProblem, solve
from hhsim.solver.solver import HandSolver
from hhsim.trees.contact_surface import ContactSurface, contact_surface, jointed_surface

HAND = HandModel.default()
MESH = box((0.05, 0.05, 0.05))
ORIGIN, ALONG = (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)
OUTSIDE = "outside_methods:Follow"


def options(**given: Any) -> Callable[[], Any]:
    return lambda: SolverOptions(**given)


def free(**given: Any) -> Callable[[], Any]:
    """A free body with these fields in place of sound ones."""
    sound: dict[str, Any] = {"mass": 0.1, "center": ORIGIN, "inertia": 1e-4 * np.eye(3)}
    return lambda: Free(**{**sound, **given})


def beside(**given: Any) -> Callable[[], Any]:
    return lambda: solver_of(body_of(MESH), **given).run(*far_hand(1))


def problem(**given: Any) -> Callable[[], Any]:
    sound = {"stiffness": np.ones(3), "matrix": np.ones((2, 3)), "rhs": np.zeros(2), "target": np.zeros(3)}
    return lambda: QpProblem(**{**sound, **given})


def crowd() -> None:
    tip = HAND.joints([0.0, 0.0, 0.4], [1.0, 0.0, 0.0, 0.0], np.zeros((5, 3)), np.zeros(5))[1, 3]
    spheres = sphere_tree(np.repeat((tip - [0.0, 0.0, 0.05])[None], 5000, axis=0), np.full(5000, 1e-3))
    solver = HandSolver(HAND, spheres.arrays(), SolverOptions())
    solver.run(*still([0.0, 0.0, 0.4]).line(still([0.0, 0.0, 0.34]), 59))


def jointed(second: ContactSurface, **given: Any) -> HandSolver:
    """A hand beside two parts, the first one a mesh."""
    surface = jointed_surface((contact_surface("mesh", MESH, None), second), np.zeros((1, 2, 7)))
    return HandSolver(HAND, surface, SolverOptions(surface="mesh", **given))


def hinge(**given: Any) -> Callable[[], Any]:
    return lambda: body_of(MESH, joint=Joint(**{"type": "hinge", "axis": ALONG, **given}))


def slider(**given: Any) -> Callable[[], Any]:
    return lambda: body_of(MESH, joint=Joint(**{"type": "slider", "axis": ALONG, **given}))


THROUGH = "lets fingers through each other and the palm: coupled has"
INTO_IT = body_of(box((0.05, 0.05, 0.05), (0.01, 0.005, 0.0496)), "b")
AIR = sphere_tree(np.zeros((1, 3)), np.ones(1))
FAULTS: dict[str, tuple[Callable[[], Any], str]] = {
    "method": (options(method="couple"), "did you mean coupled"),
    "force": (options(force="kk"), "kkt"),
    "surface": (options(surface="triangles"), "unknown surface 'triangles'"),
    "ends": (options(method="paper", frustum_ends="flats"), "flat"),
    "offset": (options(offset=2e-4), "ten offsets"),
    **{f"qp of {name}": (options(method=name, qp="clarabel"), "any") for name in ("progressive", "paper", OUTSIDE)},
    "threads outside": (options(method=OUTSIDE, threads=2), "runs in one thread"),
    "threads": (options(threads=2), "for several: progressive"),
    "threads of a QP": (options(threads=2, qp="daqp"), "'daqp' is driven in one thread"),
    **{f"{n} threads": (options(threads=n), f"threads is {n}: expected 1 to 5") for n in (0, -1, 6)},
    "paper, mesh": (options(method="paper", surface="mesh"), "not mesh: .*between frustums and spheres"),
    "penalty, mesh": (options(method="penalty", surface="mesh"), "not mesh: .*triangles have no depth"),
    **{f"own {m}": (options(method=m, self_contact=True), THROUGH) for m in ("progressive", "paper", "penalty")},
    "free, progressive": (beside(method="progressive"), "method progressive has no free objects: expected coupled"),
    "free, clarabel": (beside(qp="clarabel"), "qp clarabel has no free objects: expected active-set"),
    "free, paper's forces": (beside(force="paper"), "force paper has no free objects: expected kkt"),
    "in the table": (beside(table=-0.024), "begins 1 mm below the table"),
    "in another": (beside(others=[INTO_IT]), "begins .* mm inside"),
    "mass": (free(mass=0.0), "mass is 0 kg"),
    "friction": (lambda: body_of(MESH, friction=-0.1), "friction is -0.1"),
    "table": (beside(table=float("nan")), "table is nan m: expected -100 to 100"),
    "centre": (free(center=(0.0, float("inf"), 0.0)), "centre or the inertia .* not finite"),
    "inertia": (free(inertia=((1e-4, 1e-5, 0), (0, 1e-4, 0), (0, 0, 1e-4))), "not symmetric"),
    "flat inertia": (free(inertia=np.diag([1e-4, 1e-4, 0.0])), "not positive"),
    "hinge's axis": (hinge(axis=ORIGIN), "the axis of the hinge has length 0"),
    "hinge's start": (hinge(limits=(0.5, 1.0)), "start has the value 0, beyond the limits; expected 0.5 to 1 rad"),
    "hinge's limits": (hinge(limits=(-4.0, 1.0)), "within ±π"),
    "hinge's friction": (hinge(friction=-1.0), "hinge.friction"),
    "slider's axis": (slider(axis=ORIGIN), "the axis of the slider has length 0"),
    "slider's start": (slider(limits=(0.5, 1.0)), "start has the value 0, beyond the limits; expected 0.5 to 1 m"),
    "slider's friction": (slider(friction=-1.0), "slider_friction is -1 N"),
    "threads of parts": (
        lambda: jointed(contact_surface("mesh", MESH, None), method="progressive", threads=2),
        "threads 2 has no bodies of several parts: expected 1",
    ),
    "two kinds of parts": (lambda: jointed(ContactSurface(AIR.arrays())), "expected one kind of surface"),
    "too many contacts": (crowd, r"margin.*coarser"),
    "columns": (problem(matrix=np.ones((2, 4))), r"matrix has shape \(2, 4\), expected \(2, 3\)"),
    "stiffness": (problem(stiffness=np.ones(4)), r"stiffness has shape \(4,\), expected \(3,\)"),
    "no stiffness": (problem(stiffness=np.array([1.0, 0.0, 1.0])), "must be positive, the least is 0"),
    "NaN": (problem(stiffness=np.array([1.0, np.nan, 1.0])), "must be positive"),
    "backend": (lambda: solve(problem()(), "clarable"), "unknown QP backend 'clarable': did you mean clarabel"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_told_in_one_line(fault: str) -> None:
    run, message = FAULTS[fault]
    with pytest.raises(HhsimError, match=message) as refused:
        run()
    assert "\n" not in str(refused.value)
