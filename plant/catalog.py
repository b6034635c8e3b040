"""Make the plant that was chosen."""

from importlib.util import find_spec

from plant.brought_up import NOT_BROUGHT_UP, BroughtUp, calibrated, fingerprint, found_with
from plant.card import Card
from plant.choice import PlantChoice, PlantKind
from plant.interface import Plant, PlantError
from plant.packages import load_maker, plant_of_package
from plant.parameters import PlantParameters
from plant.recording import load_recording, look_over
from plant.replay import Replay
from plant.simulator import Simulator
from plant.wiring import Wiring, load_wiring
from plant.wiring_errors import WiringError

_NEEDS_EXTRA = (
    "driving a card needs NI's Python package, which is not installed: install Sinew with its extra rig, "
    "`make run EXTRAS=rig` or pip install 'sinew[rig]'"
)


def require_available(choice: PlantChoice) -> None:
    """Raise PlantError, in one line, where what the choice needs is not installed or cannot be read."""
    if choice.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD) and find_spec("nidaqmx") is None:
        raise PlantError(_NEEDS_EXTRA)
    if choice.kind is PlantKind.REPLAY:
        look_over(choice.recording)
    if choice.kind is PlantKind.PACKAGE:
        load_maker(choice.package)


def make_plant(
    choice: PlantChoice,
    parameters: PlantParameters,
    seed: int,
    card: Card | None = None,
    brought_up: BroughtUp = NOT_BROUGHT_UP,
    *,
    drives_off: bool = False,
) -> Plant:
    """Make a plant, not yet open. Raises PlantError.

    ``card`` holds the registers that outlive this process; None for a plant that is stepped as fast as it goes.
    ``brought_up`` is what is known of a rig with this wiring; with ``drives_off`` its drives stay off as it is opened.
    """
    if choice.kind not in (PlantKind.REPLAY, PlantKind.PACKAGE):  # these are looked at as they are made
        require_available(choice)
    match choice.kind:
        case PlantKind.SIMULATOR:
            if card is not None:
                card.start_watchdog()  # its process comes up while the rehearsal computes
            return Simulator(parameters, seed, card=card)
        case PlantKind.RIG:
            return _rig(choice, card, brought_up, drives_off)
        case PlantKind.VIRTUAL_CARD:
            return _virtual_rig(choice, parameters, seed, card, brought_up, drives_off)
        case PlantKind.REPLAY:
            return Replay(load_recording(choice.recording))
        case PlantKind.PACKAGE:
            return plant_of_package(choice.package, parameters, seed)


# What follows imports NI's package, which is not there in every installation.


def _rig(choice: PlantChoice, card: Card | None, brought_up: BroughtUp, drives_off: bool) -> Plant:
    from plant.daq import Daq
    from plant.rig import Rig

    said = wiring_of_choice(choice)
    known = found_with(fingerprint(said), brought_up)  # the file may have been edited since that was looked up
    wiring = calibrated(said, known.calibrations)
    daq = Daq(wiring)
    if choice.address:
        from plant.device_server import DeviceServer

        daq = Daq(wiring, DeviceServer(choice.address).options)
    return Rig(
        wiring,
        daq,
        card,
        directions_proven=known.directions_proven,
        load_cells_measured=known.load_cells_measured,
        server=choice.address,
        drives_off=drives_off,
        wired=known.wired,
    )


def _virtual_rig(
    choice: PlantChoice,
    parameters: PlantParameters,
    seed: int,
    card: Card | None,
    brought_up: BroughtUp,
    drives_off: bool,
) -> Plant:
    from plant.virtual_rig import VirtualRig

    true = wiring_of_choice(choice)
    known = found_with(fingerprint(true), brought_up)
    wiring = calibrated(true, known.calibrations)
    return VirtualRig(
        wiring,
        Simulator(parameters, seed),
        card,
        true,
        directions_proven=known.directions_proven,
        load_cells_measured=known.load_cells_measured,
        drives_off=drives_off,
        wired=known.wired,
    )


def wiring_of_choice(choice: PlantChoice) -> Wiring:
    """Return the wiring of a rig as its file says it. Raises PlantError."""
    try:
        return load_wiring(choice.wiring)
    except WiringError as error:
        raise PlantError(str(error)) from error
