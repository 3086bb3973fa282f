"""Registry of every figure of the field: the `METRICS` of each module of this package."""

import importlib
import pkgutil
from functools import cache

import hhsim.metrics.field
from hhsim.metrics.field.field_metric import FieldMetric


@cache
def field_metrics() -> dict[str, FieldMetric]:
    """Return every figure by its name, in the order of the table.

    Raises:
        ValueError: Two figures have one name.
    """
    found: list[FieldMetric] = []
    for module in pkgutil.iter_modules(hhsim.metrics.field.__path__, f"{hhsim.metrics.field.__name__}."):
        found += getattr(importlib.import_module(module.name), "METRICS", ())
    metrics = {metric.name: metric for metric in sorted(found, key=lambda metric: metric.place)}
    if len(metrics) < len(found):
        raise ValueError(f"two field metrics of one name among {sorted(metric.name for metric in found)}")
    return metrics
