"""`hhsim bench`: one subcommand a suite, imported when it is run."""

from ..arguments.lazy_group import LazyGroup, show_help

SUITES = {
    "paper": "The paper's whole evaluation, Figs. 11 to 15: its figures beside ours, in one run.",
    "speed-error": "Methods, tree levels, linearisations and QP solvers: what a tick costs against how far off it is.",
    "peers": "MuJoCo beside our methods: the same hand, scenes and judge.",
    "manipulation": "Free objects with friction: known answers, and a pinch beside MuJoCo.",
    "hard": "Every hard case, for every method: pass or fail, and the figure.",
    "stress": "Random targets on any object, as long as you like; a failing motion is kept, shrunk to a few ticks.",
    "recorded": "Recordings of real hands against any objects: penetration, force variation, time, lag, stuck.",
    "trees": "Sphere trees: error against spheres against CPU time, beside other programs.",
}
"""Suites with one line each."""

command = LazyGroup(
    "bench",
    SUITES,
    module=lambda name: f"bench.{name.replace('-', '_')}",
    kind="suite",
    short_help="Measure the methods against each other: speed, error, stress.",
    invoke_without_command=True,
    subcommand_metavar="SUITE [ARGS]...",
    help="""Measure the methods against each other, on the same scenes, in one run.

    Every suite takes --json and --out, as a replay does. Times are CPU times of a thread unless a heading says
    otherwise; compare them within one run, not between machines.

    \b
    Examples:
      hhsim bench hard
      hhsim bench speed-error --out tradeoff.h5
    """,
    callback=show_help,
)
