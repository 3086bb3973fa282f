"""Force of each finger after the repair: what the virtual coupling bears at the corrected hand.

Nobody else publishes a force that is not made of the depth, as EgoPHI's is (-k d n).
"""

from hhsim.hand.fingers import FINGERS
from hhsim.metrics.field.hands import FieldMetric, FieldPair, largest, mean, of_repair
from hhsim.metrics.run_metric import each_with


def pressing_force(pair: FieldPair, finger: int) -> float:
    """Compute the mean force of a finger over the frames in which it presses [N]; NaN if it never does."""
    if pair.force is None:
        return float("nan")
    force = pair.force[:, finger]
    return mean(force[force > 0.0])


def _of_finger(finger: int) -> FieldMetric:
    name = FINGERS[finger]
    compute = of_repair(lambda pair: pressing_force(pair, finger))
    return FieldMetric(f"force_{name}", f"force of the {name} where it presses, mean", 3, "N", compute=compute)


METRICS = each_with(
    *map(_of_finger, range(len(FINGERS))),
    FieldMetric(
        "force_max", "force of a finger, max", 3, "N",
        compute=of_repair(lambda pair: float("nan") if pair.force is None else largest(pair.force)),
    ),
    parameters="of the coupling",
)  # fmt: skip
