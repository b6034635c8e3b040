"""Two names that people take for one are not both kept: letters of either case, wide letters, spaces."""

import pytest

from backend.errors import RequestRejectedError
from backend.storage import banks, experiments
from backend.storage.banks import BankEntry
from backend.storage.database import Database

MODEL = {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342}


@pytest.mark.parametrize("alike", ["brief", "BRIEF", "\uff22rief", "Brief\u00a0"])
def test_an_experiment_or_bank_whose_name_reads_like_another_is_refused(database: Database, alike: str) -> None:
    def add_both(name: str) -> None:
        with database.session() as session:
            experiments.add(session, name, "text", "Ana")
        with database.session() as session:
            banks.add(session, name, [BankEntry(10.55, MODEL)], "Ana")

    add_both("Brief")
    for add in (
        lambda session: experiments.add(session, alike, "other", "Ana"),
        lambda session: banks.add(session, alike, [BankEntry(10.55, MODEL)], "Ana"),
    ):
        with pytest.raises(RequestRejectedError, match="'Brief' already") as refused, database.session() as session:
            add(session)
        assert refused.value.code == "name_taken"
    add_both("Briefly")
    with database.session() as session:
        assert experiments.add(session, "Brief", "other", "Ana").version == 2
        assert banks.add(session, "Brief", [BankEntry(10.55, MODEL)], "Ana").version == 2
        assert (
            banks.add(session, alike, [BankEntry(10.55, MODEL)], "Ana", number=77).version == 1
        )  # a copy for a dry run
    with database.reading() as session:
        assert {one.name for one in experiments.newest(session)} == {"Brief", "Briefly"}
