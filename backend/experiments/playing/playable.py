"""The program of a plan on one plant, with the gains of every tuning that it puts into use, or why it cannot be."""

from collections.abc import Callable
from dataclasses import replace

from backend.banks.builder import points_of, tuning_command
from backend.banks.tuning_settings import TuningChoice
from backend.errors import Path, RefusedValueError
from backend.experiments.composing.reach import require_reach
from backend.experiments.composing.refused import ExperimentError, line_of
from backend.experiments.plans.composed_plan import ComposedPlan
from backend.experiments.plans.plan import Plan
from backend.experiments.results.measures import require_measurable
from backend.realtime.program import Program, SetTuning
from backend.storage import banks
from backend.storage.banks import Bank
from backend.storage.database import Database
from backend.storage.orm import UnknownRecordError
from backend.tuning.gains import TuningError
from backend.tuning.preview import Previewer
from plant.parameters import PlantParameters

BankOf = Callable[[int], Bank]
"""Returns the bank of a number. Raises UnknownRecordError."""


def banks_in(database: Database) -> BankOf:
    """Return what looks banks up in a database."""

    def bank_of(number: int) -> Bank:
        with database.reading() as session:
            return banks.own(session, number)

    return bank_of


def playable(bank_of: BankOf, parameters: PlantParameters, plan: Plan, tuning: TuningChoice) -> Program:
    """Return what the loop plays, begun with ``tuning``; takes a while for each change of it.

    Raises ExperimentError naming line and bound: a reference that the plant does not reach, λ that is not safe on the
    models of its bank, a bank that is not there.
    """
    program = plan.program()
    if not isinstance(plan, ComposedPlan):
        return program
    require_measurable(plan.experiment, plan.values, plan.lines)
    require_reach(plan.laid, parameters, plan.lines)
    tunings = tuple(
        _command(bank_of, parameters, plan, choice, place)
        for place, choice in zip(plan.laid.change_places, choices_of(plan, tuning), strict=True)
    )
    return replace(program, tunings=tunings)


def choices_of(plan: Plan, tuning: TuningChoice) -> list[TuningChoice]:
    """Return the tunings that a plan which begins with ``tuning`` puts into use, in their order."""
    changes = plan.laid.changes if isinstance(plan, ComposedPlan) else ()
    return [tuning.with_parts(change) for change in changes]


def banks_of(plan: Plan) -> set[int]:
    """Return the numbers of the banks that a plan puts into use on its way."""
    changes = plan.laid.changes if isinstance(plan, ComposedPlan) else ()
    return {int(change["bank"]) for change in changes if "bank" in change}


def _command(
    bank_of: BankOf, parameters: PlantParameters, plan: ComposedPlan, choice: TuningChoice, path: Path
) -> SetTuning:
    line = line_of(path, plan.lines)
    try:
        bank = bank_of(choice.bank) if choice.bank else None
        previewer = Previewer(parameters, points_of(bank), lam_motor=choice.lam_motor, b=choice.b)
        previewer.require_safe(choice.lambdas, choice.budget)
        return tuning_command(parameters, choice, bank)
    except RefusedValueError as error:
        raise ExperimentError(error, path, line) from None
    except (UnknownRecordError, TuningError) as error:
        raise ExperimentError(str(error), path, line) from None
