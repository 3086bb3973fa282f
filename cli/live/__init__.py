"""`hhsim live`: one subcommand a kind of device, imported when it is run."""

from ..arguments.command import LazyGroup, imported

command = LazyGroup(
    "live",
    lambda: {"glove": "A data glove in the loop: its hand against an object, forces back to its fingers."},
    lambda name: imported(f"live.{name}"),
    subcommand_metavar="COMMAND [ARGS]...",
    help="""Put a glove in the loop at 1 kHz, safely, and record it.

    A session is recorded as a result file: hhsim replay runs its ticks again, and takes it for a trajectory too.

    \b
    Examples:
      hhsim live glove --device sim
      hhsim live glove cube --device dexmo --host 127.0.0.1
    """,
)
