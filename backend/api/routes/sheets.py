"""What the charts show, for print."""

from fastapi import APIRouter, Request, Response

from backend.api.auth import SignedIn
from backend.api.routes.runs import PDF, download
from backend.api.service import ServiceInUse
from backend.schemas.run import SheetToPrint
from backend.server.security import SHEETS

router = APIRouter(tags=["runs"])


@router.post(SHEETS, response_class=Response, responses={200: {"content": {PDF: {}}}})
async def print_sheet(request: Request, body: SheetToPrint, service: ServiceInUse, person: SignedIn) -> Response:
    """Return a sheet of charts as PDF at its size. Open to viewers: it moves and keeps nothing."""
    return download(await service.sheets.pdf(body.svg, person, request.is_disconnected), PDF, "sinew-charts.pdf")
