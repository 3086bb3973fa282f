"""`hhsim info`."""

from hhsim.system.counted import counted
from hhsim.table.table import Table

from .arguments.command import make_command
from .arguments.options import JSON, show


@make_command
def command(*, as_json: bool = JSON) -> None:
    """Show versions, processor and what is missing.

    Put it into every report of a fault; it names neither you nor the host.

    \b
    Examples:
      hhsim info
      hhsim info --json
    """
    from hhsim.system.environment import collect

    info = collect()
    machine, kernels = info["machine"], info["kernels"]
    changed = " with uncommitted changes" if info["revision"]["dirty"] is True else ""
    compiled = "compiled" if kernels["compiled"] else "not compiled yet: the first run does it, once"
    rows = [
        ("hhsim", info["hhsim"]),
        ("revision", f"{info['revision']['commit']}{changed}"),
        ("Python", machine["python"]),
        ("system", machine["system"]),
        ("processor", f"{machine['cpu']}, {counted(machine['cores'], 'core')}"),
        ("kernels", compiled),
        ("kernel cache", kernels["folder"]),
        *sorted((name, version) for name, version in info["packages"].items() if name != "hhsim"),
    ]
    for extra, names in info["missing"].items():
        if extra != "required":
            rows.append(("missing", f"{', '.join(names)}: pip install 'hhsim[{extra}]'"))
    rows += [("missing", f"{name}: required") for name in info["missing"].get("required", [])]
    show(info, Table.of_cells(("what", "value"), rows), as_json=as_json)
