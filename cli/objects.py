"""`hhsim objects`."""

from hhsim.table.table import Table, number, words

from .arguments.command import make_command
from .arguments.options import JSON, show


@make_command
def command(*, as_json: bool = JSON) -> None:
    """List the objects that come with hhsim.

    Any of the names, or a mesh, URDF or MJCF file of your own, goes into hhsim replay and hhsim build-tree. The level
    is that of the usual sphere tree; the mass is that of the object where it is free.

    \b
    Examples:
      hhsim objects
      hhsim objects --json
    """
    from hhsim.mesh.catalogue import load_object, object_names

    objects = [load_object(name) for name in object_names()]
    same = ("name", "title", "level", "density", "friction", "stresses", "source", "licence")
    documents = [
        {name: getattr(item, name) for name in same}
        | {"extent": item.mesh.extent.tolist(), "triangles": len(item.mesh.faces)}
        | {"mass": item.density * item.mesh.volume}
        for item in objects
    ]
    columns = (
        words("name"),
        words("what", "title"),
        number("size", lambda item: " × ".join(f"{1e3 * length:.0f}" for length in item.mesh.extent), "mm"),
        number("triangles", lambda item: len(item.mesh.faces)),
        number("level"),
        number("mass", lambda item: item.density * item.mesh.volume, "g"),
        *map(words, ("stresses", "licence")),
    )
    show({"objects": documents}, Table(columns, objects), as_json=as_json)
