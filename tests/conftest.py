"""What test modules share: the hypothesis profile, the folder of real meshes and recordings, the command line."""

import gc
import importlib.metadata
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import HealthCheck, settings

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

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With `-n`, a file's tests run in one worker, in the order of the files: what they share is made once."""
    from xdist.scheduler.loadfile import LoadFileScheduling

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest, so that no worker is left with one of them at the end."""
    long = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in long)


def pytest_collection_finish() -> None:
    """Have the collector look from here on, at what is made from here on."""
    gc.freeze()
    gc.enable()


def pytest_unconfigure() -> None:
    """Have what was set aside freed, which some libraries expect of a process that ends."""
    gc.unfreeze()


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


class Answer(NamedTuple):
    """What a command line gave back."""

    code: int
    out: str
    err: str


Run = Callable[..., Answer]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    """Run `hhsim` with the given arguments by its entry point, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    (entry,) = importlib.metadata.entry_points(group="console_scripts", name="hhsim")

    def called(*arguments: str) -> Answer:
        monkeypatch.setattr(sys, "argv", ["hhsim", *arguments])
        handler = signal.getsignal(signal.SIGINT)
        try:
            with pytest.raises(SystemExit) as exit_:
                entry.load()()
        finally:
            signal.signal(signal.SIGINT, handler)
        captured = capsys.readouterr()
        assert isinstance(exit_.value.code, int)
        return Answer(exit_.value.code, captured.out, captured.err)

    return called
