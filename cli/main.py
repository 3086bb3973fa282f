"""Command `hhsim`: a group that imports a command only when it is run, and reports all errors."""

import errno
import gc
import json
import os
import signal
import sys
import warnings
from typing import Any

import click

from hhsim import __version__
from hhsim.errors import HhsimError

from .arguments.command import LazyGroup, imported
from .console import prepare_streams, print_error, print_notes

COMMANDS = {
    "replay": "Replay a hand motion against an object, every tick measured.",
    "repair": "Repair a recording of a hand: the same, without penetration.",
    "sweep": "Replay all that a plan names, each with each, and resume.",
    "live": "Put a glove in the loop at 1 kHz, safely, and record it.",
    "compare": "Set the figures of two results side by side.",
    "export": "Write the ticks of a result as a table.",
    "view": "Look at results in the rerun viewer.",
    "report": "Make one HTML page of results: figures, curves, worst ticks.",
    "verify": "Check a result: seal, second run, physics by other code.",
    "objects": "List the objects that come with hhsim.",
    "trajectories": "List the trajectories that come with hhsim.",
    "examples": "Copy the examples that come with hhsim to a folder.",
    "methods": "List the methods, and test one from outside.",
    "scene": "Write a scene as files for other software to solve.",
    "score": "Measure the poses that other software made of a scene.",
    "import": "Make a trajectory of a recording of a hand.",
    "bench": "Measure the methods against each other: speed, error, stress.",
    "gate": "Judge a change for CI: errors, work and time, yes or no.",
    "build-tree": "Cover an object, or a robot, with spheres, with a proof.",
    "doctor": "Tell whether this machine keeps 1 kHz, and if not, why.",
    "info": "Show versions, processor and what is missing.",
}
"""Commands with one line each; a command's module is named like it, with underscores, and holds `command`."""

KEYWORDS = {"import": "import_"}
"""Modules of commands whose name no module can have."""

COMPLETION_VARIABLE = "_HHSIM_COMPLETE"
SHOW_AS_USUAL = warnings.showwarning
NO_MEMORY = "can't start new thread", "failed to map segment", "returned NULL without setting"
"""Words of errors that Python and the system's loader raise where memory is short."""
INTERRUPTED = 130
BROKEN_PIPE = 141
MANY_OBJECTS = 10_000
"""New objects after which the collector looks for circles."""


hhsim = LazyGroup(
    "hhsim",
    lambda: COMMANDS,
    lambda name: imported(KEYWORDS.get(name, name.replace("-", "_"))),
    subcommand_metavar="[COMMAND] [ARGS]...",
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
    help="""Replay a hand against a virtual object, and measure speed, contact and force at every tick.

    \b
    Start with:
      hhsim replay                    a five-finger grasp of the bunny
      hhsim replay cube pinch         another object, another motion
      hhsim replay mug.stl --unit mm  your own mesh

    Every command takes --json for machines. Exit codes: 0 ok, 1 a limit was missed, 2 usage or bad input, 3 cannot
    compare.
    """,
)
click.version_option(__version__, message="hhsim %(version)s")(hhsim)


def main() -> None:
    """Run the command line and exit: the entry point."""
    # Most of a command's objects stay: to look for circles whenever 700 more are there takes a twentieth of a replay.
    gc.set_threshold(MANY_OBJECTS)
    prepare_streams()
    warnings.showwarning = _show_warning
    wanted = os.environ.get(COMPLETION_VARIABLE)
    if wanted:
        from click.shell_completion import shell_complete

        sys.exit(shell_complete(hhsim, {}, "hhsim", COMPLETION_VARIABLE, wanted))
    try:
        code = _run_and_report()
        sys.stdout.flush()
    except OSError as error:
        # What is buffered must not raise again when the interpreter closes stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = BROKEN_PIPE if isinstance(error, BrokenPipeError) else HhsimError.exit_code
        # A closed pipe wants no more; an error that occurs while another is reported is on stderr already.
        if code != BROKEN_PIPE and error.__context__ is None:
            print(f"hhsim: error: cannot print the answer: {error.strerror or error}", file=sys.stderr)
    # At its end the interpreter looks through all objects, several times: an eighth of a replay.
    gc.freeze()
    sys.exit(code)


def _show_warning(message: Warning | str, category: type[Warning], *place: Any, **named: Any) -> None:
    """Print a warning about the cache in one line, any other as Python does."""
    from hhsim.kernels.cache_folder import CacheFolderWarning

    if issubclass(category, CacheFolderWarning):
        print_notes([str(message)])
    else:
        SHOW_AS_USUAL(message, category, *place, **named)


def _run_and_report() -> int:
    """Run the command and report errors; only a stdout that cannot be written is raised."""
    try:
        with hhsim.make_context("hhsim", sys.argv[1:]) as context:
            answer = hhsim.invoke(context)
        return answer if isinstance(answer, int) else 0
    except click.exceptions.Exit as done:
        return done.exit_code
    except HhsimError as error:
        return _report(str(error), error.exit_code, error)
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "hhsim"
        return _report(f"{error.format_message().rstrip('.')} (see {command} --help)", error.exit_code)
    except click.ClickException as error:
        return _report(error.format_message(), error.exit_code)
    except KeyboardInterrupt as interrupt:
        # A second Ctrl-C must not cut the answer short.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        return _report("interrupted", INTERRUPTED, interrupt)
    except BrokenPipeError:
        raise
    except (OSError, MemoryError, RuntimeError, ImportError, SystemError) as error:
        refused = isinstance(error, OSError) and error.errno == errno.ENOMEM
        if refused or isinstance(error, MemoryError) or any(words in str(error) for words in NO_MEMORY):
            # numpy spells out every field of a record.
            line = (
                f"not enough memory: {error}".partition(" and data type {")[0].rstrip(": ")
                + "; raise a limit that is set (ulimit -v), or use less"
            )
            return _report(line, HhsimError.exit_code, error)
        if not isinstance(error, OSError):
            raise
        from hhsim.kernels.cache_folder import cache_root

        place = f"stdout, or the cache in {cache_root()}, for which HHSIM_CACHE_DIR names another folder"
        return _report(f"{error.strerror or error}: {error.filename or place}", HhsimError.exit_code, error)


def _report(message: str, code: int, error: BaseException | None = None) -> int:
    """Report an error with its notes: one line on stderr and, with --json, one JSON document on stdout."""
    line = " ".join("; ".join([message, *getattr(error, "__notes__", ())]).split())
    print_error(f"hhsim: {line}" if code == INTERRUPTED else f"hhsim: error: {line}")
    if "--json" in sys.argv:
        print(json.dumps({"error": line}), flush=True)
    return code
