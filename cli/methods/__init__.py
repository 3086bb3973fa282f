"""`hhsim methods`: the list, and a test of one."""

import click

from hhsim.table.table import Table, words

from ..arguments import options
from ..arguments.lazy_group import LazyGroup
from ..console import print_json, print_line, print_table

COMMANDS = {"check": "Tell what is wrong with a method from outside."}
"""Subcommands, each with its one line."""


@options.json
@click.pass_context
def _list(context: click.Context, as_json: bool) -> None:
    """List every method with its promises."""
    if context.invoked_subcommand is not None:
        return
    from hhsim.errors import InputError
    from hhsim.solver.known_methods import find_method
    from hhsim.solver.method_names import declared_methods, method_names

    found, broken = {}, {}
    for name in method_names():
        try:
            found[name] = find_method(name)
        except InputError as error:
            broken[name] = str(error)
    yes = {True: "yes", False: "–"}
    home = {name: entry.dist.name if entry.dist else "?" for name, entry in declared_methods().items()}
    columns = (
        words("name", str),
        words("what", lambda name: found[name].summary),
        words("installed", lambda name: yes[not found[name].missing]),
        words("from", lambda name: home.get(name, "hhsim")),
        words("never inside", lambda name: yes[found[name].never_penetrates]),
        words("nearest", lambda name: yes[found[name].nearest_to_user]),
        words("gives", lambda name: "everything" if found[name].compiled else ", ".join(sorted(found[name].gives))),
    )
    if as_json:
        same = ("never_penetrates", "nearest_to_user", "missing", "summary")
        documents = [
            {"name": name, "from": home.get(name, "hhsim"), "gives": sorted(method.gives)}
            | {field: getattr(method, field) for field in same}
            for name, method in found.items()
        ]
        print_json({"methods": documents, "broken": broken})
        return
    print_table(Table(columns, list(found)))
    for missing in dict.fromkeys(method.missing for method in found.values() if method.missing):
        names = ", ".join(name for name, method in found.items() if method.missing == missing)
        print_line(f"note: {names}: {missing}")
    for why in broken.values():
        print_line(f"note: {why}")


command = LazyGroup(
    "methods",
    COMMANDS,
    module=lambda name: f"methods.{name}",
    params=_list.__click_params__,  # type: ignore[attr-defined]
    short_help="List the methods, and test one from outside.",
    invoke_without_command=True,
    subcommand_metavar="[check NAME]",
    help="""List the methods, what each promises, and test one from outside.

    Any of the names goes into hhsim replay --method, and so does package.module:Class: a class of your own, in the
    current folder or installed. A package declares its methods as entry points of the group "hhsim.methods".

    \b
    Examples:
      hhsim methods
      hhsim methods check my_module:MyMethod
      hhsim replay bunny grasp --method my_module:MyMethod
    """,
    callback=_list,
)
