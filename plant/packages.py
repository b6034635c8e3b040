"""Plants that installed packages bring along: entry points of the group ``sinew.plants``."""

from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from typing import Any, cast

from plant.choice import NAME_MAX, PlantKind
from plant.interface import Plant, PlantError
from plant.parameters import PlantParameters

GROUP = "sinew.plants"

Maker = Callable[[PlantParameters, int], Plant]
"""What an entry point names: (parameters, seed) -> a plant that is not yet open."""

ATTRIBUTES: tuple[str, ...] = (
    *Plant.__annotations__,
    *(name for name, member in vars(Plant).items() if isinstance(member, property)),
)
METHODS: tuple[str, ...] = tuple(name for name, member in vars(Plant).items() if callable(member) and name[0] != "_")
"""Parts of a Plant, as its protocol has them."""


def installed() -> dict[str, list[EntryPoint]]:
    """Return the plants of installed packages by their name; a name that two packages use has two."""
    found: dict[str, list[EntryPoint]] = {}
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value)):
        found.setdefault(entry.name, []).append(entry)
    return found


def load_maker(name: str) -> Maker:
    """Import what makes the plant called ``name``. Raises PlantError with what there is, or why it cannot be had."""
    there = installed()
    entries = there.get(name, [])
    if not entries or name in {str(kind) for kind in PlantKind}:
        others = f"and of installed packages {', '.join(there)}" if there else "no installed package brings another"
        raise PlantError(f"there is no plant {name}: there are simulator, rig and replay, {others}")
    if len(entries) > 1:
        packages = ", ".join(_package(entry) for entry in entries)
        raise PlantError(f"more than one package brings a plant {name}: {packages}; uninstall all but one")
    try:
        maker: Any = entries[0].load()
    except Exception as error:
        raise _failed(entries[0], "cannot be imported", error) from error
    if len(name) > NAME_MAX:
        short = f"{name[:20]}..."
        raise PlantError(f"the plant {short} has a name of {len(name)} characters, {NAME_MAX} are the most: shorten it")
    if not callable(maker):
        raise PlantError(f"{_of(entries[0])}: {entries[0].value} has to be callable, it is {_kind(maker)}")
    return cast(Maker, maker)


def plant_of_package(name: str, parameters: PlantParameters, seed: int) -> Plant:
    """Make the plant called ``name``. Raises PlantError, also for what is made but is no Plant."""
    maker = load_maker(name)
    (entry,) = installed()[name]
    try:
        made: Any = maker(parameters, seed)
    except PlantError:
        raise
    except Exception as error:
        raise _failed(entry, "cannot be made", error) from error
    lacking = lacks(made)
    if lacking:
        raise PlantError(f"{_of(entry)}: {entry.value} made {_kind(made)}, which is no Plant: it has no {lacking}")
    return cast(Plant, made)


def lacks(made: object) -> str:
    """Return which parts of a Plant ``made`` does not have, empty for a Plant."""
    missing = [name for name in ATTRIBUTES if not hasattr(made, name)]
    missing += [f"{name}()" for name in METHODS if not callable(getattr(made, name, None))]
    return ", ".join(missing)


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist is not None else entry.value


def _of(entry: EntryPoint) -> str:
    return f"plant {entry.name} of the package {_package(entry)}"


def _failed(entry: EntryPoint, what: str, error: Exception) -> PlantError:
    return PlantError(f"{_of(entry)} {what}: {type(error).__name__}: {' '.join(str(error).split())}")


def _kind(made: object) -> str:
    kind = type(made).__name__
    return "None" if made is None else f"{'an' if kind[0] in 'aeioAEIO' else 'a'} {kind}"
