"""Generated forgeries of reports: changes of each manifest field, page element and drawing."""

import json
import re
from collections.abc import Iterator
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from backend.reports.evidence import (
    MANIFEST,
    EvidenceError,
    ReportManifest,
    compute_manifest_hash,
    find_element,
    read_manifest,
    to_element,
)
from backend.reports.signing import derive_public_key, sign_page

SIGNATURE = b'<template id="signature">'
Path = tuple[str | int, ...]
_TAG = re.compile(r"<[a-z][^<>]*>")
_TEXT = re.compile(r">([^<>\n]*\w[^<>\n]*)<")
INSERTED = (
    "<p>It passed.</p>",
    "<script>1</script>",
    '<div style="position:fixed;inset:0">passed</div>',
    "<!-- -->",
)
DRAWN = (
    '<svg style="position:fixed;inset:0"><foreignObject><p>passed</p></foreignObject></svg>',
    "<svg><script>1</script></svg>",
    '<svg><image xlink:href="https://example.org/a.png"/></svg>',
    '<svg><path d="M 0 0" onclick="1"/></svg>',
)


def of_the_manifest(page: str) -> Iterator[tuple[str, str]]:
    """Change each value of the manifest, with and without correction of its hash in manifest and page."""
    element = find_element(page)
    text = element[element.index(">") + 1 : element.rindex("<")]
    for path in _leaves(json.loads(text)):
        name = ".".join(map(str, path))
        account = json.loads(text)
        _change(account, path)
        plain = json.dumps(account, ensure_ascii=False, separators=(",", ":"))
        for letter in "<>&":
            plain = plain.replace(letter, f"\\u{ord(letter):04x}")
        changed = page.replace(text, plain)
        yield name, changed
        if (sealed := _sealed(page, changed)) not in (None, changed, page):
            yield f"{name}, sealed", str(sealed)


def of_the_page(page: str) -> Iterator[tuple[str, str]]:
    """Change each text and each tag outside drawings, and insert content between them."""
    element = find_element(page)
    begin = page.index("<body")
    drawings = [found.span() for found in re.finditer(r"<svg.*?</svg>", page, re.DOTALL)]
    carried = page.index(element), page.index(element) + len(element)

    def is_free(place: int) -> bool:
        return place > begin and not any(start <= place < end for start, end in (*drawings, carried))

    for found in _TEXT.finditer(page):
        if is_free(found.start(1)):
            yield f"text {found[1][:30]}", f"{page[: found.start(1)]}{found[1]}9{page[found.end(1) :]}"
    for number, found in enumerate(_TAG.finditer(page)):
        if is_free(found.start()):
            yield f"tag {found[0][:30]}", f"{page[: found.start()]}{found[0][:-1]} hidden>{page[found.end() :]}"
            more = INSERTED[number % len(INSERTED)]
            yield f"before {found[0][:30]}", f"{page[: found.start()]}{more}{page[found.start() :]}"


def of_the_drawings(page: str) -> Iterator[tuple[str, str]]:
    """Change parts of each drawing, replace it, and add drawings."""
    for found in re.finditer(r"<svg.*?</svg>", page, re.DOTALL):
        start, end = found.span()
        for other in DRAWN:
            yield f"another drawing {other[:30]}", f"{page[:start]}{other}{page[end:]}"
            yield f"a drawing more {other[:30]}", f"{page[:start]}{other}{page[start:]}"
            yield f"in a drawing {other[5:30]}", f"{page[: end - 6]}{other[5:-6]}{page[end - 6 :]}"
        numbers = list(re.finditer(r'(?<=[ "])\d+\.\d+', found[0]))
        for number in numbers[:: max(1, len(numbers) // 25)]:
            at = start + number.start()
            yield f"number {number[0]} of a drawing", f"{page[:at]}7{page[at:]}"


def with_versions(page: str) -> Iterator[tuple[str, str]]:
    """Change the versions in the manifest, correct its hash, and also change the page."""
    manifest = read_manifest(page)
    assert isinstance(manifest, ReportManifest)
    for name in manifest.made_with:
        said = {**manifest.made_with, name: "0.0.9"}
        for what, changed in (
            ("the page", page),
            ("a figure", page.replace("</td>", "9</td>", 1)),
            ("a drawing", page.replace("<svg", DRAWN[0] + "<svg", 1)),
        ):
            account = json.loads(find_element(page)[len('<template id="evidence">') : -len("</template>")])
            account["made_with"] = said
            text = json.dumps(account, ensure_ascii=False, separators=(",", ":"))
            for letter in "<>&":
                text = text.replace(letter, f"\\u{ord(letter):04x}")
            new = changed.replace(find_element(page), f'<template id="evidence">{text}</template>')
            yield f"{name} of another version, and {what}", _sealed(page, new) or new


def _leaves(value: Any, path: Path = ()) -> Iterator[Path]:
    if isinstance(value, dict) and value:
        for name, part in value.items():
            yield from _leaves(part, (*path, name))
    elif isinstance(value, list) and value:
        for place in sorted({0, len(value) // 2, len(value) - 1}):  # a list of checksums has thousands of characters
            yield from _leaves(value[place], (*path, place))
    else:
        yield path


def _change(account: Any, path: Path) -> None:
    for part in path[:-1]:
        account = account[part]
    value = account[path[-1]]
    match value:
        case bool():
            account[path[-1]] = not value
        case int() | float():
            account[path[-1]] = value + 1
        case str():
            account[path[-1]] = f"{value}9"
        case _:
            account[path[-1]] = "9"


def _sealed(page: str, changed: str) -> str | None:
    """Correct the hash of the manifest of a changed page; return None if the manifest is unreadable."""
    try:
        manifest = read_manifest(changed)
    except EvidenceError:
        return None
    assert isinstance(manifest, ReportManifest)
    before, after = manifest.hashes.get(MANIFEST, ""), compute_manifest_hash(manifest)
    manifest.hashes[MANIFEST] = after
    sealed = changed.replace(find_element(changed), to_element(manifest))
    return sealed.replace(before, after) if before else sealed


def of_the_signature(page: bytes, other: Ed25519PrivateKey) -> Iterator[tuple[str, bytes]]:
    """Change, move or duplicate the signature of a signed page, or sign the page with another key."""
    begin = page.index(SIGNATURE)
    end = page.index(b"</template>", begin) + len(b"</template>")
    element, unsigned = page[begin:end], page[:begin] + page[end:]
    text = element[len(SIGNATURE) : -len(b"</template>")].decode("ascii")
    said = json.loads(text)

    def written(document: Any, **how: Any) -> bytes:
        inside = json.dumps(document, **{"separators": (",", ":"), **how}).encode("ascii")
        return page[:begin] + SIGNATURE + inside + b"</template>" + page[end:]

    for name in said:
        yield f"another {name}", written({**said, name: said[name] + "0"})
        yield f"no {name}", written({one: value for one, value in said.items() if one != name})
        yield f"a number for {name}", written({**said, name: 7})
    yield "one field more", written({**said, "time": "2020-01-01"})
    yield "blanks", written(said, separators=(", ", ": "))
    yield "another order", written(dict(reversed(said.items())))
    yield "capitals", written({**said, "signature": said["signature"].upper()})
    yield "no object", written([said])
    yield "a field twice", page.replace(b'{"algorithm"', b'{"name":"x","algorithm"', 1)
    yield "nothing in it", page[:begin] + SIGNATURE + b"</template>" + page[end:]
    yield "no end", unsigned + SIGNATURE
    yield "two", page[:begin] + element + page[begin:]
    yield "two, far apart", page + element
    yield "in front of the account", page[: (at := page.index(b"<template"))] + element + page[at:begin] + page[end:]
    yield "at the end", unsigned + element
    yield "on a line of its own", page[:begin] + b"\n" + page[begin:]
    yield (
        "the public half of another key",
        page.replace(said["public_key"].encode(), derive_public_key(other).text.encode(), 1),
    )
    elsewhere = sign_page(unsigned.replace(b"</p>", b" </p>", 1), other, "")
    moved = elsewhere[elsewhere.index(SIGNATURE) :]
    moved = moved[: moved.index(b"</template>") + len(b"</template>")]
    yield "that of another page", page[:begin] + moved + page[end:]
    yield "no Unicode", page.replace(b"</h1>", b"\xff</h1>", 1)


def single_bytes(page: bytes, every: int) -> Iterator[tuple[str, bytes]]:
    """Change or omit single bytes of a signed page: all of its signature, and a sample of the rest."""
    begin = page.index(SIGNATURE)
    end = page.index(b"</template>", begin) + len(b"</template>")
    for at in (*range(begin, end), *range(0, len(page), every), len(page) - 1):
        yield f"byte {at}", page[:at] + bytes([page[at] ^ 1]) + page[at + 1 :]
    yield "without its last byte", page[:-1]
    yield "a byte more", page + b"\n"
    yield "a byte more in front", b"\n" + page
    yield "other line ends", page.replace(b"\n", b"\r\n")
