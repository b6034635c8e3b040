"""Stored runs to export, and the stored rows of an installation."""

import itertools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import text

from backend.analysis.evaluation import reevaluate_run
from backend.recording.codec import pack_table, summarize_buckets
from backend.sample import STORED_NAMES
from backend.schemas.run import LineageNode
from backend.services.lineage import RunHistory
from backend.storage import banks, commissioning, identifications, recordings, runs
from backend.storage.banks import BankEntry
from backend.storage.commissioning import NewStepResult
from backend.storage.database import Database, Session
from backend.storage.identifications import NewIdentification
from backend.storage.recordings import Chunk
from backend.storage.runs import EndState, NewRun, RunKind
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.models.earlier_identifications import ACTUATOR
from tests.reports.tracking_run import PLAN, samples, source_of

LAB = load_parameters("lab")
NEW = NewRun(RunKind.ACTUATOR_IDENTIFICATION, "rig", "lab", LAB.to_document(), "Ana", "1.0.0")
METHOD = "G_q: output error, AR(12) noise; G_S: output error, low frequencies weighted"
ESTIMATE = NewIdentification(
    kind="actuator", run_id=None, method=METHOD, usable=True, verdict="usable", who="Ana", software="1", **ACTUATOR
)
TABLES = [
    "run",
    "recording",
    "chunk",
    "identification",
    "bank",
    "bank_entry",
    "result",
    "report",
    "origin",
    "run_index",
]


def noise(rows: int = 2_300, seed: int = 0) -> NDArray[np.float32]:
    """Return samples [rows, columns] with every kind of value that a signal may contain."""
    table = np.random.default_rng(seed).normal(size=(rows, len(STORED_NAMES))).astype(np.float32)
    table[:, 5] = np.nan
    table[3, 6:9] = np.inf, -np.inf, -0.0
    return table


def recorded(
    session: Session, new: NewRun = NEW, table: NDArray[np.float32] | None = None, cuts: tuple[int, ...] = ()
) -> int:
    """Store a completed run; five samples are missing before each of ``cuts``."""
    run, table = runs.create(session, new), noise() if table is None else table
    recordings.begin(session, run.id, list(STORED_NAMES), T_s)
    for number, (begin, end) in enumerate(itertools.pairwise((0, *cuts, len(table)))):
        part = table[begin:end]
        chunk = Chunk(7_000 + begin + 5 * number, len(part), pack_table(summarize_buckets(part)), pack_table(part))
        recordings.add_chunks(session, run.id, [chunk])
    if cuts:
        recordings.add_gap(session, run.id, 5 * len(cuts), "the disk was full")
    runs.end(session, run.id, EndState.COMPLETED, "")
    return run.id


def tracked(database: Database) -> int:
    """Store a tracking run with its bank, the identification of the bank, calibrations and a result."""
    columns = samples(PLAN)
    source = source_of(columns)
    with database.session() as session:
        step = NewStepResult("tare", "card", "f" * 64, True, "", "Ana", calibrations=[{"tendon": "A", "offset": 0.1}])
        commissioning.add(session, step)
        made_of = recorded(session)
        estimate = identifications.add(session, NewIdentification(**{**vars(ESTIMATE), "run_id": made_of}))
        entries = [BankEntry(10.5, {"tension_N": 10.0}, estimate.id), BankEntry(12.5, {"tension_N": 20.0})]
        bank = banks.add(session, "bench", entries, who="Ana")
        settings = source.run.settings | {"loop": source.run.settings["loop"] | {"bank": bank.id}}
        of = source.run.parameters
        new = NewRun(RunKind.TRACKING, "simulator", "ideal", of, "Ana", "1", settings, bank.id, "worn")
        table = np.column_stack([columns[name] for name in STORED_NAMES]).astype(np.float32)
        run = recorded(session, new, table)
    assert reevaluate_run(database, run).problem == ""
    return run


def boxes(database: Database, run: int) -> dict[str, LineageNode]:
    """Return the boxes of a lineage by kind and digest, because numbers differ between installations."""
    lineage = RunHistory(database, LAB, lambda: None).build_lineage(run)
    return {f"{node.kind} {node.sha256}": node for node in lineage.nodes}


def read_all_rows(database: Database) -> dict[str, list[tuple[object, ...]]]:
    """Return all rows of an installation."""
    with database.reading() as session:
        return {table: [tuple(row) for row in session.execute(text(f"SELECT * FROM {table}"))] for table in TABLES}


def has_no_unpacked_files(folder: Path) -> bool:
    """Return whether an import has removed all files that it unpacked."""
    return [path.name for path in folder.iterdir() if not path.name.startswith("sinew.db")] == []
