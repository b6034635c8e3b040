"""What the service can be told from outside: environment (``SINEW_...``) and command line."""

import ipaddress
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict


class Settings(BaseSettings):
    """Settings of one service process.

    ``database_url`` defaults to SQLite in the data folder. ``allowed_hosts`` are further names the dashboard may be
    reached by (the Host header is checked against DNS rebinding). ``require_token`` off makes everyone an operator
    and is refused on any address but a loopback one. Flight records beyond ``flight_records`` or ``flight_records_MB``
    give way to new ones. Recordings beyond ``recordings_GB`` may go once they are older than ``recordings_keep_days``,
    which is for a person to decide.
    """

    model_config = SettingsConfigDict(env_prefix="SINEW_", extra="ignore", frozen=True)

    data: Path = Path("data")
    plant: Literal["simulator", "rig"] = "simulator"
    params: str = "lab"
    host: str = "127.0.0.1"
    port: int = Field(default=8000, ge=0, le=65535)
    database_url: str | None = None
    require_token: bool = True
    allowed_hosts: tuple[str, ...] = ()
    flight_records: int = Field(default=300, ge=1, le=100_000)
    flight_records_MB: int = Field(default=100, ge=1, le=100_000)
    recordings_GB: float = Field(default=20.0, gt=0.0, le=100_000.0)
    recordings_keep_days: int = Field(default=30, ge=0, le=36_500)

    @model_validator(mode="after")
    def _no_open_door(self) -> "Settings":
        if not self.require_token and not is_loopback(self.host):
            raise ValueError(
                f"host {self.host} is reachable from other machines and needs the token: "
                "leave require_token on, or bind to 127.0.0.1"
            )
        return self

    @property
    def database(self) -> str:
        """SQLAlchemy URL of the database."""
        return self.database_url or f"sqlite:///{self.data.resolve() / 'sinew.db'}"


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach ``host``."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
