"""The claim of how far contacts are from the true mesh, at the chosen ticks, by the collision library's distances."""

import numpy as np

from hhsim.metrics.contact_error import ticks_looked_at
from hhsim.replay.stored_scene import stored_mesh
from hhsim.verify.claim import NOT_JUDGED, Claim, judged
from hhsim.verify.tick_data import LENGTH, WHY_LENGTH, JudgedTicks
from hhsim.verify.tree_checks import TrueSurface, nearest_on

FIGURE = "contact_error_max"
NAME = "contacts off the mesh"
SAYS = "no contact of the ticks that the summary is of is farther from the true mesh than it says"


def contact_error_claim(judge: JudgedTicks) -> Claim:
    """The summary's figure against the contacts of the chosen ticks."""
    result = judge.result
    if FIGURE not in result.summary:
        return Claim(NAME, SAYS, NOT_JUDGED, checked=0, note="the file does not state it")
    surface = TrueSurface(stored_mesh(result), open_too=True)
    # Of a long run the figure is of some ticks, and says nothing of the others.
    stated_of = np.isin(judge.chosen, ticks_looked_at(np.asarray(result["contacts/candidates"]) > 0))
    touching = judge.touching.at(np.flatnonzero(stated_of[judge.touching.tick]))
    # A hand at rest touches at the same points over and over.
    points, place = np.unique(np.round(touching.point, 12), axis=0, return_inverse=True)
    away = nearest_on(surface.model, points)[0][place.ravel()]
    stated = float(result.summary[FIGURE])
    over = np.maximum(0.0, away - stated) if np.isfinite(stated) else away
    return judged(NAME, SAYS, over, LENGTH, "m", WHY_LENGTH, ticks=judge.chosen[touching.tick])
