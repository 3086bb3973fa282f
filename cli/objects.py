"""`hhsim objects`."""

from collections.abc import Callable

import click

from .arguments import options
from .console import print_json, print_rows


@click.command()
@options.json
def command(as_json: bool) -> None:
    """List the objects that come with hhsim.

    Any of the names, or a mesh file of your own, goes into hhsim replay and hhsim build-tree. The level is that of
    the sphere tree that a replay uses unless told otherwise; the mass is that of the object where it is free.

    \b
    Examples:
      hhsim objects
      hhsim objects --json
    """
    from hhsim.mesh.catalogue import CatalogueObject, load_object, object_names

    objects = [load_object(name) for name in object_names()]
    if as_json:
        print_json(
            {
                "objects": [
                    {
                        "name": item.name,
                        "title": item.title,
                        "extent": item.mesh.extent.tolist(),
                        "triangles": len(item.mesh.faces),
                        "level": item.level,
                        "density": item.density,
                        "mass": item.density * item.mesh.volume,
                        "friction": item.friction,
                        "stresses": item.stresses,
                        "source": item.source,
                        "licence": item.licence,
                    }
                    for item in objects
                ]
            }
        )
        return
    cells: dict[str, Callable[[CatalogueObject], str]] = {
        "name": lambda item: item.name,
        "what": lambda item: item.title,
        "size [mm]": lambda item: " × ".join(f"{1e3 * length:.0f}" for length in item.mesh.extent),
        "triangles": lambda item: f"{len(item.mesh.faces):,}",
        "level": lambda item: str(item.level),
        "mass [g]": lambda item: f"{1e3 * item.density * item.mesh.volume:.0f}",
        "stresses": lambda item: item.stresses,
        "licence": lambda item: item.licence,
    }
    print_rows(cells, objects, words=cells.keys() - {"size [mm]", "triangles", "level", "mass [g]"})
