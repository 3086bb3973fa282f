"""A robot's links and their spheres as a rerun recording: `robot/LINK/mesh` and `robot/LINK/spheres`, in metres."""

import numpy as np

from hhsim.robots.poses import start_poses
from hhsim.robots.robot_spheres import RobotSpheres
from hhsim.view.sink import RerunTarget, rerun_stream

MESH_COLOR, SPHERE_COLOR = (204, 204, 199), (120, 160, 190, 90)


def show_robot(found: RobotSpheres, target: RerunTarget) -> None:
    """Send the links where every joint is near 0, and their spheres; errors as `rerun_stream`."""
    import rerun as rr
    import rerun.blueprint as rrb

    poses = start_poses(found.robot)
    view = rrb.Spatial3DView(origin="robot", name=found.robot.name)
    with rerun_stream(target, "hhsim", rrb.Blueprint(view, collapse_panels=True)) as stream:
        stream.log("robot", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for link in found.links:
            turn, place = poses[link.name][0][0], poses[link.name][1][0]
            path = rr.new_entity_path(["robot", link.name])
            faces = link.mesh.faces
            corners = link.mesh.vertices[faces].reshape(-1, 3)
            stream.log(path, rr.Transform3D(mat3x3=turn, translation=place), static=True)
            triangles = np.arange(len(corners)).reshape(-1, 3)
            mesh = rr.Mesh3D(vertex_positions=corners, triangle_indices=triangles, albedo_factor=MESH_COLOR)
            stream.log(f"{path}/mesh", mesh, static=True)
            stream.log(
                f"{path}/spheres",
                rr.Ellipsoids3D(
                    centers=link.tree.leaf_center, radii=link.tree.leaf_radius, colors=SPHERE_COLOR, fill_mode="solid"
                ),
                static=True,
            )
