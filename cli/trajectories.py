"""`hhsim trajectories`."""

from collections.abc import Callable

import click

from .arguments import options
from .console import print_json, print_rows


@click.command()
@options.json
def command(as_json: bool) -> None:
    """List the trajectories that come with hhsim.

    Any of the names, or a script or a recording of your own, goes into hhsim replay. Those for any object
    find their place on whatever they are given, or put it where a recorded hand touches it; the others hold one object
    at named parts, such as the cup's handle.

    \b
    Examples:
      hhsim trajectories
      hhsim replay cup handle
    """
    from dataclasses import asdict

    from hhsim.scene.motion_catalogue import TrajectoryDescription, describe, trajectory_names

    descriptions = [describe(name) for name in trajectory_names()]
    if as_json:
        print_json({"trajectories": [asdict(item) for item in descriptions]})
        return
    cells: dict[str, Callable[[TrajectoryDescription], str]] = {
        "name": lambda item: item.name,
        "what": lambda item: item.title,
        "object": lambda item: ", ".join(item.objects) or "any",
        "duration [s]": lambda item: f"{item.duration:.1f}",
        "rate [Hz]": lambda item: f"{item.rate:,.0f}",
        "fingers": lambda item: ", ".join(item.fingers) or "none",
        "phases": lambda item: ", ".join(item.phases),
        "paper's figure": lambda item: ", ".join(item.figures),
        "stresses": lambda item: item.stresses,
    }
    print_rows(cells, descriptions, words=cells.keys() - {"duration [s]", "rate [Hz]"})
