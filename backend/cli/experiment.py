"""``sinew experiment``."""

from pathlib import Path
from typing import Annotated

import typer

from backend.cli.ordering import current_user, in_force, ordered, run_headless, values_of
from backend.cli.output import AsJson
from backend.cli.place import DataFolder, ParameterSet, PlantName, VirtualCard, WiringFile, settings_with

SetWords = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Setting of the experiment or the loop, in SI units; repeatable."),
]
OutFolder = Annotated[
    Path | None, typer.Option("--out", help="Folder for report.html, report.pdf, data.csv and metrics.json.")
]


def experiment(
    name: Annotated[str, typer.Argument(help="Which experiment: tracking, compliance, robustness or sequence.")],
    values: SetWords = None,
    controller: Annotated[
        str | None,
        typer.Option("--controller", help="Of tracking: cascade, single-loop or feedback-linearization."),
    ] = None,
    out: OutFolder = None,
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Run an experiment headless on the simulator, faster than real time; stored like one from the browser.

    Settings of tracking: q_amplitude, q_hold [rad], S_hold, S_low, S_high [N·m/rad], q_duration_s, S_duration_s [s].
    Settings of robustness: load_Nm [N·m], q_ref [rad], S_ref [N·m/rad], hold_s [s].
    Settings of the loop: lam_q, lam_S, lam_motor [s], b (0 to 1), bank (number, 0 for gains from geometry),
    interpolate (true, false), seed. What is not set is as it is in force in the data folder.
    """
    from backend.experiments.plans.catalogue import experiment as entry_of
    from backend.experiments.playing.runner import Order

    chosen = values_of(values or []) | ({} if controller is None else {"controller": controller})
    settings = settings_with(plant=plant, virtual_card=virtual_card, wiring=wiring, params=params, data=data)
    entry = entry_of(name)
    plan, loop_settings, tuning = ordered(entry.settings, entry.make, chosen, in_force(settings))
    run_headless(settings, Order(plan, loop_settings, current_user()), tuning, out, as_json=as_json)
