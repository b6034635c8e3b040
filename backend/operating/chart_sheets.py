"""Sheets of charts that people send to be made PDFs of: in a process of their own, which reports do not wait for."""

from backend.auth.authentication import Person
from backend.departure import HasLeft, unless_left
from backend.operating.work_places import WorkPlaces
from backend.reports.sheet import sheet_pdf
from backend.workers import Offload

PLACES = 8
VIEWERS_PLACES = 6
PLACES_EACH = 2


class ChartSheets:
    """Belongs to the service's event loop; nothing is kept."""

    def __init__(self, offload: Offload) -> None:
        self._offload = offload
        self.places = WorkPlaces("a sheet of charts", "sheets of charts", PLACES, VIEWERS_PLACES, PLACES_EACH)

    async def pdf(self, svg: str, person: Person, has_left: HasLeft) -> bytes:
        """Return a sheet as PDF. Raises RefusalError for what is no sheet or finds no place, WorkLimitError."""
        with self.places.held(person):
            return await unless_left(self._offload.run(sheet_pdf, svg), has_left)
