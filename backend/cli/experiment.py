"""``sinew experiment``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.ordering import current_user, in_force, ordered, run_headless, values_of
from backend.cli.output import AsJson, fail
from backend.cli.place import DataFolder, ParameterSet, PlantName, VirtualCard, WiringFile, database_of, settings_with
from backend.settings import Settings

if TYPE_CHECKING:
    from backend.experiments.plans.catalogue import Entry

SetWords = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Setting of the experiment or the loop, in SI units; repeatable."),
]
OutFolder = Annotated[
    Path | None, typer.Option("--out", help="Folder for report.html, report.pdf, data.csv and metrics.json.")
]


def experiment(
    name: Annotated[
        str, typer.Argument(help="Which experiment: a name of sinew experiments list, name@2, or a file of one.")
    ],
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

    Its settings, such as q_amplitude [rad], S_hold [N·m/rad] or hold_s [s], are told by sinew experiments show NAME.
    Settings of the loop: lam_q, lam_S, lam_motor [s], b (0 to 1), bank (number, 0 for gains from geometry),
    interpolate (true, false), seed. What is not set is as it is in force in the data folder.
    """
    from backend.experiments.playing.runner import Order

    chosen = values_of(values or []) | ({} if controller is None else {"controller": controller})
    settings = settings_with(plant=plant, virtual_card=virtual_card, wiring=wiring, params=params, data=data)
    entry = entry_of(name, settings)
    plan, loop_settings, tuning = ordered(entry.settings, entry.make, chosen, in_force(settings))
    run_headless(settings, Order(plan, loop_settings, current_user()), tuning, out, as_json=as_json)


def entry_of(name: str, settings: Settings) -> "Entry":
    """Return the experiment of a name or a file. Raises SettingError, ExperimentError."""
    from backend.archive.own_experiments import OwnExperiments
    from backend.experiments.composing import text
    from backend.experiments.plans import catalogue

    if Path(name).suffix in (".yaml", ".yml", ".json"):
        return catalogue.entry_of(*text.read(text_in(Path(name))))
    if name in catalogue.experiments():
        return catalogue.experiment(name)
    with database_of(settings) as database:
        return OwnExperiments(database).entry(name)


def text_in(file: Path) -> str:
    """Return what a file says; one that cannot be read ends the command."""
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        fail(f"{file} cannot be read: {error}", status=2)
        raise
