"""``sinew serve``."""

from typing import TYPE_CHECKING, Annotated, Literal

import typer

from backend.cli.place import DataFolder, ParameterSet, settings_with

if TYPE_CHECKING:
    from backend.api.tokens import Tokens


def serve(
    plant: Annotated[Literal["simulator", "rig"] | None, typer.Option(help="What to control. [simulator]")] = None,
    params: ParameterSet = None,
    host: Annotated[str | None, typer.Option(help="Address to listen on. [127.0.0.1]")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on, 0 for any free one. [8000]")] = None,
    data: DataFolder = None,
) -> None:
    """Run the dashboard and the control loop until interrupted."""
    from backend.main import serve as run_service

    run_service(settings_with(plant=plant, params=params, host=host, port=port, data=data), _print_link)


def _print_link(address: str, tokens: "Tokens | None") -> None:
    if tokens is None:
        print(f"Sinew answers at {address} without sign-in", flush=True)
        return
    print(f"Sinew answers. Sign in: {address}/?token={tokens.operator}", flush=True)
    print(f"To watch only:          {address}/?token={tokens.viewer}", flush=True)
