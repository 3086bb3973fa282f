"""The mesh of a word: of a file of one link, and of a link that is named."""

from pathlib import Path

import numpy as np
import pytest
from linkage_samples import BOX, joint, link, urdf

from hhsim.errors import InputError, MeshError
from hhsim.linkage.file import resolve_object


def test_a_file_of_one_link_is_its_mesh_where_the_file_begins(tmp_path: Path) -> None:
    path = tmp_path / "door.urdf"
    turned = joint("root", "a", origin='xyz="0 0 1"', axis="1 0 0", limit='lower="1.5707963267948966" upper="2"')
    path.write_text(urdf(link("root", ""), link("a"), turned))
    mesh, level = resolve_object(path)
    assert (mesh.name, level, len(mesh.faces)) == ("door", 4, 12)
    np.testing.assert_allclose(mesh.bounds, [[-0.05, -0.01, 0.97], [0.05, 0.01, 1.03]], atol=1e-12)


def test_shapes_that_cross_become_one_solid_and_with_the_mesh_itself_stay(tmp_path: Path) -> None:
    path = tmp_path / "cross.urdf"
    path.write_text(urdf(link("a", BOX.format("0.1 0.02 0.02") + BOX.format("0.02 0.1 0.02"))))
    whole, _ = resolve_object(path)
    assert whole.volume == pytest.approx(2 * 0.1 * 0.02**2 - 0.02**3, rel=1e-6)
    assert len(resolve_object(path, solid=False)[0].faces) == 24


def test_one_of_several_links_is_named(tmp_path: Path) -> None:
    path = tmp_path / "two.urdf"
    path.write_text(urdf(link("a"), link("b", BOX.format("0.2 0.1 0.1")), joint("a", "b", origin='xyz="0 0 1"')))
    mesh, _ = resolve_object(path, link="b")
    assert mesh.name == "b" and np.allclose(mesh.bounds, [[-0.1, -0.05, -0.05], [0.1, 0.05, 0.05]])
    for word, message in (
        ("", r"2 links, a, b; expected one, or the name of one \(--link\)"),
        ("c", "no link 'c'; it has a, b"),
    ):
        with pytest.raises(InputError, match=rf"two\.urdf: {message}"):
            resolve_object(path, link=word)
    with pytest.raises(InputError, match=r"unit and size are for mesh files; .*two\.urdf states its sizes"):
        resolve_object(path, unit="mm")
    with pytest.raises(InputError, match="a link is of a URDF or MJCF file; 'cube' is none"):
        resolve_object("cube", link="a")


def test_a_link_that_no_hand_can_use_is_told_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "house.urdf"
    path.write_text(urdf(link("a", BOX.format("30 1 1"))))
    with pytest.raises(
        (InputError, MeshError), match=r"house\.urdf: link 'a': longest extent 30 m: .* is its scale wrong\?"
    ):
        resolve_object(path)
