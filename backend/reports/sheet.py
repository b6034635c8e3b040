"""Sheets of charts as PDF."""

import re
from dataclasses import dataclass, field
from importlib import resources
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from backend.errors import RequestRejectedError
from backend.plain_text import escape_lines
from backend.reports import messages
from backend.reports.pdf import missing_letters, sentence, with_boxes
from plant import ErrorCode, Message

# Sheet ---------------------------------------------------------------------------------------------
# A sheet of charts drawn by the page, as PDF at its size; text stays text and lines stay lines.
#
# The received SVG is never passed on. A parser that accepts no document type reads it, so that no entity expands and
# nothing is fetched. The few elements that a sheet consists of are written anew with known attributes.
#
# The elements are counted before anything is drawn. The most expensive sheet that is accepted takes some seconds and
# runs in a process of its own (backend.services.background_work).


SVG = "http://www.w3.org/2000/svg"
SHORTEST_MM = 10.0
LONGEST_MM = 5000.0
"""Limit of a side [mm]: no reader shows a page of more than 5080 mm."""
MOST_ELEMENTS = 20_000
DEEPEST = 8
MOST_TEXTS = 4_000
MOST_LETTERS_OF_A_TEXT = 500
"""The time for a text grows with the square of its length."""
MOST_LETTERS = 40_000
MOST_OF_A_PATH = 512 * 1024
"""Characters of the data of one path: a curve of 4000 points takes about 40 000."""
MOST_OF_A_TITLE = 500

_NUMBER = r"-?[0-9]{1,6}(?:\.[0-9]{1,6})?"
_COLOUR = r"none|#[0-9A-Fa-f]{3,8}"
_PLAIN: dict[str, str] = {
    "x": _NUMBER,
    "y": _NUMBER,
    "width": _NUMBER,
    "height": _NUMBER,
    "font-size": _NUMBER,
    "stroke-width": _NUMBER,
    # shorter dashes would be too many to draw
    "stroke-dasharray": r"[1-9][0-9]{0,2}(?:[ ,][1-9][0-9]{0,2}){0,11}",
    "stroke-linejoin": "round",
    "fill": _COLOUR,
    "stroke": _COLOUR,
    "font-weight": "normal|bold|[1-9]00",
    "text-anchor": "start|middle|end",
    "xml:space": "preserve",
    "d": r"[MLHVZmlhvz0-9 ,.-]*",
}
"""Allowed values of the attributes that are drawn."""
_ROOT: dict[str, str] = {
    "xmlns": re.escape(SVG),
    "viewBox": rf"{_NUMBER}(?:[ ,]{_NUMBER}){{3}}",
    "width": rf"{_NUMBER}mm",
    "height": rf"{_NUMBER}mm",
    "font-size": _NUMBER,
}
_DRAWN = ("g", "rect", "path", "text")
_UNDRAWN = ("title",)
_IGNORED = re.compile(r"data-[a-z-]+|font-family")
"""Data for programs, and fonts: the fonts of reports are the same everywhere."""
_MAX_TEXT = 40


@dataclass(frozen=True)
class Sheet:
    """A sheet with its size [mm], as written anew."""

    svg: str
    width_mm: float
    height_mm: float
    title: str
    letters: str


def render_sheet_pdf(svg: str) -> bytes:
    """Return the sheet as PDF of one page of the size of the drawing.

    Raises RequestRejectedError if it is no valid sheet.
    """
    import typst  # slow to import

    sheet = read_sheet(svg)
    missing = missing_letters([sheet.letters, sheet.title])
    template = resources.files("backend.reports").joinpath("sheet.typ").read_bytes()
    sizes = {"width": f"{sheet.width_mm}", "height": f"{sheet.height_mm}"}
    pdf: bytes = typst.compile(
        template,
        font_paths=typst.Fonts(include_system_fonts=False),
        sys_inputs={
            "svg": with_boxes(sheet.svg, missing),
            "title": with_boxes(sheet.title, missing),
            "missing": sentence(missing, messages.sheet_as_svg_shows_text()),
            **sizes,
        },
    )
    return pdf


def read_sheet(svg: str) -> Sheet:
    """Read a received drawing.

    Raises RequestRejectedError, which names what is not allowed.
    """
    reading = _Reading()
    parser = expat.ParserCreate("utf-8")
    parser.StartDoctypeDeclHandler = _refuse_document_type
    parser.ProcessingInstructionHandler = _refuse_instruction
    parser.StartElementHandler = reading.begin
    parser.EndElementHandler = reading.end
    parser.CharacterDataHandler = reading.letters
    try:
        parser.Parse(svg.encode("utf-8", "replace"), True)
    except expat.ExpatError as error:
        raise _make_refusal(
            messages.not_well_formed(problem=expat.errors.messages[error.code], line=error.lineno)
        ) from None
    return reading.sheet()


@dataclass
class _Reading:
    """The state of the parser and the SVG written so far."""

    parts: list[str] = field(default_factory=list)
    titles: list[str] = field(default_factory=list)
    visible_texts: list[str] = field(default_factory=list)
    open: list[str] = field(default_factory=list)
    elements: int = 0
    texts: int = 0
    letters_in_all: int = 0
    letters_of_text: int = 0
    letters_of_title: int = 0
    width_mm: float = 0.0
    height_mm: float = 0.0

    def begin(self, name: str, attributes: dict[str, str]) -> None:
        self.elements += 1
        _require_few("elements", self.elements, MOST_ELEMENTS)
        _require_few("nested elements", len(self.open) + 1, DEEPEST)
        if not self.open and name != "svg":
            raise _make_refusal(messages.root_is_not_svg(element=_short(name)))
        if self.open and name not in (*_DRAWN, *_UNDRAWN):
            raise _make_refusal(messages.element_not_allowed(element=_short(name), allowed=(*_DRAWN, *_UNDRAWN)))
        if name == "text":
            self.texts += 1
            if "text" not in self.open:  # a child of a text is drawn as a part of it
                self.letters_of_text = 0
            _require_few("texts", self.texts, MOST_TEXTS)
        path_data = attributes.get("d", "")
        _require_few("characters of a path", len(path_data), MOST_OF_A_PATH)
        known = _PLAIN if self.open else _ROOT
        kept_attributes = {key: value for key, value in attributes.items() if not _IGNORED.fullmatch(key)}
        for key, value in kept_attributes.items():
            if key not in known or not re.fullmatch(known[key], value):
                raise _make_refusal(
                    messages.attribute_not_allowed(element=name, attribute=_short(key), value=_short(value))
                )
        if not self.open:
            self._measure(kept_attributes)
            kept_attributes["font-family"] = "Libertinus Serif"
        self.open.append(name)
        if name not in _UNDRAWN:
            self.parts.append(
                f"<{name}{''.join(f' {key}={quoteattr(value)}' for key, value in kept_attributes.items())}>"
            )

    def end(self, name: str) -> None:
        self.open.pop()
        if name not in _UNDRAWN:
            self.parts.append(f"</{name}>")

    def letters(self, letters: str) -> None:
        if self.open[-1] == "text":
            self.letters_of_text += len(letters)
            self.letters_in_all += len(letters)
            _require_few("characters of a text", self.letters_of_text, MOST_LETTERS_OF_A_TEXT)
            _require_few("characters of all texts", self.letters_in_all, MOST_LETTERS)
            visible_text = escape_lines(letters)
            self.parts.append(escape(visible_text))
            self.visible_texts.append(visible_text)
        elif self.open == ["svg", "title"]:
            self.letters_of_title += len(letters)
            _require_few("characters of the title", self.letters_of_title, MOST_OF_A_TITLE)
            self.titles.append(letters)

    def sheet(self) -> Sheet:
        return Sheet(
            "".join(self.parts), self.width_mm, self.height_mm, "".join(self.titles), "".join(self.visible_texts)
        )

    def _measure(self, attributes: dict[str, str]) -> None:
        missing = [key for key in ("xmlns", "width", "height", "viewBox") if key not in attributes]
        if missing:
            raise _make_refusal(messages.svg_without_attribute(attribute=missing[0]))
        self.width_mm, self.height_mm = (float(attributes[key].removesuffix("mm")) for key in ("width", "height"))
        for side, length in (("width", self.width_mm), ("height", self.height_mm)):
            if not SHORTEST_MM <= length <= LONGEST_MM:
                raise _make_refusal(
                    messages.side_out_of_range(
                        side=side, length_mm=length, minimum_mm=SHORTEST_MM, maximum_mm=LONGEST_MM
                    )
                )


def _refuse_document_type(*_declared: object) -> None:
    raise _make_refusal(messages.document_type_not_allowed())


def _refuse_instruction(target: str, _data: str) -> None:
    raise _make_refusal(messages.instruction_not_allowed(instruction=_short(target)))


def _require_few(quantity: messages.LimitedQuantity, number: int, most: int) -> None:
    """Raise RequestRejectedError if ``number``, the count so far, exceeds ``most``."""
    if number > most:
        raise RequestRejectedError(
            ErrorCode.BAD_VALUE,
            messages.sheet_too_large(quantity=quantity, number=number, maximum=most),
            code="sheet_too_large",
        )


def _make_refusal(reason: Message) -> RequestRejectedError:
    return RequestRejectedError(ErrorCode.BAD_VALUE, messages.not_a_sheet(reason=reason), code="not_a_sheet")


def _short(words: str) -> str:
    return words if len(words) <= _MAX_TEXT else f"{words[:_MAX_TEXT]}…"
