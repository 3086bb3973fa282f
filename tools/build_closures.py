"""Grasps that ship so that a run need not search for them: each script of the catalogue on each of its objects.

    python -m tools.build_closures

searches anew and writes objects/closures.json. It is due when a script, an object, the default hand or the search
changed (`hhsim.scene.closure_search.SEARCH_VERSION` is then to be raised for the last); tests say so.
"""

import json
from collections.abc import Callable, Sequence
from unittest.mock import patch

from hhsim.errors import TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import object_names
from hhsim.scene.closure_search import SHIPPED, Fields, closure_key, encoded
from hhsim.scene.finger_closure import FingerClosure
from hhsim.scene.motion_catalogue import load_script, script_names
from hhsim.scene.scene import open_scene
from hhsim.scene.script import Script
from hhsim.trees.sphere_tree import SphereTree
from tools.import_graph import REPOSITORY


def searched(names: Sequence[str]) -> dict[str, Fields]:
    """Search for the closures of every script on the named objects; by key, in the order of the catalogue."""
    found: dict[str, Fields] = {}

    def search_anew(
        script: Script, hand: HandModel, tree: SphereTree, search: Callable[[], FingerClosure]
    ) -> FingerClosure:
        closure = search()
        found[closure_key(script, hand, tree)] = encoded(closure)
        return closure

    with patch("hhsim.scene.closure_search.kept_closure", search_anew):
        for name in names:
            for motion in script_names():
                if load_script(motion).joints:  # of a thing of several parts
                    continue
                try:
                    open_scene(name, motion)
                except TrajectoryError:  # not every script can be done on every object
                    continue
    return found


def main() -> None:
    """Write all closures, one in a line."""
    path = REPOSITORY / "objects" / SHIPPED
    lines = [f"{json.dumps(key)}: {json.dumps(fields)}" for key, fields in searched(object_names()).items()]
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    print(f"{path.relative_to(REPOSITORY)}: {len(lines)} closures, {path.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
