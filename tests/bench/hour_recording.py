"""A recording of one hour: generated samples pass a ring buffer and the real recorder into a database."""

from pathlib import Path

import numpy as np

from backend.realtime.ring_buffer import WIDTH, Ring
from backend.recording.recorder import CHUNK_TICKS, Recorder
from backend.sample import INDEX
from backend.storage import runs
from backend.storage.database import open_database
from backend.storage.runs import NewRun, RunKind
from plant.interface import T_s

HOUR_S = 3600
_COUNT_RAD = 2.0 * np.pi / 8000.0
_STEP_S = 7.0


def record_an_hour(data: Path) -> int:
    """Record steps of q and S with sensor noise into ``data``; return the number of the run."""
    database = open_database(data)
    try:
        with database.session() as session:
            run = runs.create(session, NewRun(RunKind.SESSION, "simulator", "lab", {}, "bench", "0"))
        ring = Ring.create(4 * CHUNK_TICKS)
        recorder = Recorder(database, ring)
        random = np.random.default_rng(0)
        for second in range(HOUR_S):
            for row in _rows(second, run.id, random):
                ring.append(row)
            recorder.drain()
        recorder.close()
        ring.close()
    finally:
        database.close()
    return run.id


def _rows(second: int, run: int, random: np.random.Generator) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return the samples of one second, each column with the resolution and noise of its sensor."""
    ticks = second * CHUNK_TICKS + np.arange(CHUNK_TICKS)
    t = ticks * T_s
    into = t % _STEP_S
    side = np.where((t // _STEP_S) % 2.0, 1.0, -1.0)
    q = 0.4 * side * (1.0 - 2.0 * np.exp(-into / 0.35))
    S = 11.0 + 2.0 * np.sin(0.05 * t)
    rows = np.zeros((CHUNK_TICKS, WIDTH))
    columns = {
        "tick": ticks, "t": t, "run": run, "mode": 2, "S_true": S, "q_ref": 0.4 * side, "q_ref_gov": 0.4 * side,
        "q": np.round(q / _COUNT_RAD) * _COUNT_RAD, "q_dot": np.gradient(q, T_s),
        "S": S + random.normal(0.0, 0.01, CHUNK_TICKS), "S_ref": S, "S_ref_gov": S,
        "theta_A": np.round((2.0 + q) / _COUNT_RAD) * _COUNT_RAD, "theta_A_ref": 2.0 + q,
        "theta_B": np.round((2.0 - q) / _COUNT_RAD) * _COUNT_RAD, "theta_B_ref": 2.0 - q,
        "F_A": 20.0 + 5.0 * q + random.normal(0.0, 0.05, CHUNK_TICKS),
        "F_B": 20.0 - 5.0 * q + random.normal(0.0, 0.05, CHUNK_TICKS),
        "u_A": 2.0 * side * np.exp(-into / 0.2) + random.normal(0.0, 0.02, CHUNK_TICKS),
        "u_B": -2.0 * side * np.exp(-into / 0.2) + random.normal(0.0, 0.02, CHUNK_TICKS),
        "lam_q": 0.5, "lam_S": 0.5, "lateness_s": random.exponential(1e-4, CHUNK_TICKS),
    }  # fmt: skip
    for name, values in columns.items():
        rows[:, INDEX[name]] = values
    return rows
