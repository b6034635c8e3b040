"""viser's page as the dashboard serves it."""

import re
from pathlib import Path

import pytest

from backend.scene.proxy import POLICY, page


def test_the_page_is_one_file_that_reconnects_without_the_focus() -> None:
    html = page()
    assert html.index("document.hasFocus = () => true") < html.index("</head>")
    assert 'src="http' not in html


@pytest.mark.parametrize("directive", ["default-src 'none'", "connect-src 'self'", "frame-ancestors 'self'"])
def test_the_page_may_load_nothing_from_elsewhere(directive: str) -> None:
    assert directive in POLICY
    assert "http" not in POLICY


def test_the_view_of_the_camera_stays_in_the_address() -> None:
    assert 'name.startsWith("initialCamera")' in page()


def test_the_stages_that_it_tells_are_those_that_the_dashboard_has_words_for() -> None:
    told = set(re.findall(r'tell\("(\w+)"\)', page()))
    source = (Path(__file__).parents[2] / "frontend" / "src" / "components" / "SceneFrame.tsx").read_text()
    (known,) = re.findall(r"const TOLD = \[(.*?)\]", source)
    assert told == set(re.findall(r"\w+", known))
