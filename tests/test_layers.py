"""Who may import whom, held by reading every import statement of the sources."""

import ast
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent

LAYERS: tuple[tuple[str, ...], ...] = (
    ("__init__", "errors"),
    ("kernels",),
    (
        "destination",
        "info",
        "whole_file",
        "sealed_file",
        "workers",
        "result_schema",
        "log_histogram",
        "toml_document",
        "picture_file",
    ),
    # The model: what is simulated.
    (
        *(
            "mesh",
            "mesh_file",
            "mesh_in_repair",
            "mesh_overlaps",
            "mesh_repair",
            "mesh_holes",
            "mesh_topology",
            "surface_parts",
            "surface_samples",
        ),
        *("winding_solid", "mesh_orientation", "solid_mesh", "sheet_slabs", "tet_grid"),
        *("shapes", "cup", "rock", "shamrock", "object_catalogue", "object_sources"),
        *(
            "sphere_tree",
            "tree_file",
            "sph_format",
            "tree_error",
            "tree_builder",
            "tree_choice",
            "tree_import",
            "tree_methods",
            "tree_referee",
            "mesh_cover",
            "canonical_frame",
            "ball_hierarchy",
            "level_cover",
            "fewest_balls",
            "cover_check",
            "enclosing_tree",
            "octree_tree",
            "medial_axis",
            "medial_tree",
        ),
        *("hand", "hand_figure", "hand_pieces", "palm", "placed_hand", "surface", "rendering", "section"),
        *("result_motion", "trajectory", "trajectory_checks", "trajectory_file", "trajectory_csv", "resample"),
        *("sample_flags", "recording", "hand_change", "recorded_axes", "column_map", "csv_table"),
        *(
            "recording_csv",
            "recording_npz",
            "recording_leap",
            "recording_bvh",
            "bvh_text",
            "recording_dexmo",
            "dexmo_regression",
            "lz_string",
            "finger_fit",
            "recording_file",
        ),
        *("recording_stamps", "recording_units", "recording_glitches", "recording_repair", "import_report"),
        *("script", "disturbance", "closing", "closing_search", "slide", "synthesis"),
        *("demonstration", "object_placement", "grasp_placement", "trajectory_catalogue", "named_scene"),
        *("regions", "touch", "placement", "placed_closing", "paper_scenarios"),
        *("hand_motion", "brute_distance", "stress", "scene", "haptic_motion", "hard_objects", "hard_postures"),
    ),
    # One tick of it, and what is measured.
    (
        *("qp", "contact_problem", "solver", "solver_options", "crew", "backend", "workspace"),
        *("metrics", "mesh_penetration", "hand_referee", "hold_touches", "placement_search", "contact_points"),
    ),
    # Runs and their files.
    (
        *("replay", "interrupt", "summary", "summary_lines", "tick_figures", "tracking_reference", "tremor_hold"),
        "warm_up",
        *("result", "result_writer", "tick_columns", "stored_scene", "run_again"),
    ),
    # Looking at them.
    ("result_hand", "shown_ticks", "rerun_plots", "rerun_scene", "rerun_blueprint", "rerun_target", "status_words"),
    # The referee.
    (
        *("verify", "verify_claim", "verify_contacts", "verify_file"),
        *("verify_coal", "verify_forces", "verify_hand", "verify_metrics", "verify_ticks"),
        *("verify_posture", "verify_depth", "verify_balance"),
        *("verify_rows", "verify_session", "verify_command", "verify_session_figures"),
    ),
    # A glove in the loop.
    ("live",),
    ("view", "view_ahead"),
    # Many runs, side by side.
    ("bench_file", "pareto", "run_errors", "speed_error", "speed_error_table"),
    ("shrink", "stuck", "failure", "stress_case", "stress_figures", "stress_measure", "bench_stress"),
    ("hard_case", "hard_judge", "hard_input_cases", "hard_contact_cases", "hard_invariance_cases"),
    ("hard_endurance", "hard_cases", "bench_hard", "recorded_figures", "bench_recorded"),
    ("bench_threads", "end_to_end", "tree_references", "bench_trees"),
    ("paper_stage", "paper_run", "bench_paper", "paper_rows"),
    ("qp_program", "qp_check", "qp_backends", "qp_tally", "qp_degenerate", "qp_sizes", "qp_harvest", "bench_qp"),
    # Yes or no to a change.
    ("gate_inputs", "gate_figures", "gate_suite", "gate_timing", "gate_reference", "gate_judge", "gate_baseline"),
    ("gate_run", "gate", "gate_report", "gate_trials", "viewer_cost"),
    # Pictures of them.
    (
        "replay_figure",
        "concepts_figure",
        "cost_figure",
        "speed_error_figure",
        "scene_pictures",
        "paper_figures",
        "recording_figure",
    ),
    ("trees_figure", "tree_figure"),
    # A report of them.
    (
        *("envelope", "report_columns", "report_figures", "report_series", "report_histogram", "report_speed_error"),
        *("clear_view", "report_pictures", "report_worst"),
    ),
    (
        *("report", "report_page", "report_html", "report_style", "report_album", "report_run", "report_ticks"),
        *("report_sections", "report_worst_section", "report_bench", "report_facts", "report_command"),
        *("report_compare", "report_verdict"),
    ),
)
"""Modules of hhsim by layer, lowest first; a module imports from its own layer and from lower ones."""

HEAVY = {"click", "rich", "rerun", "trimesh", "qpsolvers", "clarabel", "matplotlib", "scipy"}
"""Packages that are imported where they are used: together they cost more than a second."""

KERNEL_IMPORTS = {"numpy", "numba", "llvmlite", "math", "typing", "collections", "time", "platform"}
JIT_FACTORY = {"jit", "jit_inline", "jit_vector"}


@dataclass(frozen=True)
class Import:
    """One imported module by its absolute name; `at_import` unless it waits for a function to be called."""

    name: str
    line: int
    at_import: bool


def python_files(folder: str) -> list[Path]:
    return sorted((REPOSITORY / folder).rglob("*.py"))


def module_name(path: Path) -> str:
    """Dotted name under which a file of hhsim/ or cli/ is imported."""
    parts = path.relative_to(REPOSITORY).with_suffix("").parts
    parts = parts if parts[0] == "hhsim" else ("hhsim", *parts)
    return ".".join(parts).removesuffix(".__init__")


def imports_of(path: Path) -> Iterator[Import]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    in_function = {
        inner
        for outer in ast.walk(tree)
        if isinstance(outer, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for inner in ast.walk(outer)
        if inner is not outer
    }
    type_only = {
        inner
        for outer in ast.walk(tree)
        if isinstance(outer, ast.If) and ast.unparse(outer.test) == "TYPE_CHECKING"
        for inner in ast.walk(outer)
    }
    package = module_name(path).split(".")
    if path.name != "__init__.py":
        package = package[:-1]
    for node in ast.walk(tree):
        at_import = node not in in_function and node not in type_only
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, node.lineno, at_import)
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*start, *([node.module] if node.module else [])])
            for alias in node.names:
                inside = f"{base}.{alias.name}"
                yield Import(inside if inside in OWN_MODULES else base, node.lineno, at_import)


OWN_MODULES = {module_name(path) for folder in ("hhsim", "cli") for path in python_files(folder)}
LIBRARY = python_files("hhsim")
KERNELS = [path for path in python_files("hhsim/kernels") if path.name != "jit.py"]


def layer_of(module: str) -> int | None:
    """Layer of a module of hhsim; None for one that is in no layer."""
    short = module.split(".")[1] if "." in module else "__init__"
    return next((number for number, names in enumerate(LAYERS) if short in names), None)


def test_every_module_has_a_layer() -> None:
    homeless = [module_name(path) for path in LIBRARY if layer_of(module_name(path)) is None]
    assert homeless == [], "say in LAYERS where these belong"
    names = [name for names in LAYERS for name in names]
    on_disk = {path.stem for path in (REPOSITORY / "hhsim").glob("*.py")} | {"kernels", "live"}
    assert sorted(names) == sorted(on_disk), "a layer names a module that is gone, or one twice"


@pytest.mark.parametrize("path", LIBRARY, ids=module_name)
def test_a_lower_layer_never_imports_a_higher_one(path: Path) -> None:
    own = layer_of(module_name(path))
    assert own is not None
    for imported in imports_of(path):
        # The package names what users import, of every layer, and imports none of it until it is asked for.
        of_the_front = path == REPOSITORY / "hhsim" / "__init__.py" and not imported.at_import
        if imported.name.split(".")[0] == "hhsim" and not of_the_front:
            assert not imported.name.startswith("hhsim.cli"), f"{path}:{imported.line} imports the command line"
            other = layer_of(imported.name)
            assert other is not None, f"{path}:{imported.line} imports {imported.name}, which is no module"
            assert other <= own, f"{path}:{imported.line} imports {imported.name} from a higher layer"


@pytest.mark.parametrize("path", KERNELS, ids=module_name)
def test_kernels_import_only_numpy_numba_and_kernels(path: Path) -> None:
    for imported in imports_of(path):
        allowed = imported.name.startswith("hhsim.kernels") or imported.name.split(".")[0] in KERNEL_IMPORTS
        assert allowed, f"{path}:{imported.line} imports {imported.name}"


def test_the_jit_factory_imports_only_numpy_numba_and_the_standard_library() -> None:
    for imported in imports_of(REPOSITORY / "hhsim" / "kernels" / "jit.py"):
        top = imported.name.split(".")[0]
        assert top in ("numpy", "numba", "llvmlite") or top in sys.stdlib_module_names, imported


@pytest.mark.parametrize("path", KERNELS, ids=module_name)
def test_every_kernel_is_made_by_the_jit_factory(path: Path) -> None:
    compilers = {"jit", "njit", "vectorize", "guvectorize", "cfunc", "stencil", "generated_jit"}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        assert not isinstance(node, ast.Raise | ast.Try), f"{path}:{node.lineno}: kernels return status codes"
        if isinstance(node, ast.FunctionDef):
            decorators = {ast.unparse(decorator) for decorator in node.decorator_list}
            assert decorators <= JIT_FACTORY | {"property"}, (
                f"{path}:{node.lineno}: {node.name} is not made by the factory"
            )
        elif isinstance(node, ast.ImportFrom) and node.module == "numba":
            assert compilers.isdisjoint(alias.name for alias in node.names), f"{path}:{node.lineno}"
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "numba":
            assert node.attr not in compilers, f"{path}:{node.lineno}"


@pytest.mark.parametrize("path", LIBRARY, ids=module_name)
def test_the_library_imports_heavy_packages_where_it_uses_them(path: Path) -> None:
    for imported in imports_of(path):
        heavy = imported.name.split(".")[0] in HEAVY
        assert not (heavy and imported.at_import), f"{path}:{imported.line} imports {imported.name} at module level"


@pytest.mark.parametrize("path", python_files("cli"), ids=module_name)
def test_the_command_line_imports_nothing_slow_until_a_command_runs(path: Path) -> None:
    light = {"hhsim", "hhsim.errors"}
    for imported in imports_of(path):
        if imported.at_import and not imported.name.startswith("hhsim.cli"):
            top = imported.name.split(".")[0]
            allowed = imported.name in light or top == "click" or top in sys.stdlib_module_names
            assert allowed, f"{path}:{imported.line} imports {imported.name} at module level"


def setuptools_table() -> dict[str, dict[str, list[str]]]:
    table: dict[str, dict[str, list[str]]] = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"][
        "setuptools"
    ]
    return table


def test_the_declared_packages_are_those_on_disk() -> None:
    on_disk = {"hhsim.cli", "hhsim.objects", "hhsim.trajectories"}
    on_disk |= {module_name(path) for path in LIBRARY if path.name == "__init__.py"}
    assert sorted(setuptools_table()["packages"]) == sorted(on_disk)


@pytest.mark.parametrize("folder", ["objects", "trajectories"])
def test_data_folders_are_flat_and_everything_in_them_is_shipped(folder: str) -> None:
    patterns = ["__init__.py", *setuptools_table()["package-data"][f"hhsim.{folder}"]]
    for path in (REPOSITORY / folder).iterdir():
        if path.name == "__pycache__":
            continue
        assert path.is_file(), f"{path} is a folder: data folders are flat"
        assert any(fnmatch(path.name, pattern) for pattern in patterns), f"{path} would not be installed"
    statements = ast.parse((REPOSITORY / folder / "__init__.py").read_text()).body
    assert len(statements) == 1, f"{folder}/__init__.py holds nothing but its docstring"
    assert isinstance(statements[0], ast.Expr)
