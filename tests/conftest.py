"""What test modules share: the hypothesis profile, the folder of real meshes and recordings, the command line."""

import atexit
import contextlib
import functools
import gc
import importlib
import importlib.metadata
import io
import json
import os
import signal
import sys
from collections.abc import Callable, Generator, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from file_faults import know_as_sound
from hypothesis import HealthCheck, is_hypothesis_test, settings

from hhsim.registry import declared
from hhsim.trees import cache as shipped

settings.register_profile(
    "hhsim", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=False
)
settings.load_profile("hhsim")

# Whoever starts the tests in the background hands on signals that are ignored; commands under test would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGQUIT, signal.SIG_DFL)
signal.signal(signal.SIGHUP, signal.SIG_DFL)

# As many workers as processors: threads of BLAS would wait for a processor that another worker has, and burn their own
# while they wait. Read when numpy is loaded, here and in the processes that tests start.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# To collect thousands of tests makes much and frees little, which the collector would look through a hundred times.
gc.disable()

# Hands and objects are made by the hundred, most of them when test files are imported, and their trees do not change.
read_tree, read_shipped_tree = shipped.load_tree, functools.cache(shipped.load_tree)
shipped.load_tree = lambda path, **given: (read_shipped_tree if given else read_tree)(path, **given)

REPOSITORY = Path(__file__).resolve().parent.parent


DIVIDED = ("tests/test_damaged_files.py", "tests/test_readme_commands.py", "tests/kernels/surfaces/test_mesh.py")
"""Files that take the soak so long that several workers share each, kind by kind of its cases."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With `-n`, a file's tests run in one worker, in the order of the files: what they share is made once."""
    from xdist.scheduler.loadfile import LoadFileScheduling

    class Scheduling(LoadFileScheduling):  # type: ignore[misc]  # xdist has no types
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.partition("::")[0]
            return nodeid.partition("-")[0] if file in DIVIDED and config.option.markexpr == "soak" else file

    config.option.loadscopereorder = False
    return Scheduling(config, log)


def pytest_collection(session: pytest.Session) -> None:
    """Have each worker import the test files from another one on.

    Each has to import them all. Where they would do so in one order, each would rewrite every file's assertions and
    compile every library anew; so does each find what the others have left.
    """
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    if workers == 1 or session.config.args_source is not pytest.Config.ArgsSource.TESTPATHS:
        return
    files = sorted((REPOSITORY / "tests").rglob("test_*.py"))
    first = len(files) * int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw")) // workers
    for file in files[first:] + files[:first]:
        # What cannot be imported is told, or skipped, when it is collected.
        with contextlib.suppress(Exception, pytest.skip.Exception):
            importlib.import_module(".".join(file.relative_to(REPOSITORY).with_suffix("").parts))


PART_OF_EXAMPLES = 4
"""`make test` tries a property on a quarter of the examples that its test asks for, `make soak` on all of them."""


def sample_examples(items: list[pytest.Item], soak: bool) -> None:
    """Ask for a part of the examples of every property, or have its test in the soak with all of them."""
    properties = [item for item in items if isinstance(item, pytest.Function) and is_hypothesis_test(item.obj)]
    if soak:
        for item in properties:
            item.add_marker(pytest.mark.soak)
        return
    for test in {item.function for item in properties}:
        asked = test._hypothesis_internal_use_settings
        part = settings(asked, max_examples=-(-asked.max_examples // PART_OF_EXAMPLES))
        test._hypothesis_internal_use_settings = part


def leave_to_soak(items: list[pytest.Item], whole: bool) -> None:
    """Have those cases of a test in the soak that its `quick` marker does not name.

    Raises:
        pytest.UsageError: It names a case that there is none of, where the whole suite is collected.
    """
    missing: dict[str, set[str]] = {}
    for item in items:
        mark = item.get_closest_marker("quick")
        if mark is not None and isinstance(item, pytest.Function):
            case, test = item.callspec.id, item.nodeid.partition("[")[0]
            missing.setdefault(test, set(mark.args)).discard(case)
            if case not in mark.args:
                item.add_marker(pytest.mark.soak)
    wrong = [f"{test}[{case}]" for test, cases in missing.items() for case in sorted(cases)]
    if whole and wrong:
        raise pytest.UsageError(f"quick names cases that there are none of: {', '.join(wrong)}")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with the files that take longest, so that no worker is left with one of them at the end."""
    sample_examples(items, soak=config.option.markexpr == "soak")
    leave_to_soak(items, whole=config.args_source is pytest.Config.ArgsSource.TESTPATHS)
    long = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in long)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    """Note at a test that it failed, for what it shares with others."""
    report: Any = yield
    setattr(item, "has_failed", getattr(item, "has_failed", False) or report.failed)  # noqa: B010
    return report


def pytest_collection_finish() -> None:
    """Have the collector look from here on, at what is made from here on.

    What was set aside is freed when the process ends, as some libraries expect, and after pytest has had it looked
    through twice.
    """
    gc.freeze()
    gc.enable()
    atexit.register(gc.unfreeze)


@pytest.fixture(scope="session", autouse=True)
def own_results_are_sound() -> Iterator[None]:
    """A result that this process has written is not read by a child first, which takes as long as half a replay."""
    from hhsim.result.writer import ResultWriter

    finish = ResultWriter.finish

    def finished(self: ResultWriter, *arguments: Any, **options: Any) -> Path:
        path = finish(self, *arguments, **options)
        know_as_sound(path)
        return path

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ResultWriter, "finish", finished)
        yield


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the checkout that these tests stand in."""
    return REPOSITORY


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real meshes and recordings that the repository does not carry; skips where there is none."""
    folder = Path(os.environ.get("HHSIM_SHARED_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder}: set HHSIM_SHARED_DATA to the folder that holds meshes/ and recordings/")
    return folder


class Terminal(io.StringIO):
    """What is shown in a terminal."""

    def isatty(self) -> bool:
        return True


class Answer(NamedTuple):
    """What a command line gave back."""

    code: int
    out: str
    err: str

    def document(self, code: int = 0) -> Any:
        """The JSON that it printed as it ended with this code."""
        assert self.code == code, self.err
        return json.loads(self.out)


Run = Callable[..., Answer]

REACHED: list[str] = []
"""Other machines that this process went to or asked the address of."""


def note_reached(event: str, values: tuple[Any, ...]) -> None:
    """Note who is reached by what Python audits; a name of the file system is a socket of this machine."""
    if event in ("socket.connect", "socket.sendto", "socket.sendmsg", "socket.getaddrinfo", "socket.gethostbyname"):
        where = values[0] if event.startswith("socket.get") else values[1]
        host = where[0] if isinstance(where, tuple) else where if event.startswith("socket.get") else None
        if host not in (None, "", "localhost", "127.0.0.1", "::1"):
            REACHED.append(f"{event} {host}")


sys.addaudithook(note_reached)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    """Run `hhsim` with the given arguments by its entry point, in an empty folder; it reaches no other machine."""
    monkeypatch.chdir(tmp_path)
    (entry,) = importlib.metadata.entry_points(group="console_scripts", name="hhsim")

    def called(*arguments: str) -> Answer:
        monkeypatch.setattr(sys, "argv", ["hhsim", *arguments])
        handler = signal.getsignal(signal.SIGINT)
        REACHED.clear()
        try:
            with pytest.raises(SystemExit) as exit_:
                entry.load()()
        finally:
            signal.signal(signal.SIGINT, handler)
        assert REACHED == []
        captured = capsys.readouterr()
        assert isinstance(exit_.value.code, int)
        return Answer(exit_.value.code, captured.out, captured.err)

    return called


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Install a package `others` with entry points of a group, and with modules: their names and sources."""
    site = tmp_path / "site"

    def install(group: str, *lines: str, **modules: str) -> None:
        info = site / "others-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines]))
        for name, source in modules.items():
            (site / f"{name}.py").write_text(source)
            monkeypatch.delitem(sys.modules, name, raising=False)
        monkeypatch.syspath_prepend(str(site))
        declared.cache_clear()

    yield install
    declared.cache_clear()


@pytest.fixture
def read_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Foreign files are read in this process: tests/system/test_files.py shows what a child is for."""

    def call(work: Callable[[], None], *limits: float) -> int:
        work()
        return 0

    monkeypatch.setattr("hhsim.system.child_reader.call_in_child", call)


@pytest.fixture
def ended() -> Iterator[None]:
    """What waits for a pipe is ended, and its test fails."""
    before = signal.signal(signal.SIGALRM, lambda *_: pytest.fail("it waits"))
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def sampled(cases: Iterable[Any], keep: Callable[[int, Any], bool]) -> list[Any]:
    """The cases for `pytest.mark.parametrize`; those that `keep(place, case)` does not name are marked soak."""
    return [
        case
        if keep(place, case)
        else pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.soak)
        for place, case in enumerate(cases)
    ]
