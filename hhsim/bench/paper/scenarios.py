"""Scenes of the paper's evaluation: scripts of the catalogue declare the figure and the objects of their motion."""

from collections.abc import Sequence
from dataclasses import dataclass

from hhsim.errors import check_known
from hhsim.mesh.catalogue import object_names
from hhsim.scene.motion_catalogue import load_script, script_names

SLIDING = "sliding"
"""Stands for a figure: the paper describes sliding on the five simple objects without one."""
FIGURES = {
    "11": "one finger, two fingers, five fingers with the palm, on five simple objects",
    "12": "no finger, one, two, five, two, one, none",
    SLIDING: "grasp and slide on the five simple objects",
    "13": "five complex objects, each from several sides",
    "14": "squeeze, hold and slide on cup and bunny",
    "15": "single finger, two fingers, five fingers, whole hand on the complex objects: 100 instances each",
}
CASES = ("SF", "TF", "FF", "WH")
"""Cases of Fig. 15: single finger, two fingers, five fingers, whole hand."""


@dataclass(frozen=True)
class Scenario:
    """One scene of the paper.

    Attributes:
        figure: Of `FIGURES`.
        motion: Script of the catalogue.
        case: Of `CASES` in Fig. 15, else empty.
        instances: Number of seeded variations of the hand's place.
    """

    figure: str
    object_name: str
    motion: str
    case: str = ""
    instances: int = 1

    @property
    def name(self) -> str:
        """Object and motion as arguments of `hhsim replay`."""
        return f"{self.object_name} {self.motion}"


def paper_scenarios(figures: Sequence[str] = tuple(FIGURES)) -> list[Scenario]:
    """Return the scenes of some figures: in the order of `FIGURES`, then of the objects, then of the motions or cases.

    Raises:
        UnknownNameError: No such figure.
    """
    check_known("figure", figures, FIGURES)
    found = [
        Scenario(use.figure, object_name, motion, use.case, use.instances)
        for motion in script_names()
        for use in load_script(motion).paper
        if use.figure in figures
        for object_name in use.objects
    ]
    figure_order, object_order = list(FIGURES), object_names()

    def order(scenario: Scenario) -> tuple[int, int, int]:
        case = CASES.index(scenario.case) if scenario.case in CASES else 0
        return figure_order.index(scenario.figure), object_order.index(scenario.object_name), case

    return sorted(found, key=order)
