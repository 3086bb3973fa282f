"""`hhsim objects`."""

import click

from . import options
from .console import print_json, print_table


@click.command()
@options.json
def command(as_json: bool) -> None:
    """List the objects that come with hhsim.

    Any of the names, or a mesh file of your own, goes into hhsim replay and hhsim build-tree. The level is that of
    the sphere tree that a replay uses unless told otherwise.

    \b
    Examples:
      hhsim objects
      hhsim objects --json
    """
    from hhsim.mesh.catalogue import load_object, object_names

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
                        "stresses": item.stresses,
                        "source": item.source,
                        "licence": item.licence,
                    }
                    for item in objects
                ]
            }
        )
        return
    rows = [
        (
            item.name,
            item.title,
            " × ".join(f"{1e3 * length:.0f}" for length in item.mesh.extent),
            f"{len(item.mesh.faces):,}",
            str(item.level),
            item.stresses,
            item.licence,
        )
        for item in objects
    ]
    columns = ("name", "what", "size [mm]", "triangles", "level", "stresses", "licence")
    print_table(columns, rows, numbers=("triangles", "level"))
