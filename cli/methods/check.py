"""`hhsim methods check`."""

import click

from hhsim.table.table import Table, words

from ..arguments import options
from ..console import announce_compilation, print_json, print_line, print_table


@click.command(cls=options.Command)
@click.argument("name")
@options.json
def command(name: str, as_json: bool) -> int:
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
    if as_json:
        print_json({"method": name, "passed": not wrong, "findings": [finding._asdict() for finding in findings]})
        return int(bool(wrong))
    print_table(Table([words("", of) for of in ("name", "verdict", "says")], findings))
    print_line(f"{name}: {wrong} of {len(findings)} are wrong" if wrong else f"{name} can be measured")
    return int(bool(wrong))
