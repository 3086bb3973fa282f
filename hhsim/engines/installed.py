"""Whether an engine is installed, and how to get it where it is not."""

from importlib.util import find_spec

from hhsim.errors import InputError


def lack_of(extra: str, *modules: str) -> str:
    """What to say where one of the modules cannot be imported, in one line; "" where all can.

    Args:
        extra: Of hhsim, that brings them.
        modules: By the names that are imported; nothing is imported here.
    """
    for module in modules:
        if find_spec(module) is None:
            return f"needs {module}, which is not installed: pip install 'hhsim[{extra}]'"
    return ""


def require(method: str, missing: str) -> None:
    """Refuse to make a method whose engine is missing.

    Args:
        missing: From `lack_of`.

    Raises:
        InputError: It is.
    """
    if missing:
        raise InputError(f"method {method} {missing}")
