"""Construction of the plant that a PlantChoice names."""

from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from typing import Any, cast

from plant import messages
from plant.calibration import (
    NO_COMMISSIONING,
    CommissioningResults,
    apply_calibration,
    select_calibration,
    wiring_fingerprint,
)
from plant.interface import NAME_MAX, Plant, PlantChoice, PlantError, PlantKind
from plant.parameters import PlantParameters
from plant.replay import Replay, load_replay, preload_replay
from plant.safety_card import Card
from plant.simulator import Simulator
from plant.wiring import Wiring, WiringError, load_wiring

# Installed plants ----------------------------------------------------------------------------------
# Plants of installed packages: entry points of the group ``sinew.plants``.


GROUP = "sinew.plants"

Maker = Callable[[PlantParameters, int], Plant]
"""Object of an entry point: (parameters, seed) -> a plant that is not yet open."""

ATTRIBUTES: tuple[str, ...] = (
    *Plant.__annotations__,
    *(name for name, member in vars(Plant).items() if isinstance(member, property)),
)
METHODS: tuple[str, ...] = tuple(name for name, member in vars(Plant).items() if callable(member) and name[0] != "_")
"""Attributes and methods that the Plant protocol requires."""


def find_installed_plants() -> dict[str, list[EntryPoint]]:
    """Return the entry points of plants by name; a duplicate name has several."""
    plants: dict[str, list[EntryPoint]] = {}
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value)):
        plants.setdefault(entry.name, []).append(entry)
    return plants


def load_maker(name: str) -> Maker:
    """Import the maker of the plant ``name``.

    Raises PlantError with the known plants, or the reason why it is not available.
    """
    known_plants = find_installed_plants()
    entries = known_plants.get(name, [])
    if not entries or name in {str(kind) for kind in PlantKind}:
        raise PlantError(messages.unknown_plant(plant=name, installed=list(known_plants)))
    if len(entries) > 1:
        raise PlantError(messages.plant_not_unique(plant=name, packages=[_package(entry) for entry in entries]))
    (entry,) = entries
    try:
        maker: Any = entry.load()
    except Exception as error:
        raise PlantError(
            messages.plant_not_imported(plant=entry.name, package=_package(entry), reason=_describe_error(error))
        ) from error
    if len(name) > NAME_MAX:
        raise PlantError(messages.plant_name_too_long(plant=name, maximum=NAME_MAX))
    if not callable(maker):
        raise PlantError(
            messages.maker_not_callable(
                plant=entry.name, package=_package(entry), maker=entry.value, kind=_describe_type(maker)
            )
        )
    return cast(Maker, maker)


def make_package_plant(name: str, parameters: PlantParameters, seed: int) -> Plant:
    """Make the plant ``name``. Raises PlantError, also if the result is not a Plant."""
    maker = load_maker(name)
    (entry,) = find_installed_plants()[name]
    try:
        plant: Any = maker(parameters, seed)
    except PlantError:
        raise
    except Exception as error:
        raise PlantError(
            messages.plant_not_created(plant=entry.name, package=_package(entry), reason=_describe_error(error))
        ) from error
    missing = find_missing_parts(plant)
    if missing:
        raise PlantError(
            messages.created_object_is_not_a_plant(
                plant=entry.name,
                package=_package(entry),
                maker=entry.value,
                kind=_describe_type(plant),
                missing=missing,
            )
        )
    return cast(Plant, plant)


def find_missing_parts(plant: object) -> str:
    """Return the parts of the Plant protocol that ``plant`` lacks, empty for a Plant."""
    missing = [name for name in ATTRIBUTES if not hasattr(plant, name)]
    missing += [f"{name}()" for name in METHODS if not callable(getattr(plant, name, None))]
    return ", ".join(missing)


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist is not None else entry.value


def _describe_error(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _describe_type(plant: object) -> str:
    kind = type(plant).__name__
    return "None" if plant is None else f"{'an' if kind[0] in 'aeioAEIO' else 'a'} {kind}"


# Catalog -------------------------------------------------------------------------------------------


def require_available(choice: PlantChoice) -> None:
    """Raise a one-line PlantError if anything the choice needs is not available."""
    if choice.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD) and find_spec("nidaqmx") is None:
        raise PlantError(messages.card_package_not_installed())
    if choice.kind is PlantKind.REPLAY:
        preload_replay(choice.recording)
    if choice.kind is PlantKind.PACKAGE:
        load_maker(choice.package)


def make_plant(
    choice: PlantChoice,
    parameters: PlantParameters,
    seed: int,
    card: Card | None = None,
    commissioning_results: CommissioningResults = NO_COMMISSIONING,
    *,
    drives_off: bool = False,
) -> Plant:
    """Make a plant, not yet open. Raises PlantError.

    ``card`` holds the registers that outlive this process, None for a plant that is stepped as fast as possible.
    ``commissioning_results`` are those of a rig; with ``drives_off`` its drives stay off when it opens.
    """
    if choice.kind not in (PlantKind.REPLAY, PlantKind.PACKAGE):  # these are checked when they are made
        require_available(choice)
    match choice.kind:
        case PlantKind.SIMULATOR:
            if card is not None:
                card.start_watchdog()  # its process starts during the rehearsal
            return Simulator(parameters, seed, card=card)
        case PlantKind.RIG:
            return _rig(choice, card, commissioning_results, drives_off)
        case PlantKind.VIRTUAL_CARD:
            return _virtual_rig(
                choice=choice,
                parameters=parameters,
                seed=seed,
                card=card,
                commissioning_results=commissioning_results,
                drives_off=drives_off,
            )
        case PlantKind.REPLAY:
            return Replay(load_replay(choice.recording))
        case PlantKind.PACKAGE:
            return make_package_plant(choice.package, parameters, seed)


# The functions below import NI's package, which is an optional dependency.


def _rig(
    choice: PlantChoice, card: Card | None, commissioning_results: CommissioningResults, drives_off: bool
) -> Plant:
    from plant.daq import Daq
    from plant.rig import Rig

    calibration = load_wiring_choice(choice)
    known = select_calibration(
        wiring_fingerprint(calibration), commissioning_results
    )  # the file may have changed since the results were looked up
    wiring = apply_calibration(calibration, known.calibrations)
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
    commissioning_results: CommissioningResults,
    drives_off: bool,
) -> Plant:
    from plant.virtual_daq import VirtualRig

    true = load_wiring_choice(choice)
    known = select_calibration(wiring_fingerprint(true), commissioning_results)
    wiring = apply_calibration(true, known.calibrations)
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


def load_wiring_choice(choice: PlantChoice) -> Wiring:
    """Return the wiring of a rig from its file. Raises PlantError."""
    try:
        return load_wiring(choice.wiring)
    except WiringError as error:
        raise PlantError(error.message) from error
