"""Messages: strings with the code and values of their catalogue entry, also across processes."""

import importlib
import inspect
import pickle
import pkgutil
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import backend
import plant
from plant import ErrorCode, Message, SinewError, catalogue_entry


@catalogue_entry
def too_far(*, name: str, distance: float) -> str:
    return f"{name} is {distance:.1f} m away"


class FarError(SinewError):
    category = ErrorCode.BAD_VALUE


def catalogues() -> Iterator[ModuleType]:
    for root in (plant, backend):
        for found in pkgutil.walk_packages(root.__path__, f"{root.__name__}."):
            if found.name.endswith("messages"):
                yield importlib.import_module(found.name)


def test_a_message_is_its_text_with_code_and_values() -> None:
    message = too_far(name="the wall", distance=2.04)
    assert message == "the wall is 2.0 m away"
    assert (message.code, message.values) == ("too_far", {"name": "the wall", "distance": 2.04})


def test_an_error_keeps_its_message_between_processes() -> None:
    error = pickle.loads(pickle.dumps(FarError(too_far(name="the wall", distance=2.04))))
    assert str(error) == "the wall is 2.0 m away"
    assert (error.message.code, error.message.values["distance"]) == ("too_far", 2.04)


def test_a_text_without_a_catalogue_entry_has_no_code() -> None:
    assert (FarError("far").message, FarError("far").message.code, FarError().message) == ("far", "", "")
    assert Message("far").values == {}


def test_each_catalogue_entry_takes_keywords_and_is_used() -> None:
    found = list(catalogues())
    assert "backend.banks.messages" in {module.__name__ for module in found}
    for module in found:
        package = importlib.import_module(module.__name__.rpartition(".")[0])
        sources = "".join(
            path.read_text(encoding="utf-8") for folder in package.__path__ for path in Path(folder).rglob("*.py")
        )
        entries = [item for item in vars(module).values() if inspect.isfunction(item) and hasattr(item, "__wrapped__")]
        assert entries
        for entry in entries:
            kinds = {item.kind for item in inspect.signature(entry).parameters.values()}
            assert kinds <= {inspect.Parameter.KEYWORD_ONLY}, entry
            assert f"messages.{entry.__name__}(" in sources, entry
