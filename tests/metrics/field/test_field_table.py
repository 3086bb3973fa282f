"""Table and verdict of the field: each limit by itself, rows in JSON and as a table, and one more figure."""

import json
from pathlib import Path

import numpy as np
import pytest
from field_hands import hands_at, skin_hand, sphere_hand

from hhsim.metrics.field.field_table import (
    EMPTY,
    MISSED,
    OK,
    field_metrics,
    field_rows,
    field_table,
    field_verdict,
    to_json,
)
from hhsim.metrics.field.hands import FieldPair
from hhsim.table.table import UNITS

SWAY = 0.001 * np.array([[0.0], [1.0], [0.0], [1.0], [0.0]])
"""Heights of a hand that goes up and down [m], shape (5, 1)."""


def judged(before: object, after: object, max_correction: float = 0.02) -> tuple[str, tuple[str, ...], str]:
    pair = FieldPair(hands_at(np.asarray(before) + 0.0 * SWAY, 5), hands_at(np.asarray(after) + 0.0 * SWAY, 5))
    found = field_verdict(field_rows(pair), max_correction)
    return found.word, found.missed, found.line


def test_a_repair_within_all_limits() -> None:
    word, missed, line = judged(SWAY - 0.003, SWAY + 1e-9)
    assert (word, missed) == (OK, ())
    judged_by = ("PD, joints, max", "contacts kept within 5 mm", "ACC, after over before", "correction of a joint, max")
    assert line == f"within limits: {', '.join(judged_by)}"


def test_each_limit_is_missed_by_itself() -> None:
    assert judged(SWAY - 0.003, SWAY - 2e-6)[:2] == (MISSED, ("depth_joints_max",))
    assert judged(SWAY - 0.003, SWAY - 2e-6)[2] == "limits missed: PD, joints, max 0.002 mm (at most 0.001 mm)"
    assert judged(SWAY - 0.003, SWAY - 0.9e-6)[0] == OK
    assert judged(SWAY - 0.003, SWAY, 0.0025)[1] == ("correction_max",)
    assert judged(SWAY - 0.003, SWAY, 0.0035)[0] == OK
    assert judged(SWAY - 0.003, SWAY + 0.006)[1] == ("contacts_kept_5mm",)
    assert judged(SWAY - 0.003, 1.2 * SWAY)[1] == ("acceleration_ratio",)
    both = judged(SWAY - 0.003, 1.2 * SWAY - 0.001)
    assert both[1] == ("depth_joints_max", "acceleration_ratio")
    assert both[2] == (
        "limits missed: PD, joints, max 1 mm (at most 0.001 mm); ACC, after over before 1.2 (at most 1.1)"
    )


def test_without_a_known_frame_nothing_is_judged() -> None:
    word, _, line = judged(np.nan, np.nan)
    assert word == EMPTY
    assert line.startswith("no frames: ")


def test_skin_and_cones_are_judged_too() -> None:
    skin = skin_hand([0.0, 0.0, 0.04], [0.01, 0.01, 0.06])
    assert "depth_skin_max" in field_verdict(field_rows(FieldPair(skin, skin)), 1.0).missed
    cones = sphere_hand(0.006)
    assert field_verdict(field_rows(FieldPair(cones, cones)), 1.0).missed == ("depth_cones_max",)


def test_the_table_shows_units_and_json_stores_si() -> None:
    pair = FieldPair(sphere_hand(0.006), sphere_hand(0.011))
    rows = field_rows(pair)
    table = field_table(rows, "a hand")
    assert table.headings == ["figure", "before", "after", "unit", "parameters"]
    cells = {row[0]: row[1:] for row in table.cells}
    assert cells["PD, cones, max"] == ["4.000", "0.000", "mm", "surface of cones and palm spheres"]
    assert cells["MPJPE"][0] == "—"
    assert cells["IV, exact, max"][1:3] == ["0.000", "cm³"]
    stored = json.loads(json.dumps(to_json(rows)))
    assert stored["depth_cones_max"]["before"] == pytest.approx(0.004)
    assert stored["depth_cones_max"]["unit"] == "m"
    assert stored["volume_exact_max"]["unit"] == "m³"
    assert stored["volume_exact_max"]["before"] == pytest.approx(4.17e-7, rel=1e-2)
    assert stored["mpjpe"]["before"] is None
    parameters = "distal phalanges, inside counts"
    assert stored["contacts_kept_5mm"] == {"before": None, "after": 100.0, "unit": "%", "parameters": parameters}


def test_every_unit_is_si_or_known_and_the_page_has_every_figure(repository: Path) -> None:
    metrics = field_metrics()
    assert {metric.unit for metric in metrics.values()} <= UNITS.keys() | {"N", "%", "m/s²", "m/s³"}
    page = (repository / "docs" / "lab" / "repair.md").read_text()
    assert [name for name in metrics if f"`{name}`" not in page] == []
