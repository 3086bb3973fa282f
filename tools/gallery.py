"""The gallery, docs/gallery.md: films of named runs, the commands that make them, and the tables that they print.

python -m tools.gallery                 all of it
python -m tools.gallery door peg        these films anew
"""

import base64
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[1]
PAGE = REPOSITORY / "docs" / "gallery.md"
FILMS = PAGE.with_suffix("")
"""Folder of the films."""
WIDTH = 400
"""Width of a film [pixels]."""
MOST_BYTES, MOST_OF_ALL = 400_000, 4_000_000
"""Largest film, and all of them [byte]."""
FOLD = "<details><summary>What it prints</summary>"
HEADING = (
    "# Gallery\n\n"
    "Runs as films, each with the commands that make it and the table that it prints: skin is the graphic hand,\n"
    "which is shown; blue the haptic hand, the user's own; red are forces. `make gallery` makes this page and its\n"
    "films. Times in the tables are of the machine that made them.\n\n"
    "Grasp and whole hand can be turned with the mouse: on the site as a page of 1.1 MB that needs no network\n"
    "(`make site` puts three.js into it, so that the repository has none), in a checkout as a GLB file.\n"
)


class Tile(NamedTuple):
    """Film with what is seen in it, and the commands that make it: the last one's table is shown."""

    name: str
    title: str
    seen: str
    make: tuple[str, ...]
    result: str  # what is filmed
    faster: int = 1  # times that the film is faster than the motion

    @property
    def file(self) -> str:
        """Name of the film."""
        return f"{self.name}.webp"

    @property
    def commands(self) -> tuple[str, ...]:
        """Command lines."""
        slow = "" if self.faster == 1 else f" --slow {1 / self.faster:g}"
        film = f"hhsim view {self.result} --video {self.file} --pixels {WIDTH}{slow}"
        return (*self.make, film)


def replayed(name: str, title: str, seen: str, words: str, faster: int = 1) -> Tile:
    """Return the tile of a replay."""
    return Tile(name, title, seen, (f"hhsim replay {words} --out {name}.h5",), f"{name}.h5", faster)


TILES = (
    replayed("grasp", "Grasp", "Five fingers close around the Stanford bunny and stay outside of it.", "bunny grasp"),
    replayed(
        *("whole-hand", "Whole hand", "Palm and fingers at once, pulling against each other."), "bunny whole-hand"
    ),
    replayed(
        *("lift", "Lift", "A free cube is grasped, lifted by friction, and put down."),
        *("cube lift --free --torsion 5 --surface mesh", 2),
    ),
    replayed(
        *("lift-both", "Two hands lift", "Two hands press a free cube from both sides and lift it."),
        *("cube lift-both --hands both --free", 2),
    ),
    replayed(
        *("hand-over", "Hand-over", "The right hand gives a cup to the left one."),
        *("cup hand-over --hands both --free --surface mesh", 2),
    ),
    replayed("stack", "Stack", "A free block is set down on two others.", "blocks stack --surface mesh", 2),
    replayed("peg", "Peg", "A peg goes into a hole with half a millimetre to spare.", "peg insert --surface mesh", 2),
    replayed("door", "Door", "Fingertips push a door open, against its hinge's friction.", "door swing --surface mesh"),
    replayed("drawer", "Drawer", "A drawer is pushed shut, with what lies on it.", "drawer shut --surface mesh"),
    replayed(
        *("laptop", "Laptop", "A lid lifts the hand, which gives way."),
        "laptop open --surface mesh --fingers index,middle,ring,little",
    ),
    Tile(
        *("repair", "A repaired recording", "Blue: the recorded hand, 10 mm inside the mug. Skin: the repaired one."),
        ("hhsim repair grab.csv --object mug.stl --unit mm --out grab-free.csv",),
        "grab-free-result.h5",
    ),
)
INPUTS = ("grab.csv", "mug.stl")
"""Files of examples/ that commands read."""
COARSE = 4, 14
"""Rings and sides of a phalanx on these pages."""
LOOK = 75.0, 0.0, -30.0
"""Euler angles of the camera of these pages [degrees]."""
TURNED = {"grasp": 1500, "whole-hand": 1500}
"""Tick of each run that is a scene to turn, too."""
BODY = (
    """<main><h1 style="position: fixed; margin: 1em; font: 1rem system-ui">{}</h1><div id="container"></div></main>"""
)
TURNED_LINK = "[Turn it in three dimensions](gallery/{}.glb), tick {:,}.\n\n"


def made(tile: Tile, folder: Path) -> str:
    """Run the commands of a tile in a folder, keep its film, and return what the last one of `Tile.make` printed."""
    for name in INPUTS:
        shutil.copy(REPOSITORY / "examples" / name, folder)
    environment = {**os.environ, "COLUMNS": "160"}
    printed = []
    for line in tile.commands:
        program = [str(Path(sys.executable).with_name("hhsim")), *shlex.split(line)[1:]]
        answer = subprocess.run(program, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True, check=True)
        printed.append(answer.stdout)
    FILMS.mkdir(exist_ok=True)
    shutil.copy(folder / tile.file, FILMS)
    if tile.name in TURNED:
        (FILMS / f"{tile.name}.glb").write_bytes(scene_to_turn(folder / tile.result, TURNED[tile.name]))
    size = (FILMS / tile.file).stat().st_size
    if size > MOST_BYTES:
        sys.exit(f"{tile.file} has {size:,} bytes, the most are {MOST_BYTES:,}: make it faster or smaller")
    return printed[len(tile.make) - 1]


def section(tile: Tile, printed: str) -> str:
    """Return the section of a tile."""
    commands = "\n".join(f"$ {line}" for line in tile.commands)
    table = "\n".join(line.rstrip() for line in printed.strip().splitlines())
    turned = TURNED_LINK.format(tile.name, TURNED[tile.name]) if tile.name in TURNED else ""
    return (
        f"\n## {tile.title}\n\n{tile.seen}\n\n![{tile.title}: {tile.seen}](gallery/{tile.file})\n\n{turned}"
        f"```console\n{commands}\n```\n\n{FOLD}\n\n```text\n{table}\n```\n\n</details>\n"
    )


def page_of(printed: dict[str, str]) -> str:
    """Return the page with the tiles whose tables are known, by the titles of their sections."""
    return HEADING + "".join(section(tile, printed[tile.title]) for tile in TILES if tile.title in printed)


def tables(page: str) -> dict[str, str]:
    """Return what the page has as printed, by the title of its section."""
    sections = (part.partition("\n") for part in page.split("\n## ")[1:])
    return {title: body.split("```text\n")[1].split("\n```")[0] for title, _, body in sections}


def scene_to_turn(path: Path, tick: int) -> bytes:
    """Return a tick of a result, hands and object, as a GLB file."""
    import trimesh

    from hhsim.render.triangle_soup import STONE, mesh_surface, piece_surfaces
    from hhsim.result.reader import load_result
    from hhsim.view.scene_log import moment
    from hhsim.view.viewer import shown_scene

    result = load_result(path)
    shown = shown_scene(result)
    now = moment(result, shown, tick, piece_surfaces(shown.hand, *COARSE))
    object_ = mesh_surface(shown.placed(result.meshes_moved(tick)), STONE)
    scene, looks = cast(Any, trimesh.Scene()), cast(Any, trimesh.visual)
    for name, surface, opacity in (
        ("graphic", now.graphic, 1.0),
        ("haptic", now.haptic, 0.35),
        ("object", object_, 1.0),
    ):
        # Corners that were split for their normals become one: a third of the bytes.
        mesh: Any = trimesh.Trimesh(surface.points, surface.faces, process=False)
        mesh.merge_vertices(digits_vertex=6)
        paint = np.rint(255.0 * np.append(0.75 * np.median(surface.colors, axis=0), opacity)).astype(np.uint8)
        blend = {"alphaMode": "BLEND"} if opacity < 1.0 else {}
        material = looks.material.PBRMaterial(
            baseColorFactor=paint, metallicFactor=0.0, roughnessFactor=0.7, doubleSided=True, **blend
        )
        mesh.visual = looks.TextureVisuals(material=material)
        assert len(mesh.vertex_normals) == len(mesh.vertices)  # computed here, they are exported
        scene.add_geometry(mesh, geom_name=name)
    scene.set_camera(angles=np.radians(LOOK))
    return bytes(scene.export(file_type="glb"))


def page_to_turn(name: str) -> str:
    """Return the scene of a tile as one page that needs no network: trimesh's, which has three.js in it."""
    from trimesh import resources, util

    tile = next(tile for tile in TILES if tile.name == name)
    held: Any = util.decompress(resources.get_bytes("templates/viewer.zip"), file_type="zip")
    page = held["viewer.html.template"].read().decode("utf-8")
    page = page.replace("$B64GLTF", base64.b64encode((FILMS / f"{name}.glb").read_bytes()).decode())
    head = f'<title>{tile.title} - hhsim</title><link rel="icon" href="../assets/images/favicon.png">'
    page = re.sub(r"<title>.*?</title>", head, page)
    page = re.sub(r'<meta name="viewport"[^>]*>', '<meta name="viewport" content="width=device-width">', page)
    words = f'<a href="../gallery.html">Gallery</a>: {tile.title}. Drag to turn, scroll to zoom.'
    return page.replace('<div id="container"></div>', BODY.format(words))


def main(words: list[str]) -> None:
    """Make films and page."""
    kept = tables(PAGE.read_text()) if PAGE.exists() else {}
    for tile in TILES:
        if not words or tile.name in words:
            with tempfile.TemporaryDirectory() as folder:
                kept[tile.title] = made(tile, Path(folder))
            print(f"{tile.file}: {(FILMS / tile.file).stat().st_size:,} bytes", flush=True)
            PAGE.write_text(page_of(kept))


if __name__ == "__main__":
    main(sys.argv[1:])
