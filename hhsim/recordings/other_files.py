"""Files in which people keep hands and which are not read, by how they begin, and what makes a recording of each."""

import re

_ANIMATION = "is not read; export its skeleton as BVH"
_MARKERS = "is not read; export the solved skeleton as BVH, or joint positions as a CSV (docs/recordings.md)"
_TOPIC = "is not read; write the joints of its topic as a CSV with a header (docs/recordings.md)"
_PACKED = "is not unpacked here; expected the recording in it"

_BEGINNINGS: tuple[tuple[bytes, str], ...] = (
    (rb"Kaydara FBX Binary|;\s*FBX |FBXHeaderExtension", f"an animation in FBX {_ANIMATION}"),
    (rb"glTF", f"an animation in glTF {_ANIMATION}"),
    (rb'\{.*(?:"asset"\s*:\s*\{[^}]*"version"|"bufferViews?"\s*:)', f"an animation in glTF {_ANIMATION}"),
    (rb"#usda |PXR-USDC", f"an animation in USD {_ANIMATION}"),
    (rb"BLENDER[-_0-9]|//Maya |Vocaloid Motion Data", f"an animation of Blender, Maya or MikuMikuDance {_ANIMATION}"),
    (rb"#!OML:ASF|:(?:version|FULLY-SPECIFIED)", f"an animation in ASF/AMC {_ANIMATION}"),
    (rb"(?:<\?xml.*?)?<COLLADA", f"an animation in COLLADA {_ANIMATION}"),
    (rb"(?:<\?xml.*?)?<mvnx", f"an export of Xsens MVN as MVNX {_ANIMATION}"),
    (rb"(?:<\?xml.*?)?<(?:robot|mujoco|sdf)\b", "a robot, no recording of a hand"),
    (rb"Format Version,", f"an OptiTrack Motive export (Format Version, Take Name, …) {_MARKERS}"),
    (rb"Trajectories\s*\n\s*[0-9]+|Segments\s*\n\s*[0-9]+|Joints\s*\n\s*[0-9]+", f"a Vicon Nexus export {_MARKERS}"),
    (rb"NO_OF_FRAMES\t", f"a Qualisys export {_MARKERS}"),
    (rb"PathFileType\t", f"an export of markers as TRC {_MARKERS}"),
    (rb"\x02\x50", f"an export of markers as C3D {_MARKERS}"),
    (rb"#ROSBAG ", f"a bag of ROS 1 {_TOPIC}"),
    (rb"SQLite format 3\0", f"a database, such as a bag of ROS 2, {_TOPIC}"),
    (rb"MATLAB [57]\.", "a MATLAB file is not read; save its arrays as .npz: scipy.io.loadmat, numpy.savez"),
    (rb"ARROW1", "a Feather file is not read; save its arrays as .npz, or its table as Parquet or CSV"),
    (rb"\xd0\xcf\x11\xe0", "an Excel workbook is not read; save it as CSV"),
    (rb"\x1f\x8b|\xfd7zXZ|7z\xbc\xaf|\x28\xb5\x2f\xfd|BZh[1-9]|Rar!", f"a packed file {_PACKED}"),
)  # fmt: skip
_KINDS = tuple((re.compile(rb"\s*" + pattern, re.DOTALL), text) for pattern, text in _BEGINNINGS)


def why_not_read(head: bytes) -> str:
    """Return what the file with this beginning is, and what to do instead; "" for any other."""
    head = head.removeprefix(b"\xef\xbb\xbf")
    return next((text for pattern, text in _KINDS if pattern.match(head)), "")
