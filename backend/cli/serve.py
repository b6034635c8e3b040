"""``sinew serve`` and ``sinew link``."""

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.garbage import look_as_usual
from backend.cli.output import fail
from backend.cli.place import (
    CardAddress,
    DataFolder,
    ParameterSet,
    PlantName,
    Recording,
    StationName,
    VirtualCard,
    WiringFile,
    settings_with,
)

if TYPE_CHECKING:
    from backend.access.tokens import Tokens


def serve(
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    recording: Recording = None,
    params: ParameterSet = None,
    host: Annotated[str | None, typer.Option(help="Address to listen on. [127.0.0.1]")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on, 0 for any free one. [8000]")] = None,
    data: DataFolder = None,
    station: StationName = None,
    show_link: Annotated[
        bool | None,
        typer.Option("--show-link/--hide-link", help="Print the sign-in link. [on a terminal only: logs are kept]"),
    ] = None,
) -> None:
    """Run the dashboard and the control loop until interrupted."""
    from backend.main import serve as run_service
    from plant.catalog import require_available

    settings = settings_with(
        plant=plant,
        virtual_card=virtual_card,
        wiring=wiring,
        card_address=card_address,
        recording=recording,
        params=params,
        host=host,
        port=port,
        data=data,
        station=station,
        show_link=show_link,
    )
    require_available(settings.plant_choice)
    shown = sys.stdout.isatty() if settings.show_link is None else settings.show_link

    def tell(address: str, tokens: "Tokens | None") -> None:
        if tokens is not None and not shown:
            print(f"Sinew answers at {address}. The sign-in link: sinew link --data {settings.data}", flush=True)
        else:
            _print_links(address, tokens)

    look_as_usual()
    run_service(settings, tell)


def link(data: DataFolder = None) -> None:
    """Print the sign-in links of the service that works on the data folder; exit 1 when there is none."""
    from backend.access.tokens import load_tokens
    from backend.data_folder import address_of_service

    settings = settings_with(data=data)
    address = address_of_service(settings.data)
    if address is None:
        fail(f"no service works on the folder {settings.data}: start it with `sinew serve`, or choose --data")
    _print_links(address, load_tokens(settings.data) if settings.require_token else None)


def _print_links(address: str, tokens: "Tokens | None") -> None:
    if tokens is None:
        print(f"Sinew answers at {address} without sign-in", flush=True)
        return
    print(f"Sinew answers. Sign in: {address}/?token={tokens.operator}", flush=True)
    print(f"To watch only:          {address}/?token={tokens.viewer}", flush=True)
