"""A table of an example glove and the map that says what its columns are."""

GLOVE = """
device = "ExampleGlove 2"
hand = "left"
hand_length = 0.182
world_up = "y"
palm_axes = ["-y", "x", "z"]
palm_offset = [0.0, 0.075, 0.0]

[time]
column = "Time"
unit = "ms"

[position]
columns = ["X", "Y", "Z"]
unit = "mm"

[orientation]
columns = ["qx", "qy", "qz", "qw"]
order = "xyzw"

[angle]
unit = "deg"

[joint]
index_flex1 = "MCP"
index_flex2 = { column = "PIP", offset = 12.0, scale = -1.0 }
index_flex3 = { joint = "index_flex2", scale = 0.667 }
index_abd = { column = "Abd", unit = "rad" }
"""

TABLE = """Time;X;Y;Z;qx;qy;qz;qw;MCP;PIP;Abd
0;100;200;300;0;0;0;1;10;2;0.1
10;100;200;300;0;0;0;1;20;-8;0.1
20;100;200;300;0;0;0;1;30;-18;0.1
"""
