"""The wheel of these sources, built where it leaves nothing behind in the checkout."""

import importlib.metadata
import shutil
import subprocess
import sys
from pathlib import Path

import pytest


def build_wheel(repository: Path, folder: Path) -> Path:
    """Build it into a folder; skips the test where setuptools is too old."""
    if int(importlib.metadata.version("setuptools").split(".")[0]) < 77:
        pytest.skip("building the wheel needs setuptools 77 or newer: pip install 'hhsim[test]'")
    source = folder / "source"
    ignored = shutil.ignore_patterns(".git", ".venv", "build", "*.egg-info", "__pycache__", "results", ".*_cache")
    shutil.copytree(repository, source, ignore=ignored)
    build = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
    subprocess.run([sys.executable, "-c", build, str(folder)], cwd=source, check=True, capture_output=True)
    shutil.rmtree(source)
    (path,) = folder.glob("*.whl")
    return path
