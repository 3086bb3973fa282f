#!/bin/sh
# An object and a motion of one's own: make a mesh, build its sphere tree, replay, check.
#
#   examples/custom_object.sh            the files go to custom-object/ under the current folder
#   examples/custom_object.sh FOLDER     or there
#
# To look: hhsim view custom-object/pawn.h5
set -eu
here=$(cd "$(dirname "$0")" && pwd)
hhsim=${HHSIM:-hhsim}
folder=${1:-custom-object}
mkdir -p "$folder"
cd "$folder"
${PYTHON:-python3} "$here/custom_object.py" pawn.stl
# STL has no unit: say it. The tree is a file of its own; without it, replay builds one of level 4 and keeps it.
$hhsim build-tree pawn.stl --unit mm --level 3 --out pawn-tree.h5
$hhsim replay pawn.stl "$here/custom_motion.toml" --unit mm --tree pawn-tree.h5 --out pawn.h5
$hhsim verify pawn.h5 --every 50
