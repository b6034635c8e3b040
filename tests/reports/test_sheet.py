"""A sheet of charts as PDF: stated size, text and vector graphics; invalid sheets are rejected."""

import io
from typing import Any

import pytest
from pypdf import PdfReader

from backend.errors import RequestRejectedError
from backend.reports.sheet import (
    DEEPEST,
    LONGEST_MM,
    MOST_ELEMENTS,
    MOST_LETTERS,
    MOST_LETTERS_OF_A_TEXT,
    MOST_OF_A_PATH,
    MOST_OF_A_TITLE,
    MOST_TEXTS,
    read_sheet,
    render_sheet_pdf,
)
from backend.schemas.run import LONGEST_SHEET
from tests.reasons import Reason

MM_PER_POINT = 25.4 / 72.0
WIDTH_MM, HEIGHT_MM = 180.0, 123.46
FOOT = "run 12 · SIM (simulator) · λ_q 0.5 s · λ_S 0.8 s · geometric gains"
SPAN = "0:00.000 to 0:12.500 since the start · saved 1 March 2026"
TICKS = ("−20", "−10", "0", "10", "0:05")
HEADING = "Joint position [°]"
LINE = "q − q_ref′  −0.123 … 4.567"
HATS = "F̂_ext & q̂ < θ_A"


def svg(inside: str = "", root: str = f'width="{WIDTH_MM}mm" height="{HEIGHT_MM}mm"', before: str = "") -> str:
    box = 'viewBox="0 0 900 617.3"' if "viewBox" not in root else ""
    return f'{before}<svg xmlns="http://www.w3.org/2000/svg" {root} {box} font-size="13">{inside}</svg>\n'


def escaped(words: str) -> str:
    return words.replace("&", "&amp;").replace("<", "&lt;")


def drawing() -> str:
    """Return a sheet in the form of the page, with embedded data."""
    letters = [f'<text x="70" y="20" fill="#1b1f24" font-weight="600">{HEADING}</text>']
    for row, words in enumerate((*TICKS, LINE, HATS, FOOT, SPAN)):
        more = f'xml:space="preserve" data-role="foot" text-anchor="{("start", "middle", "end")[row % 3]}"'
        letters.append(f'<text x="450" y="{40 + 15 * row}" fill="#59616b" {more}>{escaped(words)}</text>')
    curve = '<path data-curve="q" data-x="0 1" d="M70 26L700.5 120.25M710 30h20v-4.5" fill="none" stroke="#0072B2" '
    dashed = 'stroke-width="1.4" stroke-linejoin="round" stroke-dasharray="6,4"/>'
    page = f'<title>{FOOT}</title><rect width="900" height="617.3" fill="#ffffff"/>'
    return svg(f'{page}<g data-panel="Joint">{curve}{dashed}<title>a mark</title></g>{"".join(letters)}')


@pytest.fixture(scope="module")
def printed() -> PdfReader:
    return PdfReader(io.BytesIO(render_sheet_pdf(drawing())))


def test_the_pdf_page_has_the_size_and_title_of_the_sheet(printed: PdfReader) -> None:
    (page,) = printed.pages
    size = [float(side) * MM_PER_POINT for side in (page.mediabox.width, page.mediabox.height)]
    assert size == pytest.approx([WIDTH_MM, HEIGHT_MM], abs=0.1)
    assert printed.metadata is not None
    assert printed.metadata.title == FOOT


def test_the_text_of_the_sheet_uses_embedded_fonts(printed: PdfReader) -> None:
    (page,) = printed.pages
    text = page.extract_text()
    for words in (HEADING, *TICKS, FOOT, SPAN, "q − q_ref′", "−0.123 … 4.567", "& ", "< θ_A"):
        assert words in text, words
    resources: Any = page["/Resources"]
    fonts = resources["/Font"]
    for font in fonts.values():
        (below,) = font.get_object()["/DescendantFonts"]
        described = below.get_object()["/FontDescriptor"]
        assert {"/FontFile2", "/FontFile3"} & set(described)
    assert any("Libertinus" in str(font.get_object()["/BaseFont"]) for font in fonts.values())


def test_the_sheet_contains_vector_graphics_only(printed: PdfReader) -> None:
    (page,) = printed.pages
    kinds = []

    def gather(resources: Any) -> None:
        for one in resources.get("/XObject", {}).values():
            drawn = one.get_object()
            kinds.append(drawn["/Subtype"])
            if "/Resources" in drawn:
                gather(drawn["/Resources"])

    gather(page["/Resources"])
    assert "/Image" not in kinds
    contents = page.get_contents()
    assert contents is not None
    assert b"BI " not in contents.get_data()


def test_the_sheet_is_rewritten_without_elements_that_are_not_drawn() -> None:
    sheet = read_sheet(drawing())
    assert (sheet.width_mm, sheet.height_mm, sheet.title) == (WIDTH_MM, HEIGHT_MM, FOOT)
    assert "data-" not in sheet.svg
    assert "<title" not in sheet.svg
    assert sheet.svg.count("<path") == 1
    assert escaped(HATS) in sheet.svg


BOMB = f'<!DOCTYPE svg [<!ENTITY a "ha"><!ENTITY b "{"&a;" * 1000}"><!ENTITY c "{"&b;" * 1000}">]>'
FILE = '<!DOCTYPE svg [<!ENTITY a SYSTEM "file:///etc/passwd">]>'
LINK = 'xmlns:xlink="http://www.w3.org/1999/xlink"'


@pytest.mark.parametrize(
    ("hostile", "reason"),
    [
        (svg("<text>&c;</text>", before=BOMB), Reason("document_type_not_allowed")),
        (svg("<text>&a;</text>", before=FILE), Reason("document_type_not_allowed")),
        (svg("<script>alert(1)</script>"), Reason("element_not_allowed", element="script")),
        (
            svg('<rect onload="alert(1)"/>'),
            Reason("attribute_not_allowed", element="rect", attribute="onload", value="alert(1)"),
        ),
        (svg('<image href="http://elsewhere.example/a.png"/>'), Reason("element_not_allowed", element="image")),
        (
            svg(f'<a {LINK} xlink:href="http://elsewhere.example"><rect/></a>'),
            Reason("element_not_allowed", element="a"),
        ),
        (svg('<use href="#a"/>'), Reason("element_not_allowed", element="use")),
        (svg("<foreignObject/>"), Reason("element_not_allowed", element="foreignObject")),
        (svg("<style>@import url(http://elsewhere.example)</style>"), Reason("element_not_allowed", element="style")),
        (
            svg('<rect style="fill: url(http://elsewhere.example/#a)"/>'),
            Reason("attribute_not_allowed", element="rect", attribute="style"),
        ),
        (
            svg('<rect fill="url(#a)"/>'),
            Reason("attribute_not_allowed", element="rect", attribute="fill", value="url(#a)"),
        ),
        (svg('<path d="M0 0L1e309 0"/>'), Reason("attribute_not_allowed", element="path", attribute="d")),
        (
            svg('<path d="M0 0" stroke-dasharray="0.0001"/>'),
            Reason("attribute_not_allowed", element="path", attribute="stroke-dasharray"),
        ),
        # digits of other scripts
        (svg('<path d="M0 0L\u0661 \u0967"/>'), Reason("attribute_not_allowed", element="path", attribute="d")),
        (svg('<rect x="\u0664"/>'), Reason("attribute_not_allowed", element="rect", attribute="x")),
        (
            svg('<path d="M0 0" stroke-dasharray="4\uff10"/>'),
            Reason("attribute_not_allowed", element="path", attribute="stroke-dasharray"),
        ),
        (
            svg(root='width="18\u0660mm" height="90mm"'),
            Reason("attribute_not_allowed", element="svg", attribute="width"),
        ),
        (svg('<s:svg xmlns:s="http://www.w3.org/2000/svg"/>'), Reason("element_not_allowed", element="s:svg")),
        (
            svg(before='<?xml-stylesheet href="http://elsewhere.example"?>'),
            Reason("instruction_not_allowed", instruction="xml-stylesheet"),
        ),
        (svg("<text>unclosed"), Reason("not_well_formed", problem="mismatched tag", line=1)),
        (svg("<text>&nothing;</text>"), Reason("not_well_formed", problem="undefined entity", line=1)),
        ("", Reason("not_well_formed", problem="no element found", line=1)),
        ("{}", Reason("not_well_formed", problem="not well-formed (invalid token)", line=1)),
        ("<html/>", Reason("root_is_not_svg", element="html")),
        ('<svg width="1mm"/>', Reason("svg_without_attribute", attribute="xmlns")),
        (
            svg(root='width="180" height="90mm"'),
            Reason("attribute_not_allowed", element="svg", attribute="width", value="180"),
        ),
        (
            svg(root='width="1mm" height="90mm"'),
            Reason("side_out_of_range", side="width", length_mm=1.0, minimum_mm=10.0, maximum_mm=LONGEST_MM),
        ),
        (
            svg(root='width="180mm" height="6000mm"'),
            Reason("side_out_of_range", side="height", length_mm=6000.0, minimum_mm=10.0, maximum_mm=LONGEST_MM),
        ),
        (svg(f"<{'x' * 5000}/>"), Reason("element_not_allowed", element=f"{'x' * 40}…")),
    ],
)
def test_an_invalid_sheet_is_rejected_with_reason_and_remedy(hostile: str, reason: Reason) -> None:
    with pytest.raises(RequestRejectedError) as caught:
        read_sheet(hostile)
    message = caught.value.message
    assert (message.code, message.values["reason"]) == ("not_a_sheet", reason), message
    assert len(message) < 400


def texts(number: int, letters: int) -> str:
    return f'<text x="9" y="9">{"ab c" * (letters // 4)}{"d" * (letters % 4)}</text>' * number


def path_of_length(characters: int) -> str:
    """Return a path whose ``d`` has this number of characters."""
    points = "h1v1" * (characters // 4 - 1)
    return f'<path d="{"M0 0" + points}{"0" * (characters % 4)}" fill="none" stroke="#0072B2"/>'


def at_the_bounds() -> str:
    """Return a sheet with the maximum of all quantities within the length of a request."""
    longest = MOST_LETTERS // MOST_LETTERS_OF_A_TEXT - 10
    short = MOST_TEXTS - longest
    letters = texts(longest, MOST_LETTERS_OF_A_TEXT) + texts(short, 1)
    paths = path_of_length(MOST_OF_A_PATH) * 2
    drawn = 1 + 1 + MOST_TEXTS + 2  # svg, title, texts and paths
    rects = '<rect width="1" height="2"/>' * (MOST_ELEMENTS - drawn)
    return svg(f"<title>{'a' * MOST_OF_A_TITLE}</title>{letters}{paths}{rects}")


def test_a_sheet_at_all_bounds_is_drawn() -> None:
    sheet = at_the_bounds()
    assert len(sheet) < LONGEST_SHEET
    (page,) = PdfReader(io.BytesIO(render_sheet_pdf(sheet))).pages
    assert float(page.mediabox.width) * MM_PER_POINT == pytest.approx(WIDTH_MM, abs=0.1)


@pytest.mark.parametrize(
    ("inside", "quantity", "most"),
    [
        ("<g>" * DEEPEST + "</g>" * DEEPEST, "nested elements", DEEPEST),
        ("<g/>" * MOST_ELEMENTS, "elements", MOST_ELEMENTS),
        (texts(MOST_TEXTS + 1, 1), "texts", MOST_TEXTS),
        (texts(1, MOST_LETTERS_OF_A_TEXT + 1), "characters of a text", MOST_LETTERS_OF_A_TEXT),
        (f"<text>{'a' * 400}{texts(1, 50)}{'a' * 51}</text>", "characters of a text", MOST_LETTERS_OF_A_TEXT),
        (texts(MOST_LETTERS // 400 + 1, 400), "characters of all texts", MOST_LETTERS),
        (path_of_length(MOST_OF_A_PATH + 1), "characters of a path", MOST_OF_A_PATH),
        (f"<title>{'a' * (MOST_OF_A_TITLE + 1)}</title>", "characters of the title", MOST_OF_A_TITLE),
    ],
)
def test_a_sheet_beyond_the_bounds_is_rejected_before_drawing(inside: str, quantity: str, most: int) -> None:
    with pytest.raises(RequestRejectedError) as caught:
        read_sheet(svg(inside))
    assert caught.value.code == "sheet_too_large"
    assert caught.value.message == Reason("sheet_too_large", quantity=quantity, maximum=most)
