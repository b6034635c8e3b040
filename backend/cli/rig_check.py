"""``sinew rig check``: whether a wiring file can be used, all that is wrong with it at once."""

from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.output import AsJson, fail, print_json
from backend.cli.place import WiringFile, settings_with
from backend.plain_text import as_line

if TYPE_CHECKING:
    from plant.daq import Raw


def check(
    wiring: WiringFile = None,
    open_card: Annotated[
        bool, typer.Option("--open", help="Open the card too, at zero volts with the drives off, and read it once.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check a wiring file: channels, calibrations, units, each mistake with its line and remedy; exit 1 for one.

    Signs and swapped wires cannot be told from a file: the bring-up's wiring test and direction step find them.
    """
    from plant.wiring import WiringError, load_wiring

    try:
        found = load_wiring(settings_with(wiring=wiring).wiring)
    except WiringError as error:
        if as_json:
            print_json({"problems": [problem._asdict() for problem in error.problems]})
        fail(*error.sentences)
    read = _read_once(settings_with(wiring=wiring).wiring) if open_card else None
    if as_json:
        print_json({"wiring": found.title, "problems": []} | ({} if read is None else {"read": read._asdict()}))
        return
    title = as_line(found.title)
    print(f"{title}: channels, units and calibrations are in order")
    if read is not None:
        counts = f"{read.n_q:g}, {read.n_A:g}, {read.n_B:g}"
        print(f"{title}: {read.V_A:.4f} V, {read.V_B:.4f} V; counts {counts}")
        tripped, held = "tripped" if read.tripped else "not tripped", "held" if read.at_end else "free"
        print(f"safety module {tripped}, end switch {held}")
    else:
        print("Signs and swapped wires show in the bring-up: its wiring test and direction step name the entry")


def _read_once(wiring: str) -> "Raw":
    from plant.factory import require_available, wiring_of_choice
    from plant.interface import PlantChoice, PlantKind

    choice = PlantChoice(PlantKind.RIG, wiring=wiring)
    require_available(choice)
    from plant.daq import Daq

    daq = Daq(wiring_of_choice(choice))
    try:
        daq.open()
        return daq.read()
    finally:
        daq.close()
