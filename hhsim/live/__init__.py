"""Live: a glove in the loop at 1 kHz, safely, recorded and replayable."""
