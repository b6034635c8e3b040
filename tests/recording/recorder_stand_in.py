"""A service reduced to its recorder: RING_FD DATA_DIR; prints the end of what is committed after each drain."""

import sys
from pathlib import Path

from backend.realtime.ring_buffer import Ring
from backend.recording.recorder import Recorder
from backend.storage.database import open_database

recorder = Recorder(open_database(Path(sys.argv[2])), Ring.attach(int(sys.argv[1])))
while True:
    recorder.drain()
    print(recorder._next_tick, flush=True)
