"""``sinew rig check``: whether a wiring file can be used, all that is wrong with it at once."""

from typing import Annotated

import typer

from backend.cli.output import AsJson, fail, print_json
from backend.cli.place import WiringFile, settings_with


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
    from plant.wiring import load_wiring
    from plant.wiring_errors import WiringError

    try:
        found = load_wiring(settings_with(wiring=wiring).wiring)
    except WiringError as error:
        if as_json:
            print_json({"problems": [problem._asdict() for problem in error.problems]})
        fail(str(error))
        return
    if as_json:
        print_json({"wiring": found.title, "problems": []})
        return
    print(f"{found.title}: channels, units and calibrations are in order")
    if open_card:
        _read_once(found.title, settings_with(wiring=wiring).wiring)
    else:
        print("Signs and swapped wires show in the bring-up: its wiring test and direction step name the entry")


def _read_once(title: str, wiring: str) -> None:
    from plant.catalog import require_available, wiring_of_choice
    from plant.choice import PlantChoice, PlantKind

    choice = PlantChoice(PlantKind.RIG, wiring=wiring)
    require_available(choice)
    from plant.daq import Daq

    daq = Daq(wiring_of_choice(choice))
    try:
        daq.open()
        raw = daq.read()
    finally:
        daq.close()
    print(f"{title}: {raw.V_A:.4f} V, {raw.V_B:.4f} V; counts {raw.n_q:g}, {raw.n_A:g}, {raw.n_B:g}")
    print(f"safety module {'tripped' if raw.tripped else 'not tripped'}, end switch {'held' if raw.at_end else 'free'}")
