"""hhsim as a library: replay a scene with two methods, and read what every tick did."""

import numpy as np

import hhsim

scene = hhsim.open_scene("cube", "pinch")  # names, mesh files, recordings: what hhsim replay takes
for method in ("coupled", "progressive"):
    file = f"pinch-{method}.h5"
    hhsim.replay_scene(scene, hhsim.SolverOptions(method=method), file)
    result = hhsim.load_result(file)  # result["…"] is a dataset of the file: one row a tick

    hold = result.phase("hold")  # a slice of ticks
    force = np.linalg.norm(result["force/total"][hold], axis=1)  # [N]
    deepest = result["penetration_depth"].max()  # [m]
    in_contact = result["contacts/candidates"] > 0
    tick = np.median(result["duration/total_cpu"][in_contact])  # [ns]
    print(f"{method}: {result.ticks:,} ticks, {1e6 * deepest:.3f} µm deep, {1e-3 * tick:.1f} µs a tick in contact")
    print(f"  the hold takes {force.mean():.2f} N; all of it is in {file}")
