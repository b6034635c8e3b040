"""An export with derived signals: behind the recorded columns, and taken in again without them."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from backend.experiments.parser import parse_derived_signal
from backend.exports.base import ExportError, export_run
from backend.exports.formats import DataFormat, write_export
from backend.exports.importer import import_export
from backend.recording.reader import read_samples
from backend.storage import formulas, recordings
from backend.storage.database import Database
from tests.exports.stored import recorded

EXPRESSION = "(F_A + F_B) / 2"


@pytest.mark.parametrize("kind", DataFormat)
def test_it_is_taken_in_again_without_what_was_derived(
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
    with pytest.raises(ExportError, match="there is no formula F_mean"):
        export_run(here, run, ["F_mean"])
