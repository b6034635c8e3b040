"""Which structures a model may have, by the names that are typed."""

import pytest

from backend.identification.models import DEAD_TIME, MAX_LAGS, MAX_ORDER, find_structure
from backend.identification.records import StructureError


@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("first", 1),
        ("third", 3),
        ("lags2", 2),
        (f"lags{MAX_LAGS}", MAX_LAGS),
        ("order:1", 1),
        (f"order:{MAX_ORDER}", MAX_ORDER),
    ],
)
def test_a_name_says_the_order(name: str, order: int) -> None:
    plain, late = find_structure(name), find_structure(f"{name}{DEAD_TIME}")
    assert plain.order == late.order == order
    assert not plain.delayed
    assert late.delayed
    assert late.names == (*plain.names, "t_d")


@pytest.mark.parametrize("name", ["", "lags1", f"lags{MAX_LAGS + 1}", "order:0", f"order:{MAX_ORDER + 1}", "fourth"])
def test_what_does_not_exist_is_refused_with_what_does(name: str) -> None:
    with pytest.raises(StructureError, match=rf"lags2 .. lags{MAX_LAGS}, order:1 .. order:{MAX_ORDER}"):
        find_structure(name)
