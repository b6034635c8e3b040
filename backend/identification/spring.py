"""Spring characteristic from a load sweep: polynomials, and the recommended order.

See figure 3.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import Polynomial

from backend.identification import messages
from backend.identification.records import DataFileError, FileFault, RecordError, Signal
from backend.identification.tables import Columns, DecimalMark, read_csv
from plant import Message

ORDERS = (2, 3, 5)
MIN_POINTS_PER_ORDER = 2
MIN_IMPROVEMENT = 0.2
NOISE_SHARE = 0.02
_LENGTH_UNITS = {"m": 1.0, "mm": 1e-3}


@dataclass(frozen=True)
class SpringFit:
    """Polynomial F(x) = k_0 + k_1 x + ... with its errors.

    ``k`` and ``std_errors`` in N/m^i, lowest power first, shape (order + 1,); ``errors`` [N] measured minus fitted,
    shape (n,); ``cross_validation_N`` is the RMS error of leave-one-out cross-validation.
    """

    order: int
    k: tuple[float, ...]
    std_errors: tuple[float, ...]
    errors: Signal = field(repr=False)
    rms_N: float
    max_N: float
    cross_validation_N: float
    rising: bool

    def force(self, x: Signal) -> Signal:
        """Return the force [N] at elongation ``x`` [m], same shape."""
        return np.asarray(np.polyval(self.k[::-1], x))


@dataclass(frozen=True)
class SpringIdentification:
    """Fits of all orders, the recommended order and the reason."""

    fits: tuple[SpringFit, ...]
    recommended: int
    reason: Message

    @property
    def best(self) -> SpringFit:
        """Fit of the recommended order."""
        return next(fit for fit in self.fits if fit.order == self.recommended)


def identify_spring(x: Signal, F: Signal, orders: tuple[int, ...] = ORDERS) -> SpringIdentification:
    """Fit polynomials to elongations ``x`` [m] and forces ``F`` [N] of a taut spring.

    Shape (n,) each. Raises RecordError for points that are too few, not finite, without spread, or not taut.
    """
    x, F = np.asarray(x, dtype=np.float64), np.asarray(F, dtype=np.float64)
    _check_points(x, F, max(orders))
    fits = tuple(_fit(x, F, order) for order in orders)
    recommended, reason = _recommend(fits)
    return SpringIdentification(fits, recommended, reason)


def read_load_sweep(
    text: str, *, header: int | None = None, decimal: DecimalMark | None = None
) -> tuple[Signal, Signal, Columns]:
    """Return elongation [m] and force [N], shape (n,) each, and the columns of a CSV.

    It has the columns ``x [m]`` or ``x [mm]``, and ``F [N]``; ``header`` and ``decimal`` as in :func:`read_csv`. Raises
    DataFileError.
    """
    columns = read_csv(text, header=header, decimal=decimal)
    x, F = columns.column("x"), columns.column("F")
    for name, units in (("x", ("m", "mm")), ("F", ("N",))):
        if columns.units[name] not in units:
            raise DataFileError(
                messages.unit_of_load_sweep(name=name, unit=columns.units[name]),
                FileFault.NO_COLUMN,
                column=name,
            )
    return x * _LENGTH_UNITS[columns.units["x"]], F, columns


def _check_points(x: Signal, F: Signal, order: int) -> None:
    if x.shape != F.shape or x.ndim != 1:
        raise RecordError(messages.forces_unlike_elongations(forces=F.size, elongations=x.size))
    bad = int(np.count_nonzero(~(np.isfinite(x) & np.isfinite(F))))
    if bad:
        raise RecordError(messages.points_not_finite(count=bad))
    needed = MIN_POINTS_PER_ORDER * (order + 1)
    if np.unique(x).size < needed:
        raise RecordError(messages.too_few_elongations(count=np.unique(x).size, minimum=needed))
    lowest = -NOISE_SHARE * float(np.max(F))
    if float(np.min(F)) < lowest:
        raise RecordError(messages.tendon_pushes(force_N=float(np.min(F)), minimum_N=lowest))


def _fit(x: Signal, F: Signal, order: int) -> SpringFit:
    # The columns are scaled by Polynomial.fit: raw powers of millimetres lose six digits.
    scaled = Polynomial.fit(x, F, order)
    offset, scale = scaled.mapparms()
    columns = np.vander(offset + scale * x, order + 1, increasing=True)
    Q, R = np.linalg.qr(columns)
    errors = F - scaled(x)
    leverage = np.sum(Q**2, axis=1)
    spread = np.sum(errors**2) / max(x.size - order - 1, 1)
    to_powers = np.column_stack([_powers(offset, scale, power, order) for power in range(order + 1)])
    root = to_powers @ np.linalg.inv(R)
    k = to_powers @ np.asarray(scaled.coef, dtype=np.float64)
    slope = scaled.deriv()(np.linspace(x.min(), x.max(), 200))
    return SpringFit(
        order=order,
        k=tuple(k.tolist()),
        std_errors=tuple(np.sqrt(spread * np.sum(root**2, axis=1)).tolist()),
        errors=errors,
        rms_N=float(np.sqrt(np.mean(errors**2))),
        max_N=float(np.max(np.abs(errors))),
        cross_validation_N=float(np.sqrt(np.mean((errors / (1.0 - leverage)) ** 2))),
        rising=bool(np.all(slope > 0.0)),
    )


def _powers(offset: float, scale: float, power: int, order: int) -> Signal:
    """Return the coefficients of (offset + scale x)^power in powers of x.

    The result is padded to ``order + 1``.
    """
    coefficients = (Polynomial([offset, scale]) ** power).coef
    return np.pad(coefficients, (0, order + 1 - coefficients.size))


def _recommend(fits: tuple[SpringFit, ...]) -> tuple[int, Message]:
    """Return the lowest order, unless a higher one predicts much better and rises.

    The criterion is cross-validation.
    """
    chosen = fits[0]
    for fit in fits[1:]:
        if fit.rising and fit.cross_validation_N < (1.0 - MIN_IMPROVEMENT) * chosen.cross_validation_N:
            chosen = fit
    errors_N = {fit.order: fit.cross_validation_N for fit in fits}
    if chosen is fits[0]:
        return chosen.order, messages.lowest_order_suffices(
            order=chosen.order, improvement_percent=100 * MIN_IMPROVEMENT, errors_N=errors_N
        )
    return chosen.order, messages.higher_order_is_better(order=chosen.order, errors_N=errors_N)
