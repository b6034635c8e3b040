"""What would change if one bank were used in place of another: models, gains, and M_s of the loops. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from backend.control import pid
from backend.experiments.banks.bank_consistency import point_of
from backend.storage.banks import BankEntry
from backend.tuning.gains import Lambdas, motor_loops, position_gains, stiffness_gains
from backend.tuning.robustness import OuterProcess, decoupled_model
from plant.parameters import PlantParameters

SAME_POINT = 1.0
"""Entries of two banks this close in stiffness [N·m/rad] are two identifications of the same point."""


@dataclass(frozen=True)
class LoopFigures:
    """One outer loop at one point: model K, T [s], gains at the λ in force, and M_s on the high-order model.

    ``M_s`` is None where the loop would be unstable.
    """

    K: float
    T: float
    k_p: float
    k_i: float
    M_s: float | None


@dataclass(frozen=True)
class EntryFigures:
    """Both loops of one entry, at its stiffness [N·m/rad] and tension [N]."""

    S_nominal: float
    tension_N: float | None
    estimate: int | None
    position: LoopFigures
    stiffness: LoopFigures


@dataclass(frozen=True)
class EntryDifference:
    """An entry before and after; one of them is None where it is new or gone."""

    before: EntryFigures | None
    after: EntryFigures | None


def figures_of(parameters: PlantParameters, lambdas: Lambdas, entry: BankEntry) -> EntryFigures:
    """Return models, gains and M_s of one entry. Raises TuningError for λ without gains."""
    point = point_of(entry)
    model = decoupled_model(parameters, motor_loops(parameters, lambdas.lam_motor), point.S_nominal)
    q, S = position_gains(parameters, point, lambdas), stiffness_gains(parameters, point, lambdas)
    return EntryFigures(
        S_nominal=point.S_nominal,
        tension_N=entry.known.tension_N,
        estimate=entry.identification_id,
        position=_loop(point.K_q, point.T_q, q, OuterProcess(model[0, 0])),
        stiffness=_loop(point.K_S, point.T_S, S, OuterProcess(model[1, 1])),
    )


def figures_of_all(
    parameters: PlantParameters, lambdas: Lambdas, entries: Sequence[BankEntry]
) -> tuple[EntryFigures, ...]:
    """Return models, gains and M_s of every entry. Raises TuningError for λ without gains."""
    return tuple(figures_of(parameters, lambdas, entry) for entry in entries)


def difference(
    parameters: PlantParameters, lambdas: Lambdas, before: Sequence[BankEntry], after: Sequence[BankEntry]
) -> tuple[EntryDifference, ...]:
    """Return what changes from one set of entries to another, in order of stiffness."""
    left = [figures_of(parameters, lambdas, entry) for entry in after]
    pairs: list[EntryDifference] = []
    for entry in before:
        old = figures_of(parameters, lambdas, entry)
        near = [new for new in left if abs(new.S_nominal - old.S_nominal) < SAME_POINT]
        match = min(near, key=lambda new: abs(new.S_nominal - old.S_nominal), default=None)
        if match is not None:
            left.remove(match)
        pairs.append(EntryDifference(old, match))
    pairs += [EntryDifference(None, new) for new in left]
    return tuple(sorted(pairs, key=_stiffness))


def with_entries(bank: Sequence[BankEntry], new: Sequence[BankEntry]) -> tuple[BankEntry, ...]:
    """Return the entries of a bank after identifying some of its points again: nearest entries are replaced."""
    kept = [entry for entry in bank if all(abs(entry.S_nominal - item.S_nominal) >= SAME_POINT for item in new)]
    return tuple(sorted([*kept, *new], key=lambda entry: entry.S_nominal))


def _loop(K: float, T: float, gains: pid.IPGains, process: OuterProcess) -> LoopFigures:
    M_s = process.sensitivity_peak(gains)
    return LoopFigures(K, T, gains.k_p, gains.k_i, M_s if isfinite(M_s) else None)


def _stiffness(pair: EntryDifference) -> float:
    present = pair.before or pair.after
    return present.S_nominal if present else 0.0
