"""``sinew wall``: a wall in the way of the simulated joint of the running service, put up and taken away in flight."""

from typing import Annotated, Any

import typer

from backend.cli.output import AsJson, angles, fail, out, print_json
from backend.cli.place import DataFolder, settings_with
from backend.cli.running_service import running_service
from backend.units import told, typed

app = typer.Typer(
    help="A wall in the simulated joint's way, at the running service.", no_args_is_help=True, rich_markup_mode=None
)


@app.command(context_settings={"ignore_unknown_options": True})  # -0.4 is an angle
def up(
    q_wall: Annotated[str, typer.Argument(help="Where it stands, in rad; 15deg is an angle.")],
    below: Annotated[bool, typer.Option("--below", help="It stands below that angle, not above it.")] = False,
    stiffness: Annotated[float, typer.Option(help="In N/m, at the joint pulley.")] = 20000.0,
    damping: Annotated[float, typer.Option(help="In s/m: its force grows by 1 + damping times the speed.")] = 1.0,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Put a wall up, or in the place of the one that stands."""
    side = "below" if below else "above"
    try:
        at = typed(q_wall, "rad")
    except ValueError:
        fail(f"angle of the wall: {q_wall!r} is no number; give one in rad, or in degrees as 15deg", status=2)
    wall = {"q_wall": at, "side": side, "k_wall": stiffness, "c_wall": damping}
    _order(wall, data, as_json=as_json)


@app.command()
def down(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Take the wall away."""
    _order(None, data, as_json=as_json)


def _order(wall: dict[str, Any] | None, data: Any, *, as_json: bool) -> None:
    from backend.schemas.state import WallOrder

    stands = running_service(settings_with(data=data)).ask("PUT", "/wall", {"wall": wall}, WallOrder).wall
    if as_json:
        print_json({"wall": stands and stands.model_dump(mode="json")})
    elif stands is None:
        out.print("no wall stands in the joint's way")
    else:
        out.print(f"a wall stands {stands.side} {told(stands.q_wall, 'rad', angles())}")
