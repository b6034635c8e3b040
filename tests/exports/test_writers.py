"""Exports read by other libraries, with derived columns."""

import csv
import io
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas
import pyarrow.parquet
import pytest
from mcap.reader import make_reader
from numpy.typing import NDArray
from scipy.io import loadmat

from backend.experiments.parser import parse_derived_signal
from backend.exports import formats, matlab, messages
from backend.exports.base import ORDER, Export, ExportError, ImportRefusedError, export_columns, export_run
from backend.exports.formats import DataFormat, write_export
from backend.exports.importer import import_export
from backend.exports.mcap import foxglove_layout
from backend.recording.reader import read_samples
from backend.sample import FIELDS, STORED_NAMES
from backend.storage import formulas, recordings
from backend.storage.database import Database
from tests.exports.stored import recorded
from tests.exports.written import to_csv, to_mat, to_parquet, written
from tests.refusals import refused
from tests.reports.tracking_run import PLAN, samples

# Exports read by common libraries: equal samples, with notation.

COLUMNS = {name: column[:2_000].copy() for name, column in samples(PLAN).items()}
COLUMNS["u_A"][5:8] = np.inf, -np.inf, -0.0
UNITS = {field.name: field.unit for field in FIELDS}


def by_pandas(content: bytes) -> dict[str, NDArray[np.float64]]:
    table = pandas.read_csv(io.BytesIO(content), comment="#")
    return {name: table[name].to_numpy() for name in table.columns}


def by_pyarrow(content: bytes) -> dict[str, NDArray[np.float64]]:
    table = pyarrow.parquet.read_table(io.BytesIO(content))
    return {name: table[name].to_numpy() for name in table.column_names}


def by_scipy(content: bytes) -> dict[str, NDArray[np.float64]]:
    found = loadmat(io.BytesIO(content))  # type: ignore[arg-type]  # the stubs know paths only
    assert all(found[name].shape == (2_000, 1) for name in ORDER)
    return {name: found[name][:, 0] for name in ORDER}


def by_mcap(content: bytes) -> dict[str, NDArray[np.float64]]:
    messages = [json.loads(message.data) for _, _, message in make_reader(io.BytesIO(content)).iter_messages()]
    return {name: np.array([one[name] for one in messages], np.float64) for name in messages[0]}


READERS = {"csv": by_pandas, "parquet": by_pyarrow, "mat": by_scipy, "mcap": by_mcap}


@pytest.mark.parametrize("kind", READERS)
def test_every_sample_reads_back_equal(kind: str) -> None:
    read: Callable[[bytes], dict[str, NDArray[np.float64]]] = READERS[kind]
    found = read(written(COLUMNS, kind))
    assert tuple(found) == ORDER
    np.testing.assert_array_equal(found["t"], COLUMNS["t"])
    for name in STORED_NAMES:
        np.testing.assert_array_equal(found[name].astype(np.float32), COLUMNS[name].astype(np.float32), name)


def test_a_csv_has_metadata_a_heading_and_one_line_per_sample() -> None:
    lines = to_csv(COLUMNS).decode().splitlines()
    facts = [line for line in lines if line.startswith("#")]
    assert lines[: len(facts)] == facts
    assert messages.notation() in facts[0]
    (stiffness,) = [field for field in FIELDS if field.name == "S"]
    assert f"# S [N·m/rad] S: {stiffness.meaning}" in facts
    rows = list(csv.reader(lines[len(facts) :]))
    assert tuple(rows[0]) == ORDER
    assert len(rows) == 1 + 2_000
    assert rows[2][0] == "0.001"


def test_a_parquet_file_contains_units_symbols_and_meanings() -> None:
    table = pyarrow.parquet.read_table(io.BytesIO(to_parquet(COLUMNS)))
    assert table.schema.field("S").metadata[b"unit"] == "N·m/rad".encode()
    assert table.schema.field("theta_A").metadata[b"symbol"] == "θ_A".encode()
    assert table.schema.metadata[b"notation"] == messages.notation().encode()


def test_a_mat_file_contains_units_symbols_and_meanings_with_the_signals() -> None:
    file = io.BytesIO(to_mat({**COLUMNS, "q_old": COLUMNS["q"]}))
    content = loadmat(file, simplify_cells=True)  # type: ignore[arg-type]  # the stubs know paths only
    assert content["units"] == {**{name: UNITS[name] for name in ORDER}, "q_old": "1"}
    assert content["meanings"]["q_old"] == messages.column_of_earlier_version()
    assert content["symbols"]["theta_A"] == "θ_A"
    assert content["notation"] == messages.notation()


def test_an_mcap_file_has_a_schema_with_the_notation_and_a_layout() -> None:
    reader = make_reader(io.BytesIO(written(COLUMNS, "mcap")))
    summary = reader.get_summary()
    assert summary is not None
    (schema,) = summary.schemas.values()
    (channel,) = summary.channels.values()
    assert (schema.encoding, channel.message_encoding, channel.topic) == ("jsonschema", "json", "/sample")
    signals = json.loads(schema.data)["properties"]
    assert {name: part["unit"] for name, part in signals.items()} == {name: UNITS[name] for name in ORDER}
    (attached,) = reader.iter_attachments()
    assert attached.data.decode() == foxglove_layout()
    shown = [
        path["value"]
        for panel in json.loads(foxglove_layout())["configById"].values()
        for path in panel.get("paths", ())
    ]
    assert {path.removeprefix("/sample.") for path in shown} <= set(ORDER)


@pytest.mark.parametrize("kind", DataFormat)
def test_exports_are_read_back_with_metadata_and_samples(kind: DataFormat, tmp_path: Path) -> None:
    file = tmp_path / f"data.{kind}"
    export = export_columns(COLUMNS, "samples")
    formats.write_export(export, kind, file)
    facts, batches = formats.read_export(file)
    assert facts == export.facts
    parts = list(batches)
    for name in ORDER:
        found = np.concatenate([part[name] for part in parts])
        assert found.dtype == (np.float64 if name == "t" else np.float32)
        np.testing.assert_array_equal(found, COLUMNS[name].astype(found.dtype))
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


@pytest.mark.parametrize("kind", DataFormat)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_a_truncated_file_is_rejected(kind: DataFormat, share: float, tmp_path: Path) -> None:
    file = tmp_path / f"data.{kind}"
    whole = written(COLUMNS, kind)
    file.write_bytes(whole[: int(share * len(whole))])
    if kind is DataFormat.CSV and share:
        return  # CSV has no end marker: the digest detects missing content
    with pytest.raises(ImportRefusedError):
        list(formats.read_export(file)[1])


def test_a_run_with_too_many_samples_for_matlab_is_rejected_immediately(tmp_path: Path) -> None:
    export = export_columns(COLUMNS, "run 7")
    object.__setattr__(export.facts, "samples", 268_435_456)
    with refused(ExportError, "too_many_samples_for_matlab", content="run 7", samples=268_435_456):
        matlab.write(Export(export.facts, export.batches), tmp_path)


# Derived signals follow the recorded columns of an export, and an import omits them.

EXPRESSION = "(F_A + F_B) / 2"


@pytest.mark.parametrize("kind", DataFormat)
def test_an_export_with_derived_signals_is_imported_without_them(
    here: Database, there: Database, kind: DataFormat, tmp_path: Path
) -> None:
    with here.session() as session:
        run = recorded(session)
        steps = [asdict(step) for step in parse_derived_signal("F_mean", "N", EXPRESSION).steps]
        formulas.save(session, "F_mean", EXPRESSION, steps, "N", "", "Ana")
    export = export_run(here, run, ["F_mean"])
    assert (export.facts.names[-1], export.facts.columns[-1].unit) == ("F_mean", "N")
    assert EXPRESSION in export.facts.columns[-1].meaning
    for batch in export.batches():
        np.testing.assert_allclose(batch["F_mean"], (batch["F_A"] + batch["F_B"]) / 2, rtol=1e-6)
    file = tmp_path / f"run.{kind}"
    write_export(export, kind, file)
    taken = import_export(there, file, "Ben")
    with here.reading() as one, there.reading() as other:
        assert recordings.get(other, taken.run).fields == recordings.get(one, run).fields
        before, after = read_samples(one, run), read_samples(other, taken.run)
    for name, column in before.columns.items():
        np.testing.assert_array_equal(after.columns[name], column)


def test_an_unknown_formula_is_refused(here: Database) -> None:
    with here.session() as session:
        run = recorded(session)
    with refused(ExportError, "formulas_not_found", names=["F_mean"]):
        export_run(here, run, ["F_mean"])
