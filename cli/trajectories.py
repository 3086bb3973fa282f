"""`hhsim trajectories`."""

import click

from hhsim.table.table import Table, number, words

from .arguments import options
from .console import print_json, print_table


@click.command(cls=options.Command)
@options.json
def command(as_json: bool) -> None:
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
    if as_json:
        print_json({"trajectories": [item._asdict() for item in descriptions]})
        return
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
    print_table(Table(columns, descriptions))
