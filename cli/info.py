"""`hhsim info`."""

import click

from hhsim.table.table import Table

from .arguments import options
from .console import print_json, print_table


@click.command()
@options.json
def command(as_json: bool) -> None:
    """Show versions, processor, clock and what is missing.

    Put it into every report of a fault; it names neither you nor the host.

    \b
    Examples:
      hhsim info
      hhsim info --json
    """
    from hhsim.system.environment import collect

    info = collect()
    if as_json:
        print_json(info.to_json())
        return
    changed = " with uncommitted changes" if info.revision.dirty is True else ""
    compiled = "compiled" if info.kernels.compiled else "not compiled yet: the first run does it, once"
    rows = [
        ("hhsim", info.hhsim),
        ("revision", f"{info.revision.commit}{changed}"),
        ("Python", info.machine.python),
        ("system", info.machine.system),
        ("processor", f"{info.machine.cpu}, {info.machine.cores} core{'s' * (info.machine.cores != 1)}"),
        ("clock", f"{info.clock.function}, source {info.clock.source}"),
        ("clock step", f"{info.clock.step * 1e9:.0f} ns seen, {info.clock.resolution * 1e9:.0f} ns stated"),
        ("kernels", compiled if info.kernels.jit else "interpreted: NUMBA_DISABLE_JIT is set"),
        ("kernel cache", info.kernels.folder),
        *sorted((name, version) for name, version in info.packages.items() if name != "hhsim"),
    ]
    for extra, names in info.missing.items():
        if extra != "required":
            rows.append(("missing", f"{', '.join(names)}: pip install 'hhsim[{extra}]'"))
    rows += [("missing", f"{name}: required") for name in info.missing.get("required", [])]
    print_table(Table.of_cells(("what", "value"), rows))
