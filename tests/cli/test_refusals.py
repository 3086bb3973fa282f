"""What each command refuses: a line of words, and the one line that it answers; nothing is written."""

import shlex
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import Run
from joint_samples import joint_sample, openxr_csv
from linkage_samples import BOX, joint, link, urdf, write_arm
from recording_samples import write_descent
from short_grasp import short_result

POT = urdf(
    link("block", BOX.format("0.06 0.06 0.06")), link("lid", BOX.format("0.06 0.06 0.01")), joint("block", "lid")
)
FILES: dict[str, str | Callable[[Path], object]] = {
    "notes.h5": "no result",
    "notes.sph": "no tree",
    "mine.html": "mine",
    "one.npz": "",
    "motion.h5": write_descent,
    "motion.csv": write_descent,
    "other.csv": "t,x\n0,1\n",
    "empty.csv": "",
    "quest.csv": openxr_csv(joint_sample()),
    "glove.toml": "rate = 100\n",
    "dexmo.toml": "[angle]\nunit = 'deg'\n",
    "run.h5": short_result,
    "arm.urdf": lambda path: write_arm(path.parent),
    "pot.urdf": POT,
    "bad.urdf": POT.replace('size="0.06', 'size="x'),
    "many.toml": 'version = 1\n[[recording]]\nrecording = "quest.csv"\nobject = "sphere"\n',
    "other.yml": "collision_spheres: {hull: [{center: [0, 0, 0], radius: 1.0}]}",
}
"""Files that lie there where a line names them."""
LEFT, BOTH = "live glove --device left=sim", "live glove --device left=sim,right=sim"
REFUSED = {
    "repllay": "unknown command 'repllay': did you mean replay?",
    "info --jsn": "No such option '--jsn'. Did you mean '--json'? (see hhsim info --help)",
    "doctor --rate 9": "9.0 is not in the range 10<=x<=10000",
    "gate --markdown a.txt --write-baseline ./a.txt": "both name a.txt: name two files",
    "replay bunyn": "unknown object 'bunyn': did you mean bunny?",
    "replay cube none.csv": "none.csv: no such file; expected a trajectory or a recording",
    "replay cube --stiffness 1000,5": "expected 3 numbers with commas between: k_t [N/m]",
    "replay cube --penalty-stiffness 1000": "--penalty-stiffness is for --method penalty, not coupled",
    "replay cube --surface mesh --method paper": "method paper takes the surface spheres, not mesh",
    "replay cube --out .": ". is a folder: name a file in it, such as run.h5",
    "replay cube --out notes.h5": "notes.h5 exists and is no result file, so it is not replaced",
    "replay cube motion.csv --tremor 0.1,0.2": "--tremor is for scripts; 'motion.csv' is a recording",
    "replay cube --level 6": "'--level': 6 is not in the range 1<=x<=5",
    "replay cube --free --mass 1e-300": "'--mass': 1e-300 is not in the range 1e-09<=x<=1e+09",
    "replay cube --budget 99999999999999999999": "not in the range 1<=x<=4611686018427387904",
    "replay cube --rate nan": "'--rate': nan is not in the range 1<=x<=100000",
    "replay cube --stiffness 1000,5,0": "3 numbers with commas between: k_t [N/m] 1e-09 to 1e+12",
    "replay cube --level 3 --max-error 1mm": "--max-error chooses the level itself: leave --level 3 out",
    "replay cube --hands both --repeat 2": "--repeat is of one hand",
    "replay cup grasp --place-object auto": "'grasp' finds its place at the object itself",
    "replay bad.urdf": "bad.urdf: link 'block': <box size=\"x 0.06 0.06\">; expected 3 numbers",
    "replay pot.urdf --free --mass 1": "pot.urdf: mass is of one body; it has 2, which state their own",
    "replay run.h5 grasp": "TRAJECTORY has no place beside run.h5, whose ticks run again as they were",
    "replay run.h5 --tree other.h5": "--tree has no place beside run.h5, whose ticks",
    "replay run.h5 --rerun x.rrd": "--rerun has no place beside run.h5, whose ticks",
    "replay run.h5 --out again.h5": "--out has no place beside run.h5, whose ticks",
    "replay gone.h5": "gone.h5: no such file; expected a result (.h5)",
    "replay motion.h5": "its format is 'hhsim-trajectory', not 'hhsim-result' (to replay a",
    "replay cube --tree run.h5 --level 3": "--tree run.h5 has its own level: leave --level and --max-error out",
    "replay cube --out a.h5 --rerun nowhere/a.rrd": "there is no folder",
    "view gone.h5 --rerun x.rrd": "gone.h5: no such file",
    "view run.h5 --slow 2": "are of a film",
    "view run.h5 --video x.avi": ".gif, .webp or .mp4",
    "report gone.h5": "gone.h5: no such file; expected a result (.h5)",
    "report notes.h5": "notes.h5 is no HDF5 file",
    "report notes.h5 --out mine.html": "mine.html exists and is no page of hhsim report",
    "export run.h5 ticks.csv --columns tme": "unknown dataset 'tme': did you mean time",
    "sweep none.toml": "none.toml: no such file; expected a TOML plan of a sweep",
    "score one.npz --recorded one.npz --object cube --out x.h5": "--out is for poses of a scene",
    "score one.npz --recorded one.npz --object cube --scene .": "--scene is for poses of a scene",
    "score one.npz --recorded one.npz --object cube --surface mesh": "--surface is for poses of a scene",
    "repair many.toml --max-correction 30 --out free": "--max-correction is for one recording",
    "repair many.toml --length-unit m --out free": "--length-unit is for one recording",
    "repair quest.csv --object sphere --jobs 2 --out free": "--jobs is for a manifest",
    "repair quest.csv --object cube --hands both --hand left --out free.csv": "--hands both repairs two",
    "repair - --follow --object sphere --palm none --out free.jsonl": "--palm is for a whole recording",
    "scene bad.urdf": "bad.urdf: link 'block': <box size=\"x 0.06 0.06\">; expected 3 numbers",
    "build-tree pot.urdf --link cover": "pot.urdf: no link 'cover'; it has block, lid",
    "build-tree pot.urdf --link lid --unit mm": "unit and size are for mesh files; pot.urdf states its sizes",
    "build-tree cube --link lid": "a link is of a URDF or MJCF file; 'cube' is none",
    "build-tree none.stl": "none.stl: no such file; expected a mesh",
    "build-tree mug.stl --unit mm --size 90": "unit and size exclude each other",
    "build-tree cube --level 1 --out notes.h5": "notes.h5 exists and is no sphere tree",
    "build-tree cube --level 1 --out notes.sph": "notes.sph exists and is no sphere tree",
    "build-tree cube --level 1 --out d.h5 --plot e.h5": "no picture by its ending",
    "build-tree cube --out a.ply": "--out a.ply: a sphere tree is a .h5 or a .sph file (see",
    "build-tree cube --from-unit mm": "--from-unit is for --from FILE.sph",
    "build-tree cube --from a.sph --level 3": "--level is for trees that are built; a.sph has its own",
    "build-tree cube --from a.h5 --from-unit mm": "--from-unit is for .sph files; a.h5 is in metres",
    "build-tree cube --from a.sph": "a.sph: No such file or directory; expected a sphere tree (.sph)",
    "build-tree cube --from a.txt": "a.txt: a sphere tree is a .h5 or a .sph file",
    "build-tree cube --ignore default": "--ignore are for a robot, a URDF or MJCF file, and cube is none",
    "build-tree arm.urdf --solid": "--solid is for mesh files; arm.urdf is a robot",
    "build-tree arm.urdf --as urdf --out a.yml": "--out a.yml: expected a file that ends in .urdf (--as urdf)",
    "build-tree arm.urdf --link palm --as h5": "arm.urdf: no link 'palm'; it has base, turret",
    "build-tree arm.urdf --from other.yml": "other.yml: spheres of hull; expected some of base, turret",
    "build-tree arm.urdf --out arm.urdf": "arm.urdf is an input of this command",
    "import none.npz": "none.npz: no such file",
    "import empty.csv": "empty; expected a recording",
    "import .": "a folder; expected a recording",
    "import motion.csv --columns none.toml": "none.toml: no such file",
    "import motion.csv --out good.txt": "good.txt is no name for a trajectory: it has to end",
    "import motion.csv --out other.csv": "other.csv exists and is no trajectory, so it is",
    "import motion.csv --out motion.csv": "is an input of this command",
    "import motion.csv --fit-hand me.toml --out a.h5": "--fit-hand needs the centres of the joints",
    "import other.csv --calibration dexmo.toml": "a calibration of the Dexmo glove, but the file holds other columns",
    "import other.csv --calibration nobody.toml": "nobody.toml: no such file",
    "import quest.csv --fit-hand me.txt --out a.h5": "me.txt is no name for a hand file",
    "import quest.csv --fit-hand glove.toml --out a.h5": "glove.toml exists and is no hand file",
    "import quest.csv --fit-hand none/me.toml --out a.h5": "there is no folder",
    "live glove --device sim --device-id 7": "--device-id is for --device dexmo, not sim",
    "live glove --no-record --record a.h5": "--no-record and --record a.h5 exclude each other",
    "live glove --device udp --trajectory pinch": "--trajectory is for --device replay or sim",
    "live glove --pose replay --palm 0,0,0": "--palm and --palm-turn are for --pose keyboard or fixed or glove",
    "live glove --device udp --pose glove": "--pose glove is for --device openxr",
    "live glove --device openxr --palm 0,0,0 --palm-turn 1,0,0,0": "--palm-turn is for --pose fixed and",
    "live glove --pose fixed --palm-turn 1,0,0,0": "--palm-turn needs --palm, where the palm is",
    "live glove --palm 1,2": "Invalid value for '--palm': '1,2', expected 3 numbers with commas between",
    "live glove --stiffness 1.5": "'--stiffness': '1.5', expected 0 (free) to 1, or five of that",
    "live glove cube --hand-file nobody.toml --no-record --quiet": "nobody.toml: no such file",
    "live glove --device dexmo --calibration nobody.toml --quiet": "nobody.toml: no such file; expected a TOML cal",
    LEFT: "Invalid value for '--device': 'left=sim' has a glove for left: expected one left, one",
    f"{LEFT},left=sim": "Invalid value for '--device': 'left=sim,left=sim' has a glove for left and left",
    f"{LEFT},up=sim": "Invalid value for '--device': 'left=sim,up=sim' has a glove for left and up",
    f"{LEFT},right=hat": "Invalid value for '--device': 'hat' is not one of 'dexmo', ",
    f"{LEFT}[port=1],right=udp": "sim[port=1]: sim has no option of its own 'port'",
    f"{LEFT},right=udp[port=0]": "Invalid value for '--port': 0 is not in the range 1<=x<=65535",
    f"{LEFT},right=udp --device-id 7": "--device-id is for --device dexmo, not sim or udp",
    f"{BOTH} --hand left": "--hand left is for one glove: two name their hands",
    f"{BOTH} --rerun a.rrd": "--rerun shows one hand: leave it out with two gloves",
    f"{BOTH} --pose keyboard": "--pose keyboard moves one palm: with two gloves",
}


@pytest.mark.parametrize("line", REFUSED)
def test_a_mistake_is_told_in_one_line_and_leaves_nothing(run: Run, tmp_path: Path, line: str) -> None:
    words = shlex.split(line)
    for name in FILES.keys() & {part for word in words for part in (word, word.partition("=")[2])}:
        content = FILES[name]
        if callable(content):
            content(tmp_path / name)
        else:
            (tmp_path / name).write_text(content)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    answer = run(*words)
    assert (answer.code, answer.out, answer.err.count("\n")) == (2, "", 1), answer
    assert answer.err.startswith("hhsim: error: ") and REFUSED[line] in answer.err
    results = tmp_path / "results"
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path != results} == before
    assert not results.exists() or not any(results.iterdir())
