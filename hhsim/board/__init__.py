"""One table of many results: of sweeps and single replays, of one machine or several."""
