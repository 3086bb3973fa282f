"""`hhsim info`."""

import click

from hhsim.system.counted import counted
from hhsim.table.table import Table

from .arguments import options
from .console import print_json, print_table


@click.command(cls=options.Command)
@options.json
def command(as_json: bool) -> None:
    """Show versions, processor and what is missing.

    Put it into every report of a fault; it names neither you nor the host.

    \b
    Examples:
      hhsim info
      hhsim info --json
    """
    from hhsim.system.environment import collect

    info = collect()
    if as_json:
        print_json(info)
        return
    machine, kernels = info["machine"], info["kernels"]
    changed = " with uncommitted changes" if info["revision"]["dirty"] is True else ""
    compiled = "compiled" if kernels["compiled"] else "not compiled yet: the first run does it, once"
    rows = [
        ("hhsim", info["hhsim"]),
        ("revision", f"{info['revision']['commit']}{changed}"),
        ("Python", machine["python"]),
        ("system", machine["system"]),
        ("processor", f"{machine['cpu']}, {counted(machine['cores'], 'core')}"),
        ("kernels", compiled if kernels["jit"] else "interpreted: NUMBA_DISABLE_JIT is set"),
        ("kernel cache", kernels["folder"]),
        *sorted((name, version) for name, version in info["packages"].items() if name != "hhsim"),
    ]
    for extra, names in info["missing"].items():
        if extra != "required":
            rows.append(("missing", f"{', '.join(names)}: pip install 'hhsim[{extra}]'"))
    rows += [("missing", f"{name}: required") for name in info["missing"].get("required", [])]
    print_table(Table.of_cells(("what", "value"), rows))
