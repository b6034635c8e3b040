"""``sinew identify``."""

import typer

from backend.cli.experiment import OutFolder, SetWords
from backend.cli.ordering import current_user, run_headless, values_of
from backend.cli.output import AsJson
from backend.cli.place import DataFolder, ParameterSet, settings_with

app = typer.Typer(
    help="Identify models from experiments on the simulator.", no_args_is_help=True, rich_markup_mode=None
)


@app.callback()
def _group() -> None:
    """Keep ``actuator`` a word of its own."""


@app.command()
def actuator(
    values: SetWords = None,
    out: OutFolder = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Identify G_q and G_S in closed loop at one tendon tension (method section 4).

    Settings: tension_N [N], amplitude_rad [rad], chip_s [s], bits, periods, settle_s [s].
    Settings of the loop: lam_q, lam_S, lam_motor [s], seed.
    """
    from backend.experiments.loop_settings import split_values
    from backend.experiments.plans import ActuatorIdentificationPlan
    from backend.experiments.runner import Order

    plan, loop_settings = split_values(ActuatorIdentificationPlan, values_of(values or []))
    settings = settings_with(params=params, data=data)
    run_headless(settings, Order(plan, loop_settings, current_user()), out, as_json=as_json)
