"""`hhsim scene`."""

from pathlib import Path

from hhsim.system.counted import counted

from .arguments.command import make_command, option
from .arguments.object_options import OBJECT, MeshSize
from .arguments.options import SEED, TREE_LEVEL, WHICH_HANDS, AnySeed, OneLevel, OutPath, Printing, Sides
from .arguments.scene_options import TRAJECTORY, FreeChoice, Sampling, scene_words
from .console import print_notes


@make_command
def command(
    *,
    object_: str = OBJECT,
    trajectory: str = TRAJECTORY,
    mesh_size: MeshSize,
    level: OneLevel | None = TREE_LEVEL,
    side: Sides | None = WHICH_HANDS,
    free: FreeChoice,
    sampling: Sampling,
    seed: AnySeed = SEED,
    out: OutPath | None = option("Folder, which must be new or empty. Default: a dated name in results/.", "DIR"),
    printing: Printing,
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
    from hhsim.scene.described_scene import load_words
    from hhsim.scene.motion_catalogue import import_remarks
    from hhsim.submissions.scene_folder import EXAMPLE, check_scene_folder, worded_scene, write_scene_folder
    from hhsim.system.output_path import dated_output_path

    folder = out or dated_output_path(f"{Path(object_).stem}-{Path(trajectory).stem}-scene", "")
    check_scene_folder(folder)
    more = {"unit": mesh_size.unit, "size_mm": mesh_size.size, "level": level, "hand": side, "seed": seed}
    loaded = load_words(scene_words(object_, trajectory, free, sampling, place_object="recorded", **more))
    free.check_motion(loaded.motions[0])
    scene = worded_scene(loaded)
    print_notes(import_remarks(scene.hands[0].trajectory, trajectory))
    digest, ticks = write_scene_folder(scene, folder), scene.ticks.tick_count
    names = sorted(path.name for path in folder.iterdir())
    printing.show(
        {"folder": str(folder), "scene": digest, "ticks": ticks, "files": names},
        f"{scene.name}, {scene.hands[0].trajectory.name}: {counted(ticks, 'tick')}, scene {digest[:12]}",
        f"send poses back as in {folder / EXAMPLE}: hhsim score {folder / EXAMPLE} measures them",
    )
