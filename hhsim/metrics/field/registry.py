"""Registry of every figure of the field: the `METRICS` of each module of this package."""

from functools import cache

import hhsim.metrics.field
from hhsim.metrics.field.hands import FieldMetric
from hhsim.metrics.run_metric import declared_figures


@cache
def field_metrics() -> dict[str, FieldMetric]:
    """Return every figure by its name, in the order of the table; ValueError if two have one name."""
    return declared_figures(hhsim.metrics.field)
