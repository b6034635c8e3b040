"""``sinew touch``: what the running service's estimate of the outside force has learned, and to learn it."""

import time
from typing import TYPE_CHECKING, Any

import typer

from backend.cli.output import AsJson, fail, out, print_json
from backend.cli.place import DataFolder, settings_with
from backend.cli.running_service import RunningService, running_service

if TYPE_CHECKING:  # schemas take a tenth of a second, which no other command shall wait for
    from backend.schemas.state import TouchView

app = typer.Typer(
    help="The outside force at the running service: what it reads with nothing outside.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
_LOOK_S = 0.5


@app.command()
def show(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Print what was learned and from what force on the joint gives way."""
    from backend.schemas.state import State

    _tell(_service(data).ask("GET", "/state", None, State).touch, as_json=as_json)


@app.command()
def learn(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Learn at the stiffness that is held now, in run, with nobody at the joint."""
    _tell(_order(_service(data), {"learn": True}), as_json=as_json)


@app.command()
def sweep(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Learn over all of the stiffness, point by point, in run, with nobody at the joint; Ctrl+C stops it."""
    service = _service(data)
    touch = _order(service, {"sweep": "begin"})
    told = 0
    try:
        while (at := touch.sweep) is not None and at.under_way:
            if at.point != told and not as_json:
                out.print(f"{at.point} of {at.points}: {at.S_ref:.4g} N·m/rad")
            told = at.point
            time.sleep(_LOOK_S)
            touch = _order(service, {})  # a script that commands nothing for long holds control no longer
    except KeyboardInterrupt:
        _order(service, {"sweep": "stop"})
        raise
    _tell(touch, as_json=as_json)
    if at is not None and at.why:
        fail(f"learning over S ended at {at.point} of {at.points}: {at.why}")


@app.command()
def forget(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Forget what was learned."""
    _tell(_order(_service(data), {"forget": True}), as_json=as_json)


def _service(data: Any) -> RunningService:
    return running_service(settings_with(data=data))


def _order(service: RunningService, order: dict[str, Any]) -> "TouchView":
    from backend.schemas.state import TouchView

    return service.ask("PUT", "/touch", order, TouchView)


def _tell(touch: "TouchView", *, as_json: bool) -> None:
    if as_json:
        print_json(touch.model_dump(mode="json"))
        return
    for point in touch.learned:
        out.print(f"{point.S:.2f} N·m/rad reads {point.F:.2f} ± {point.std_N:.2f} N with nothing outside")
    if not touch.learned:
        out.print("nothing is learned")
    armed = touch.contact_N
    out.print(f"the joint gives way to contacts from {armed:g} N on" if armed else "the joint gives way to no contact")
