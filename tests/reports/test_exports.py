"""Exports read back by the libraries that their users read them with."""

import csv
import io

import numpy as np
import pyarrow.parquet
from scipy.io import loadmat

from backend.reports.exports import ORDER, to_csv, to_mat, to_parquet
from backend.sample import STORED_NAMES
from tests.reports.tracking_run import PLAN, samples

COLUMNS = {name: column[:2_000] for name, column in samples(PLAN).items()}


def test_csv_has_the_documented_columns_in_order_and_the_values() -> None:
    assert to_csv(COLUMNS).startswith(b"t,q,q_ref,S,S_ref,theta_A,theta_B,F_A,F_B,u_A,u_B,")
    rows = list(csv.reader(io.StringIO(to_csv(COLUMNS).decode())))
    assert sorted(rows[0]) == sorted([*STORED_NAMES, "t"])
    assert tuple(rows[0]) == ORDER
    data = np.array(rows[1:], dtype=float)
    assert data.shape == (2_000, len(ORDER))
    np.testing.assert_allclose(data[:, ORDER.index("S")], COLUMNS["S"], rtol=1e-6)
    assert data[1, 0] == 0.001
    assert np.isnan(data[:, ORDER.index("S_true")]).all()


def test_parquet_carries_units() -> None:
    table = pyarrow.parquet.read_table(io.BytesIO(to_parquet(COLUMNS)))
    assert tuple(table.column_names) == ORDER
    assert table.schema.field("S").metadata[b"unit"] == "N·m/rad".encode()
    np.testing.assert_allclose(table["F_A"].to_numpy(), COLUMNS["F_A"], rtol=1e-6)


def test_mat_opens_with_units_beside_the_signals() -> None:
    content = loadmat(io.BytesIO(to_mat(COLUMNS)), simplify_cells=True)  # type: ignore[arg-type]  # the stubs know paths only
    np.testing.assert_allclose(content["q"], COLUMNS["q"])
    assert content["units"]["theta_A"] == "rad"
