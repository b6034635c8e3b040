"""Settings of the service: environment variables (``SINEW_...``) and command line."""

import ipaddress
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field, ValidationError, model_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from backend import messages
from backend.errors import check_station_name
from backend.logs import Level
from backend.public_url import LOOPBACK, PublicUrl, parse_networks, parse_public_url
from plant import DEFAULT_WIRING, ErrorCode, PlantChoice, PlantKind, SinewError

_PREFIX = "SINEW_"
_HOST_NAME = re.compile(r"[\w.-]{1,253}", re.ASCII)


class UnusableSettingError(SinewError):
    """An environment variable with a rejected value; the message names it."""

    category = ErrorCode.BAD_VALUE


def _split_list(given: object) -> object:
    """Split a text at commas, or parse it as a JSON list; other types stay unchanged."""
    if not isinstance(given, str):
        return given
    try:
        texts = json.loads(given) if given.lstrip().startswith("[") else given.split(",")
    except ValueError:
        texts = [given]
    return [text.strip() if isinstance(text, str) else str(text) for text in texts]


def _check_host_names(given: tuple[str, ...]) -> tuple[str, ...]:
    for name in given:
        if not _HOST_NAME.fullmatch(name) or name.isdigit():
            raise ValueError(f"{name!r} is not a host name: use names such as rig.lab, without http:// or a port")
    return given


def _normalize_public_url(given: str | None) -> str | None:
    """Return the normal form of the address. Raises ValueError."""
    return None if given is None else f"{parse_public_url(given)}/"


def _check_networks(given: tuple[str, ...]) -> tuple[str, ...]:
    parse_networks(given)
    return given


def _expand_home(path: Path) -> Path:
    """Return a path with ~ replaced, as a shell does it on the command line."""
    try:
        return path.expanduser()
    except RuntimeError:
        raise ValueError(f"{path} begins with ~, and this account has no home folder: give the full path") from None


class Settings(BaseSettings):
    """Settings of one service process."""

    model_config = SettingsConfigDict(env_prefix=_PREFIX, env_ignore_empty=True, extra="ignore", frozen=True)

    data: Annotated[Path, AfterValidator(_expand_home)] = Path("data")

    plant: str = "simulator"
    """``simulator``, ``rig``, ``replay`` or the name of a plant from an installed package."""

    virtual_card: bool = False
    """Whether a simulated card replaces the card of the rig."""

    wiring: str = DEFAULT_WIRING
    """Wiring file of the rig: the name of a shipped one, or a path."""

    card_address: str = ""
    """Address of the card on NI's device server; empty for a local card."""

    recording: Path | None = None
    """Recording that plant ``replay`` plays."""

    params: str = "lab"
    host: str = "127.0.0.1"
    port: int = Field(default=8000, ge=0, le=65535)

    database_url: str | None = Field(default=None, repr=False)
    """None selects SQLite in the data folder."""

    database_password_file: Path | None = None
    """File with the password, so that no environment variable shows it."""

    station: str = ""
    """Name of this rig among several on one database."""

    require_token: bool = True
    """False makes everyone an operator: rejected beyond loopback addresses, and with a public URL."""

    allowed_hosts: Annotated[
        tuple[str, ...], NoDecode, BeforeValidator(_split_list), AfterValidator(_check_host_names)
    ] = ()
    """Further names of the dashboard, for the check of the Host header against DNS rebinding."""

    public_url: Annotated[str | None, AfterValidator(_normalize_public_url)] = None
    """Address at which browsers reach the service through a reverse proxy."""

    trusted_proxies: Annotated[
        tuple[str, ...], NoDecode, BeforeValidator(_split_list), AfterValidator(_check_networks)
    ] = ()
    """Proxies whose X-Forwarded-For is used, as addresses or networks; with a public URL, this machine by default."""

    show_link: bool | None = None
    """Whether to print the sign-in link at the start; None: only on a terminal, because others may read a log."""

    flight_records: int = Field(default=300, ge=1, le=100_000)
    """Number of flight records that are stored; the oldest are deleted. Trigger captures have the same limit."""

    flight_records_MB: int = Field(default=100, ge=1, le=100_000)
    """Size of the stored flight records [MB], and of the trigger captures."""

    recordings_GB: float = Field(default=20.0, gt=0.0, le=100_000.0)
    """Size [GB] beyond which a person may delete recordings."""

    recordings_keep_days: int = Field(default=30, ge=0, le=36_500)
    """Age [days] from which recordings may be deleted."""

    log_level: Level = "warning"
    """Minimum level of the log on standard error; start, stop, connections, modes and runs have level info."""

    @model_validator(mode="after")
    def _require_token_beyond_loopback(self) -> "Settings":
        if not self.require_token and not is_loopback(self.host):
            raise ValueError(
                f"host {self.host} is reachable from other machines and needs the token: "
                "leave require_token on, or bind to 127.0.0.1"
            )
        return self

    @model_validator(mode="after")
    def _require_token_behind_proxy(self) -> "Settings":
        if not self.require_token and self.public_url is not None:
            raise ValueError(
                f"{self.public_url} is reachable from other machines and needs the token: leave require_token on"
            )
        return self

    @model_validator(mode="after")
    def _check_station(self) -> "Settings":
        check_station_name(self.station)
        return self

    @model_validator(mode="after")
    def _check_plant(self) -> "Settings":
        rig = self.plant == PlantKind.RIG
        for given, name in ((self.virtual_card, "virtual_card"), (self.card_address, "card_address")):
            if given and not rig:
                raise ValueError(f"{name} applies only to a rig: set plant to rig as well")
        if self.virtual_card and self.card_address:
            raise ValueError("a virtual card has no address: set either virtual_card or card_address")
        if (self.plant == PlantKind.REPLAY) != (self.recording is not None):
            raise ValueError("plant replay and recording require each other: set both")
        return self

    @model_validator(mode="after")
    def _check_proxies(self) -> "Settings":
        if self.trusted_proxies and self.public_url is None:
            raise ValueError("trusted_proxies requires a public URL: set public_url too, or omit trusted_proxies")
        return self

    @property
    def public(self) -> PublicUrl | None:
        """The address behind a proxy with its trusted proxies; None without a proxy."""
        if self.public_url is None:
            return None
        return replace(parse_public_url(self.public_url), proxies=parse_networks(self.trusted_proxies) or LOOPBACK)

    @property
    def plant_choice(self) -> PlantChoice:
        """The plant to control."""
        match self.plant:
            case PlantKind.SIMULATOR:
                return PlantChoice()
            case PlantKind.RIG:
                kind = PlantKind.VIRTUAL_CARD if self.virtual_card else PlantKind.RIG
                return PlantChoice(kind, wiring=self.wiring, address=self.card_address)
            case PlantKind.REPLAY:
                return PlantChoice(PlantKind.REPLAY, recording=str(self.recording))
            case package:
                return PlantChoice(PlantKind.PACKAGE, package=package)

    def database_password(self) -> str | None:
        """Read the password from ``database_password_file``; None without a file.

        Raises UnusableSettingError.
        """
        if self.database_password_file is None:
            return None
        variable, file = f"{_PREFIX}DATABASE_PASSWORD_FILE", self.database_password_file
        try:
            password = file.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise UnusableSettingError(
                messages.password_file_unreadable(variable=variable, file=file, reason=str(error))
            ) from None
        if not password:
            raise UnusableSettingError(messages.password_file_empty(variable=variable, file=file))
        return password


def load_environment_settings() -> Settings:
    """Return the settings of the environment. Raises UnusableSettingError."""
    try:
        return Settings()
    except ValidationError as error:
        details = error.errors(include_url=False)
        reasons = [_format_validation_error(detail["loc"], detail["input"], detail["msg"]) for detail in details]
        raise UnusableSettingError(messages.unusable_settings(reasons=reasons)) from None


def _format_validation_error(location: tuple[int | str, ...], given: object, message: str) -> str:
    reason = message.removeprefix("Value error, ")
    return f"{_PREFIX}{str(location[0]).upper()}={given}: {reason}" if location else reason


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach ``host``."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
