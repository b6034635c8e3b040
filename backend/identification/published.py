"""Table 1 of the paper: what its authors identified on their rig, to set beside what is identified here."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """A row: S [N·m/rad] at the point; K, T [s], a2 [s²] and a1 [s] of G_q and of G_S.

    ``a1_q`` as read by erratum E2, a tenth of the printed one.
    """

    S: float
    K_q: float
    T_q: float
    K_S: float
    T_S: float
    a2_q: float
    a1_q: float
    a2_S: float
    a1_S: float


TABLE_1 = {
    10.0: Published(8.24, 0.0498, 0.64, 1.17, 0.57, 7.329e-5, 5.747e-3, 2.3e-5, 1.6e-3),
    20.0: Published(10.55, 0.0484, 0.78, 2.826, 1.19, 4.919e-5, 4.688e-3, 2.1e-5, 2.2e-3),
    30.0: Published(12.43, 0.0495, 1.58, 1.821, 0.62, 3.475e-5, 3.309e-3, 1.3e-5, 4.2e-3),
    40.0: Published(14.06, 0.0491, 2.98, 1.47, 0.43, 2.2e-6, 1.07e-3, 7.7e-6, 7.4e-4),
}
"""Rows by tendon tension [N]."""
