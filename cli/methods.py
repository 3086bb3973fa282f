"""`hhsim methods`: the list, and a test of one."""

import click

from hhsim.table.table import Table, words

from .arguments.command import LazyGroup, argument, make_command
from .arguments.options import JSON, show
from .console import announce_compilation


@click.pass_context
def _list(context: click.Context, as_json: bool) -> None:
    """List every method with its promises."""
    if context.invoked_subcommand is not None:
        return
    from hhsim.errors import InputError
    from hhsim.solver.method import declared_methods, find_method, method_names

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
    same = ("never_penetrates", "nearest_to_user", "missing", "summary")
    documents = [
        {"name": name, "from": home.get(name, "hhsim"), "gives": sorted(method.gives)}
        | {field: getattr(method, field) for field in same}
        for name, method in found.items()
    ]
    lacking = [
        f"{', '.join(name for name, method in found.items() if method.missing == missing)}: {missing}"
        for missing in dict.fromkeys(method.missing for method in found.values() if method.missing)
    ]
    notes = [f"note: {note}" for note in (*lacking, *broken.values())]
    show({"methods": documents, "broken": broken}, Table(columns, list(found)), *notes, as_json=as_json)


@make_command
def check(*, name: str = argument(), as_json: bool = JSON) -> int:
    """Tell what is wrong with a method from outside.

    NAME is a name of hhsim methods, or package.module:Class. It grasps a ball twice, and its answers are checked:
    shapes, units, frames, depth, forces, times. The exit code is 1 where something is wrong.

    \b
    Examples:
      hhsim methods check my_module:MyMethod
      hhsim methods check penalty
    """
    from hhsim.replay.conformance import WRONG, check_method

    announce_compilation(quiet=as_json)
    findings = list(check_method(name))
    wrong = sum(finding.verdict == WRONG for finding in findings)
    show(
        {"method": name, "passed": not wrong, "findings": [finding._asdict() for finding in findings]},
        Table([words("", of) for of in ("name", "verdict", "says")], findings),
        f"{name}: {wrong} of {len(findings)} are wrong" if wrong else f"{name} can be measured",
        as_json=as_json,
    )
    return int(bool(wrong))


command = LazyGroup(
    "methods",
    lambda: {"check": "Tell what is wrong with a method from outside."},
    lambda name: check,
    params=[JSON.parameter("as_json", bool)],
    subcommand_metavar="[check NAME]",
    help="""List the methods, and test one from outside.

    The list says what each promises. Any of the names goes into hhsim replay --method, and so does
    package.module:Class: a class of your own, in the current folder or installed. A package declares its methods as
    entry points of the group "hhsim.methods".

    \b
    Examples:
      hhsim methods
      hhsim methods check my_module:MyMethod
      hhsim replay bunny grasp --method my_module:MyMethod
    """,
    callback=_list,
)
