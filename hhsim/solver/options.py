"""Options of the solver: method, backend, stiffness, and lengths of a tick."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import InputError, check_known
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.ranges import check_range
from hhsim.solver.method import SURFACES, find_method, methods_that

FORCES = ("kkt", "paper")
FRUSTUM_ENDS = ("spheres", "flat")
TOUCH = 1e-5
"""A hand of default size touches spheres that are at most this far [m]."""

UNLIMITED = 2**62
"""Budget of work units that no tick uses up."""
UNBOUNDED = 1e6
"""Speed of a snap [m/s] that bounds no hand."""
BUDGET_SHARE = 0.15
"""Default budget in work units of 1 to 3 ns, as a share of a tick's period in nanoseconds. The current linearisation is
finished, list updates included: that may take a tick to 0.6 of its period."""
USUAL: Any = None
"""Placeholder of a default that depends on the method, the surface or the period."""
NUMBERS = (
    *("period", "response", "contact_response", "linearisations", "budget", "threads"),
    *("margin", "skin", "offset", "step_tolerance", "snap_speed", "touch", "tolerance"),
)
"""Numeric options, whose ranges are in `hhsim.ranges`."""
OF_SURFACE = {"mesh": {"skin": 5e-4, "touch": 1e-6}}
OF_ANY_SURFACE = {"skin": 2e-3, "touch": TOUCH}
"""Usual skin and touch [m] of a surface. Where triangles are small they are many: a wide skin lists more than it saves.
A contact that bears a force is an `offset` away from them, without the error of spheres."""


@dataclass(frozen=True)
class Stiffness:
    """Virtual coupling G of the paper's Eq. 1.

    Our defaults: a palm that is 1 mm off pulls with 1 N; the rotation's is the translation's times (70 mm)²; one joint
    holds the tip of a finger 80 mm long with 80 N/m.
    """

    translation: float = 1000.0  # k_t [N/m]
    rotation: float = 5.0  # k_r [N·m/rad]
    flexion: float = 0.5  # k_θ [N·m/rad]
    contact: float = 300.0  # k of Eq. 14 and Fig. 9 [N/m]
    penalty: float = 100_000.0  # of every contact of the method `penalty` [N/m]

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            object.__setattr__(self, name, check_range(f"stiffness {name}", value))

    def diagonal(self) -> FloatArray:
        """Return G of the 21 variables, shape (21,)."""
        return np.concatenate([np.full(3, self.translation), np.full(3, self.rotation), np.full(15, self.flexion)])


def usual_budget(period: float) -> int:
    """Return the default budget of work units of a tick with a period [s]."""
    return max(1, round(1e9 * BUDGET_SHARE * period))


FREE, PARTS = "free objects", "bodies of several parts"
_SOLVED_WITH: Mapping[str, Mapping[str, tuple[Any, ...]]] = {
    FREE: {"method": ("coupled",), "qp": ("active-set",), "force": ("kkt",)},
    PARTS: {"method": ("coupled", "progressive"), "qp": ("active-set",), "threads": (1,), "force": ("kkt",)},
}
"""Options that either goes with."""


def require_options(options: "SolverOptions", what: str) -> None:
    """Raise an InputError unless `FREE` objects, or bodies of several `PARTS`, can be touched with these options."""
    for name, expected in _SOLVED_WITH[what].items():
        if (found := getattr(options, name)) not in expected:
            raise InputError(f"{name} {found} has no {what}: expected {' or '.join(map(str, expected))}")


@dataclass(frozen=True, kw_only=True, repr=False)
class SolverOptions:
    """Options of the solver; lengths in metres; InputError for an unknown name, or a number out of its range."""

    method: str = "coupled"  # one of `hhsim.solver.method.method_names`, or `package.module:Class`
    surface: str = "spheres"  # one of `hhsim.solver.method.SURFACES`: what of the object the hand touches
    qp: str = "active-set"  # `active-set`, or, of `coupled`, a backend that qpsolvers offers
    # `kkt` (the QP's multipliers) or `paper` (Eq. 14). Default: `paper` for method `paper`, else `kkt`.
    force: str = USUAL
    # Fingers that the scene uses, of thumb, index, middle, ring, little. The others follow the haptic hand without
    # contact; the palm is always used.
    fingers: tuple[str, ...] = FINGERS
    # Most linearisations in a tick. Default: 12; method `paper` makes exactly so many, by default 1; in `penalty`, most
    # rounds in which a tick finds which contacts push.
    linearisations: int = USUAL
    # Work units (`hhsim.kernels.tick.state`) after which a tick begins no further linearisation; the rest of the step
    # is lag, which the next tick continues. Default: `BUDGET_SHARE` of the period.
    budget: int = USUAL
    # Pairs up to this far enter the QP; near the object no step is longer. Default: 1 mm. Of method `paper` this is Δr,
    # by default 0.5 mm, and no bound on a step.
    margin: float = USUAL
    # Pairs up to this much farther are listed between ticks. Default: 2 mm; 0.5 mm with surface `mesh`.
    skin: float = USUAL
    offset: float = 5e-7  # clearance that contacts keep, so that second-order errors of small steps do not penetrate
    step_tolerance: float = 1e-4  # a shorter step ends the tick
    # Speed beyond the user's own [m/s] with which the hand of `coupled` follows a nearest pose that has moved on.
    snap_speed: float = 0.15
    tolerance: float = 1e-8  # accepted violation of a program's row, as a share of the margin
    touch: float = USUAL  # pairs nearer than this count as touching. Default: 10 µm; 1 µm with surface `mesh`.
    # Threads that share the fingers' programs of a tick of `progressive`, up to one for each finger. The bytes do not
    # depend on their number.
    threads: int = 1
    stiffness: Stiffness = field(default_factory=Stiffness)  # virtual coupling
    # Of method `paper`: `spheres` (Eq. 13's range of k at every joint, as at the fingertip) or `flat` (Eq. 7's, but for
    # the fingertip), which takes large object spheres beyond a joint for contacts.
    frustum_ends: str = "spheres"
    self_contact: bool = False  # True if the hand's own parts keep out of each other, with method `coupled`
    # Duration of a tick [s]; only the dynamics of `penalty` need it. A replay takes it from the motion.
    period: float = 1e-3
    # Time constant of the coupling of `penalty` [s]: its virtual mass is G times the square of it.
    response: float = 1e-3
    contact_response: float = 1e-3  # damping of the contacts of `penalty`, as a time [s]: b = k times it

    def __post_init__(self) -> None:
        method = find_method(self.method)
        check_known("surface", [self.surface], SURFACES)
        if self.surface != "spheres" and method.refuses_surfaces:
            why = method.refuses_surfaces
            raise InputError(f"method {self.method} takes the surface spheres, not {self.surface}: {why}")
        budget = {"budget": usual_budget(check_range("period", self.period))}
        for name, value in {**method.defaults, **OF_SURFACE.get(self.surface, OF_ANY_SURFACE), **budget}.items():
            if getattr(self, name) is USUAL:
                object.__setattr__(self, name, value)
        if self.qp != "active-set" and not method.takes_backends:
            known = " and ".join(methods_that("takes_backends"))
            raise InputError(f"method {self.method} is not solved by {self.qp}: {known} takes any QP solver")
        if self.self_contact and not method.takes_self_contact:
            known = " and ".join(methods_that("takes_self_contact"))
            raise InputError(
                f"method {self.method} lets fingers through each other and the palm: {known} has self-contact"
            )
        check_known("force model", [self.force], FORCES)
        check_known("kind of frustum ends", [self.frustum_ends], FRUSTUM_ENDS)
        check_known("finger", self.fingers, FINGERS)
        for name in NUMBERS:
            # Kernels are compiled for the type of each: a whole number of metres is one with a point.
            object.__setattr__(self, name, check_range(name, getattr(self, name)))
        if self.threads > 1 and self.qp != "active-set":
            raise InputError(f"threads is {self.threads}, but '{self.qp}' is driven in one thread: use active-set")
        if self.threads > 1 and not method.takes_threads:
            known = " or ".join(methods_that("takes_threads"))
            raise InputError(f"threads is {self.threads}, but '{self.method}' runs in one thread; for several: {known}")
        if self.offset * 10.0 > self.margin:
            least = 1e4 * self.offset
            raise InputError(f"a margin of {1e3 * self.margin:g} mm is too small: at least {least:g} mm, ten offsets")

    def __repr__(self) -> str:
        """Method, surface and all that differs from their defaults."""
        usual = SolverOptions(method=self.method, surface=self.surface)
        names = (field.name for field in fields(self))
        shown = [f"{name}={getattr(self, name)!r}" for name in names if getattr(self, name) != getattr(usual, name)]
        return f"SolverOptions({', '.join([f'method={self.method!r}', f'surface={self.surface!r}', *shown])})"

    def at_rate(self, rate: float) -> "SolverOptions":
        """Return the options for ticks at a rate [Hz]; a default budget follows the period."""
        budget = USUAL if self.budget == usual_budget(self.period) else self.budget
        return replace(self, period=1.0 / rate, budget=budget)

    def scaled(self, factor: float) -> "SolverOptions":
        """Return the options for a hand and an object `factor` times as large, which then move alike.

        Lengths grow by the factor, rotational stiffness by its square; forces are then `factor` times as large.
        """
        stiffness = replace(
            self.stiffness, rotation=self.stiffness.rotation * factor**2, flexion=self.stiffness.flexion * factor**2
        )
        names = ("margin", "skin", "offset", "step_tolerance", "snap_speed", "touch")
        lengths = {name: getattr(self, name) * factor for name in names}
        return replace(self, stiffness=stiffness, **lengths)

    def modelled(self) -> BoolArray:
        """Return True for each body that the scene uses, shape (16,): the phalanges of its fingers, and the palm."""
        used = [finger in self.fingers for finger in FINGERS]
        return np.append(np.repeat(used, PHALANGES), True)

    def to_json(self) -> dict[str, Any]:
        """Return all options as plain values."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "SolverOptions":
        """Return the options of plain values, defaults for those left out; raise InputError for an unfit one."""
        try:
            fields = dict(values)
            if "stiffness" in fields:
                fields["stiffness"] = Stiffness(**fields["stiffness"])
            if "fingers" in fields:
                fields["fingers"] = tuple(fields["fingers"])
            return cls(**fields)
        except TypeError as error:
            raise InputError(str(error)) from None
