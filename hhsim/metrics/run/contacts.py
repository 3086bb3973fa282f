"""How many pairs of a hand body and an object sphere were near each other."""

from hhsim.metrics.run_metric import RunMetric

METRICS = (
    RunMetric(
        name="candidates_max",
        label="candidate pairs, most",
        paper="≈ 250",
        less_is_better=False,
        place=10,
        needs=("contacts/candidates",),
        compute=lambda run: run["contacts/candidates"].max(initial=0),
    ),
    RunMetric(
        name="touching_max",
        label="touching pairs, most",
        less_is_better=False,
        place=11,
        needs=("contacts/touching",),
        compute=lambda run: run["contacts/touching"].max(initial=0),
    ),
)
