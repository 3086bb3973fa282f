"""`hhsim trajectories`."""

from hhsim.table.table import Table, number, words

from .arguments.command import make_command
from .arguments.options import JSON, show


@make_command
def command(*, as_json: bool = JSON) -> None:
    """List the trajectories that come with hhsim.

    Any of the names, or a script or a recording of your own, goes into hhsim replay. Those for any object find their
    place on it; the others hold one object at named parts, such as the cup's handle. The column try has a command that
    shows the motion.

    \b
    Examples:
      hhsim trajectories
      hhsim replay cup handle
    """
    from hhsim.scene.motion_catalogue import describe, trajectory_names

    descriptions = [describe(name) for name in trajectory_names()]
    columns = (
        words("name"),
        words("what", "title"),
        words("try", "line"),
        words("object", lambda item: ", ".join(item.objects) or "any"),
        number("duration", "duration", "s", 1),
        number("rate", "rate", "Hz"),
        words("fingers", lambda item: ", ".join(item.fingers) or "none"),
        words("phases", lambda item: ", ".join(item.phases)),
        words("paper's figure", lambda item: ", ".join(item.figures)),
        words("stresses"),
    )
    document = {"trajectories": [item._asdict() for item in descriptions]}
    show(document, Table(columns, descriptions), as_json=as_json)
