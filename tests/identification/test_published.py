"""Table 1 against the paper, number by number, as printed except a1 of G_q (docs/explanation/errata.md, E2)."""

import pytest

from backend.identification.models import TABLE_1

PRINTED = {
    # F [N]: K and T of G_q, a2 and a1 of G_q, K and T of G_S, a2 and a1 of G_S
    10.0: ("0.0498", "0.64", "7.329e-5", "0.05747", "1.17", "0.57", "2.3e-5", "1.6e-3"),
    20.0: ("0.0484", "0.78", "4.919e-5", "0.04688", "2.826", "1.19", "2.1e-5", "2.2e-3"),
    30.0: ("0.0495", "1.58", "3.475e-5", "0.03309", "1.821", "0.62", "1.3e-5", "4.2e-3"),
    40.0: ("0.0491", "2.98", "2.2e-6", "1.07e-2", "1.47", "0.43", "7.7e-6", "7.4e-4"),
}
NOMINAL_S = {10.0: 8.24, 20.0: 10.55, 30.0: 12.43, 40.0: 14.06}


@pytest.mark.parametrize("tension", PRINTED)
def test_each_number_is_the_papers(tension: float) -> None:
    row, (K_q, T_q, a2_q, a1_q, K_S, T_S, a2_S, a1_S) = TABLE_1[tension], map(float, PRINTED[tension])
    assert (row.S, row.K_q, row.T_q, row.a2_q) == (NOMINAL_S[tension], K_q, T_q, a2_q)
    assert row.a1_q == pytest.approx(a1_q / 10.0, rel=1e-12)
    assert (row.K_S, row.T_S, row.a2_S, row.a1_S) == (K_S, T_S, a2_S, a1_S)


def test_there_are_no_other_rows() -> None:
    assert set(TABLE_1) == set(PRINTED)
