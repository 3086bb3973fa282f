#!/bin/sh
# Gate a change in any CI: errors and work counters against a baseline that is committed, and, where there is a python
# with the hhsim of the base, times of both run in turn.
#
#   examples/gate.sh                                 the suite hhsim-gate.toml of the current folder
#   BASE_PYTHON=../base/.venv/bin/python examples/gate.sh
#   BASE_FOLDER=../base examples/gate.sh             the base's own methods, recordings, submissions and sessions
#
# Exit codes are those of hhsim gate: 0 ok, 1 a limit was missed, 2 bad input, 3 the inputs are not the same.
set -eu
hhsim=${HHSIM:-hhsim}
reports=${REPORTS:-gate-reports}
mkdir -p "$reports"
set -- --markdown "$reports/gate.md"
if [ -n "${BASE_PYTHON:-}" ]; then
  set -- "$@" --base-python "$BASE_PYTHON"
else
  set -- "$@" --no-time
fi
if [ -n "${BASE_FOLDER:-}" ]; then
  set -- "$@" --base-folder "$BASE_FOLDER"
fi
exec $hhsim gate "$@"
