"""Values of a mesh that are kept by its content: a mesh that is loaded or placed again has them already."""

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, TypeVar

from hhsim.mesh.mesh import Mesh

T = TypeVar("T")


class _Content:
    """Mesh that equals any other of the same vertices and triangles."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh

    def __hash__(self) -> int:
        return hash(self.mesh.sha256)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Content) and self.mesh.sha256 == other.mesh.sha256


def kept_by_content(most: int) -> Callable[[Callable[..., T]], Callable[..., T]]:
    """Return a decorator that keeps the last `most` values of a function of a mesh and hashable arguments."""

    def decorate(function: Callable[..., T]) -> Callable[..., T]:
        @lru_cache(maxsize=most)
        def kept(content: _Content, *rest: Any) -> T:
            return function(content.mesh, *rest)

        @wraps(function)
        def found(mesh: Mesh, *rest: Any) -> T:
            return kept(_Content(mesh), *rest)

        return found

    return decorate
