"""``sinew rig bring-up``, ``tare`` and ``calibrate``: the steps of the page Bring-up, at a terminal."""

from enum import StrEnum
from typing import Annotated

import typer

from backend.cli.output import AsJson, fail
from backend.cli.place import (
    CardAddress,
    DataFolder,
    ParameterSet,
    PlantName,
    StationName,
    VirtualCard,
    WiringFile,
    settings_with,
)
from backend.cli.rig_steps import Order, not_done, play, require_rig, show
from backend.commissioning.steps import MORE_WEIGHTS, STEPS, StepId


class LoadCell(StrEnum):
    """Which load cells are calibrated."""

    A = "A"
    B = "B"
    BOTH = "AB"


def bring_up(
    step: Annotated[
        list[StepId] | None,
        typer.Option(
            "--step", help="Play this step; repeatable, in their order. [all that are not done or out of date]"
        ),
    ] = None,
    listed: Annotated[bool, typer.Option("--list", help="Only tell how the steps stand; nothing is started.")] = False,
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Bring a rig up, guided: small steps at low voltage, each kept with date and person; exit 1 where one fails.

    Each step says what to do at the rig and waits for Enter; Ctrl-C ends it at zero volts, and nothing is kept of a
    step that has not ended; but directions whose trial is given up are not proven any more.
    On the virtual card the program's own hand does what is asked for, and answers may come from a pipe, a line each.
    """
    settings = settings_with(
        plant=plant,
        virtual_card=virtual_card,
        wiring=wiring,
        card_address=card_address,
        params=params,
        data=data,
        station=station,
    )
    require_rig(settings)
    wanted = [found.id for found in STEPS if found.id in step] if step else not_done(settings)
    if listed or not wanted:
        show(settings, as_json=as_json)
    else:
        play(settings, [Order(found) for found in wanted], as_json=as_json)


def tare(
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Take 1 s of both load cells without load as their zeros; needs a wiring test of this wiring."""
    settings = settings_with(
        plant=plant,
        virtual_card=virtual_card,
        wiring=wiring,
        card_address=card_address,
        params=params,
        data=data,
        station=station,
    )
    require_rig(settings)
    play(settings, [Order(StepId.TARE)], as_json=as_json)


def calibrate(
    weight: Annotated[list[float], typer.Option("--weight", help="Known weight [N]; two or more, 5 N apart at least.")],
    load_cell: Annotated[
        LoadCell, typer.Option("--load-cell", help="Which load cell, or both in turn.")
    ] = LoadCell.BOTH,
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate load cells with known weights, the best line through them; needs a wiring test of this wiring.

    Calibration counts as done once both load cells have been calibrated with this wiring.
    """
    from backend.commissioning.session import values_of

    most = 2 + len(MORE_WEIGHTS)
    if not 2 <= len(weight) <= most:
        fail(f"--weight: two known weights at least, and {most} at most; {len(weight)} given", status=2)
    lightest, *between, heaviest = sorted(weight)
    names = ["weight_1_N", "weight_2_N", *(more.name for more in MORE_WEIGHTS)]
    values = values_of(StepId.CALIBRATE, dict(zip(names, (lightest, heaviest, *between), strict=False)))
    settings = settings_with(
        plant=plant,
        virtual_card=virtual_card,
        wiring=wiring,
        card_address=card_address,
        params=params,
        data=data,
        station=station,
    )
    require_rig(settings)
    play(settings, [Order(StepId.CALIBRATE, values, load_cell)], as_json=as_json)
