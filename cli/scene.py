"""`hhsim scene`."""

from pathlib import Path
from typing import Literal

import click

from hhsim.system.counted import counted

from .arguments import options
from .arguments.free_object import FreeChoice
from .arguments.object_argument import MeshSize, complete_object
from .arguments.option_group import GroupedCommand
from .arguments.recording_options import Sampling
from .console import print_json, print_line, print_notes
from .replay import complete_trajectory


@click.command(cls=GroupedCommand)
@click.argument("object_", metavar="[OBJECT]", default="bunny", shell_complete=complete_object)
@click.argument("trajectory", metavar="[TRAJECTORY]", default="grasp", shell_complete=complete_trajectory)
@MeshSize.argument("mesh_size")
@options.tree_level
@click.option(
    *("--hand", "--hands", "side"),
    type=click.Choice(["right", "left", "both"]),
    help="Which hand grasps, or both. Default: the recording's, else the right.",
)
@FreeChoice.argument("free")
@Sampling.argument("sampling")
@options.seed
@click.option(
    "--out",
    type=options.OUTPUT,
    metavar="DIR",
    help="Folder, which must be new or empty. Default: a dated name in results/.",
)
@options.Printing.argument("printing")
def command(
    object_: str,
    trajectory: str,
    mesh_size: MeshSize,
    level: int | None,
    side: Literal["right", "left", "both"] | None,
    free: FreeChoice,
    sampling: Sampling,
    seed: int,
    out: Path | None,
    printing: options.Printing,
) -> None:
    """Write a scene as files for other software to solve.

    OBJECT and TRAJECTORY are as for hhsim replay. The folder gets the mesh (.obj), the spheres that cover it, the
    user's hand at every tick (.csv and HDF5), the hand as numbers and MJCF, hand and object as one MJCF model
    (scene.xml), a README with frames and units, and example-submission.csv, which shows what hhsim score takes back
    (docs/submissions.md). Several bodies have a mesh each, and joints in scene.xml; two hands have files each.

    \b
    Examples:
      hhsim scene bunny grasp --out bunny-grasp
      hhsim scene mug.stl grasp --unit mm --out mug-grasp
      hhsim scene cup handle --rate 500 --hand left --out cup-handle
      hhsim scene cube lift-both --hands both --free
    """
    from hhsim.scene.described_scene import SceneWords, load_words
    from hhsim.scene.motion_catalogue import import_remarks
    from hhsim.solver.options import SolverOptions
    from hhsim.submissions.scene_folder import EXAMPLE, check_scene_folder, worded_scene, write_scene_folder
    from hhsim.system.output_path import dated_output_path

    folder = out or dated_output_path(f"{Path(object_).stem}-{Path(trajectory).stem}-scene", "")
    check_scene_folder(folder)
    words = SceneWords(
        object=object_,
        trajectory=trajectory,
        unit=mesh_size.unit,
        size_mm=mesh_size.size,
        level=level,
        hand=side,
        rate=sampling.rate,
        samples=sampling.samples,
        place_object="recorded",
        seed=seed,
        free=free.words(),
    )
    loaded = load_words(words)
    free.require(SolverOptions(), loaded.motions[0])
    scene = worded_scene(loaded)
    print_notes(import_remarks(scene.hands[0].trajectory, trajectory))
    digest = write_scene_folder(scene, folder)
    if printing.as_json:
        names = sorted(path.name for path in folder.iterdir())
        print_json({"folder": str(folder), "scene": digest, "ticks": scene.ticks.tick_count, "files": names})
    elif not printing.quiet:
        ticks = counted(scene.ticks.tick_count, "tick")
        print_line(f"{scene.name}, {scene.hands[0].trajectory.name}: {ticks}, scene {digest[:12]}")
        print_line(f"send poses back as in {folder / EXAMPLE}: hhsim score {folder / EXAMPLE} measures them")
