"""Run the tutorials cell by cell and keep what they show: `python -m tools.notebooks [NOTEBOOK...]`.

A cell is Python, or lines that begin with ! and go to a shell, as in Jupyter. Each notebook runs in a folder of its own
beside the examples, as in a checkout. A cell that fails ends it, unless its metadata has the exit code it is to have.
"""

import ast
import base64
import contextlib
import io
import json
import logging
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parent.parent
TUTORIALS = REPOSITORY / "docs" / "tutorials"


def run_cell(cell: dict[str, Any], names: dict[str, Any]) -> list[dict[str, Any]]:
    """Run a cell of code in the given namespace and return its outputs, in the notebook's own form.

    Raises:
        RuntimeError: A command ended with another exit code than the cell's metadata says, 0 by default.
        Exception: Whatever the cell's Python raises.
    """
    source = "".join(cell["source"])
    if source.startswith("!"):
        return [_stream(_shell(line[1:], cell["metadata"].get("exit_code", 0))) for line in source.splitlines()]
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        *statements, last = ast.parse(source).body
        if isinstance(last, ast.Expr):
            exec(compile(ast.Module(statements, []), "cell", "exec"), names)
            value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
        else:
            exec(compile(source, "cell", "exec"), names)
    outputs = [_stream(printed.getvalue())] if printed.getvalue() else []
    if source.endswith(";"):
        return outputs + _figures()
    if (picture := getattr(value, "_repr_png_", None)) is not None:
        outputs.append(_picture(picture()))
    elif value is not None and "matplotlib" not in type(value).__module__:
        outputs.append({"output_type": "execute_result", "execution_count": None, "metadata": {},
                        "data": {"text/plain": repr(value)}})  # fmt: skip
    return outputs + _figures()


def _figures() -> list[dict[str, Any]]:
    if "matplotlib.pyplot" not in sys.modules:
        return []
    pyplot = sys.modules["matplotlib.pyplot"]
    outputs = []
    for number in pyplot.get_fignums():
        data = io.BytesIO()
        pyplot.figure(number).savefig(data, format="png", dpi=100)
        outputs.append(_picture(data.getvalue()))
    pyplot.close("all")
    return outputs


def _picture(data: bytes) -> dict[str, Any]:
    return {"output_type": "display_data", "metadata": {}, "data": {"image/png": base64.b64encode(data).decode()}}


def _stream(text: str) -> dict[str, Any]:
    return {"output_type": "stream", "name": "stdout", "text": text.splitlines(keepends=True)}


def _shell(line: str, code: int) -> str:
    answer = subprocess.run(line, shell=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if answer.returncode != code:
        raise RuntimeError(f"{line}: exit code {answer.returncode}\n{answer.stdout}")
    return re.sub(r"(?m)^.*(compil|Compil).*\n", "", answer.stdout)


def run(notebook: Path, folder: Path) -> dict[str, Any]:
    """Run a notebook in a child process, in docs/tutorials of a folder beside the examples; return it with outputs.

    Raises:
        RuntimeError: A cell failed; the message ends with what it said.
    """
    place = folder / "docs" / "tutorials"
    place.mkdir(parents=True, exist_ok=True)
    if not (folder / "examples").exists():
        (folder / "examples").symlink_to(REPOSITORY / "examples")
    out = folder / f"{notebook.stem}.json"
    environment = {**os.environ, "MPLBACKEND": "agg", "NO_COLOR": "1", "COLUMNS": "110", "PYTHONPATH": str(REPOSITORY)}
    environment["PATH"] = f"{Path(sys.executable).parent}:{environment['PATH']}"
    command = [sys.executable, "-m", "tools.notebooks", "--here", str(notebook), str(out)]
    answer = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, check=False)
    if answer.returncode:
        raise RuntimeError(f"{notebook.name}: {answer.stderr}")
    document: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    return document


def _run_here(notebook: Path, out: Path) -> None:
    logging.getLogger("hhsim").setLevel(logging.ERROR)
    document = json.loads(notebook.read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    for cell in document["cells"]:
        if cell["cell_type"] == "code":
            cell["outputs"] = run_cell(cell, names)
    out.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def main() -> None:
    """Run the named notebooks, or all of them, and write their outputs into them."""
    if sys.argv[1:2] == ["--here"]:
        _run_here(Path(sys.argv[2]), Path(sys.argv[3]))
        return
    for name in sys.argv[1:] or sorted(str(path) for path in TUTORIALS.glob("*.ipynb")):
        notebook = Path(name).resolve()
        with tempfile.TemporaryDirectory() as folder:
            document = run(notebook, Path(folder))
        notebook.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
