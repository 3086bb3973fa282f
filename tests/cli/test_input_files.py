"""A named pipe in the place of a file: each command refuses it in one line, and none waits for somebody to write it."""

import os
from pathlib import Path

import pytest
from conftest import Run
from sampled import sampled
from short_grasp import short_result

COMMANDS = (
    "verify FIFO.h5",
    "replay FIFO.h5",
    "replay cube FIFO.h5",
    "replay cube FIFO.csv",
    "replay cube FIFO.toml",
    "replay cube FIFO.npz",
    "replay FIFO.stl touch",
    "replay mesh.gltf touch --unit m",
    "replay cube pinch --tree FIFO.h5",
    "replay cube pinch --tree FIFO.sph",
    "replay cube pinch --hand-file FIFO.toml",
    "import FIFO.json",
    "import FIFO.bvh",
    "import FIFO.parquet",
    "import table.csv --columns FIFO.toml",
    "import table.csv --format dexmo --calibration FIFO.toml",
    "sweep FIFO.toml",
    "gate FIFO.toml",
    "gate FIFO.h5",
    "gate result.h5 --baseline FIFO.json",
    "gate result.h5 --baseline FIFO.h5",
    "score FIFO.csv",
    "score FIFO.h5",
    "compare result.h5 FIFO.h5",
    "export FIFO.h5 out.csv",
    "view FIFO.h5",
    "view FIFO.stl",
    "report FIFO.h5",
    "report result.h5 --out FIFO.html",
    "build-tree cube --from FIFO.sph",
    "scene FIFO.stl touch",
)
GLTF = (
    '{"asset": {"version": "2.0"}, "buffers": [{"uri": "FIFO.bin", "byteLength": 36}], "bufferViews": [{"buffer": 0,'
    ' "byteLength": 36}], "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],'
    ' "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}],'
    ' "scenes": [{"nodes": [0]}]}'
)


@pytest.mark.usefixtures("ended")
@pytest.mark.parametrize("command", sampled(COMMANDS, lambda place, _: place % 4 == 0 or "gltf" in COMMANDS[place]))
def test_a_pipe_is_no_file(command: str, run: Run, tmp_path: Path) -> None:
    for suffix in ("h5", "csv", "toml", "npz", "stl", "sph", "json", "bvh", "parquet", "html", "bin"):
        os.mkfifo(tmp_path / f"FIFO.{suffix}")
    (tmp_path / "table.csv").write_text("t,x\n0,1\n")
    (tmp_path / "mesh.gltf").write_text(GLTF)
    if "result.h5" in command:
        short_result(tmp_path / "result.h5")
    answer = run(*command.split())
    assert answer.code == 2
    assert answer.err.count("\n") == 1 and "no ordinary file" in answer.err
