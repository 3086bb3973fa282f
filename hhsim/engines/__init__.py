"""Another physics engine as methods, tuned as its authors would: MuJoCo, an optional extra.

Nothing imports these modules: the entry points of the group "hhsim.methods" name their classes. A module imports its
engine when a class of it is made, so that `hhsim methods` can list what is not installed.
"""
