"""The judge of stuck ticks: it finds a way where there is one, and none at an optimum."""

import numpy as np
import pytest
from conftest import sampled
from sphere_scenes import bumpy_ball

from hhsim.bench.robustness.objects import roof_mesh, sheet_mesh
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.bench.robustness.safety import _moved, distance_rows, pairs_near, pieces_of, way_out
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion
from hhsim.mesh.catalogue import load_object
from hhsim.motion.analytic_motion import still
from hhsim.solver.options import UNBOUNDED, SolverOptions
from hhsim.solver.solver import HandSolver
from hhsim.trees.contact_surface import contact_surface
from hhsim.verify.contacts import PALM

pytestmark = pytest.mark.slow

HAND = HandModel.default()
BALL = bumpy_ball(1200)
OPTIONS = SolverOptions()
FLOOR = sheet_mesh(0.6, 0.6)
"""The plane z = 0, of two triangles."""


@pytest.mark.parametrize(("surface", "height"), [("spheres", 0.07), ("mesh", 0.03)])
def test_the_rows_are_the_derivatives_of_the_distances(surface: str, height: float) -> None:
    pieces, step = pieces_of(surface, roof_mesh(0.3, 0.03, 0.05), BALL), 1e-6
    here = still((0.001, -0.03, height), quaternion(np.array([0.1, 0.05, 0.3])), 0.4, 0.1)
    pairs, posed = pairs_near(HAND, pieces, here, 0.03)
    outside = np.flatnonzero((pairs.distance > 1e-3) & (pairs.distance < 0.02))
    assert {PALM, 1, 2} <= set(pairs.body[outside].tolist())

    def least(moved: HandConfiguration) -> dict[tuple[int, int], float]:
        found = pairs_near(HAND, pieces, moved, 0.04)[0]
        order = np.argsort(-found.distance)
        return dict(zip(zip(found.body[order].tolist(), found.leaf[order].tolist()), found.distance[order].tolist()))

    rows = distance_rows(pairs, posed)
    nearest = least(here)
    chosen = [i for i in outside if nearest[int(pairs.body[i]), int(pairs.leaf[i])] == pairs.distance[i]]
    for variable in range(21):
        change = step * np.eye(21)[variable]
        ahead, behind = (
            least(HandConfiguration(*(np.array(v)[None] for v in _moved(tuple(v[0] for v in here), sign * change))))
            for sign in (1.0, -1.0)
        )
        for i in chosen:
            pair = int(pairs.body[i]), int(pairs.leaf[i])
            assert rows[i, variable] == pytest.approx((ahead[pair] - behind[pair]) / (2.0 * step), abs=1e-5)


@pytest.mark.parametrize(
    ("seed", "surface"),
    sampled(
        [(seed, surface) for seed in range(4) for surface in ("spheres", "mesh")],
        lambda place, case: case == (0, "spheres"),
    ),
)
def test_at_an_optimum_there_is_none_and_away_from_it_there_is(seed: int, surface: str) -> None:
    # Held still, the coupled method comes to rest at a local optimum; on the way there it is at none.
    # Brute force over triangles takes ten times what it takes over spheres.
    holds = 10 if surface == "spheres" else 4
    ticks = 200 * holds
    stress = StressOptions(hold=200, jumps=True, sweep=False, position_spread=0.03)
    motion = RandomTargets(HAND, seed, stress).take(ticks)
    # With the bound of a snap it would be on its way there for more than a hold.
    mesh, options = load_object("triangular-prism").mesh, SolverOptions(surface=surface, snap_speed=UNBOUNDED)
    pieces = pieces_of(surface, mesh, BALL)
    record = HandSolver(HAND, contact_surface(surface, mesh, BALL).arrays, options).run(*motion)
    touching, moving = 0, 0
    for hold in range(1, holds):
        end = 200 * hold + 199
        rest = HandConfiguration.of(record).part(end, end + 1)
        touching += int(record.work[end, 6] > 0)
        assert way_out(HAND, pieces, options, rest, motion.part(end, end + 1)) == 0.0
        next_goal = motion.part((end + 1) % ticks, (end + 1) % ticks + 1)
        moving += int(way_out(HAND, pieces, options, rest, next_goal) > 0.0)
    assert touching > holds // 2 - 1
    assert moving == holds - 1


def test_what_an_object_does_not_have_is_refused() -> None:
    with pytest.raises(InputError, match="this object has no mesh"):
        pieces_of("mesh", None, BALL)
    with pytest.raises(InputError, match="this object has no spheres"):
        contact_surface("spheres", FLOOR, None)
