"""``sinew experiment``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.ordering import current_user, in_force, ordered, run_headless, run_in_turn, values_of
from backend.cli.output import AsJson, fail
from backend.cli.place import (
    DataFolder,
    ParameterSet,
    PlantName,
    StationName,
    VirtualCard,
    WiringFile,
    database_of,
    settings_with,
)
from backend.settings import Settings

if TYPE_CHECKING:
    from backend.experiments.library import Entry

SetWords = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Setting of the experiment or the loop, in SI units; repeatable."),
]
OutFolder = Annotated[
    Path | None, typer.Option("--out", help="Folder for report.html, report.pdf, data.csv and metrics.json.")
]


def experiment(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME...",
            help="Which experiment: a name of sinew experiments list, name@2, or a file of one; several play in turn.",
        ),
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
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Run experiments headless on the simulator, faster than real time; stored like those from the browser.

    Several play in turn, each with the settings that are said, until one does not complete; their files go to a folder
    for each run.

    Its settings, such as q_amplitude [rad], S_hold [N·m/rad] or hold_s [s], are told by sinew experiments show NAME.
    Settings of the loop: lam_q, lam_S, lam_motor [s], b (0 to 1), bank (number, 0 for gains from geometry),
    interpolate (true, false), seed. What is not set is as it is in force in the data folder.
    """
    from backend.execution.runner import Order

    chosen = values_of(values or []) | ({} if controller is None else {"controller": controller})
    settings = settings_with(
        plant=plant, virtual_card=virtual_card, wiring=wiring, params=params, data=data, station=station
    )
    standing, who = in_force(settings), current_user()
    orders = []
    for name in names:
        entry = entry_of(name, settings)
        plan, loop_settings, tuning = ordered(entry.settings, entry.make, chosen, standing)
        orders.append(Order(plan, loop_settings, who))
    if len(orders) == 1:
        run_headless(settings, orders[0], tuning, out, as_json=as_json)
    else:
        run_in_turn(settings, orders, tuning, out, as_json=as_json)


def entry_of(name: str, settings: Settings) -> "Entry":
    """Return the experiment of a name or a file. Raises SettingError, ExperimentError."""
    from backend.archive.own_experiments import OwnExperiments
    from backend.experiments import library, parser

    if Path(name).suffix in (".yaml", ".yml", ".json"):
        return library.entry_of(*parser.read(text_in(Path(name))))
    if name in library.experiments():
        return library.experiment(name)
    with database_of(settings, reading=True) as database:
        return OwnExperiments(database).entry(name)


def text_in(file: Path) -> str:
    """Return what a file says; one that cannot be read ends the command."""
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        fail(f"{file} cannot be read: {error}", status=2)
