"""Mutants of `make mutate`: one operator, constant or sign of a computation, and no text."""

import ast
import io
import tokenize
from collections import Counter
from pathlib import Path

from tests.mutate.__main__ import all_there, chosen, explained
from tests.mutate.belonging import belonging_to, live_tests, reaching, sources
from tests.mutate.mutants import mutants
from tests.mutate.trees import ROOT, Imports, Tree, tracked

DYNAMICS = "plant/dynamics.py"
TORQUE = """
import pathlib
import numba
from backend.control.pid import apply_dead_zone
from plant.dynamics import Friction, friction_torque

def test_torque():
    known = [path.name.split("-")[0] for path in pathlib.Path(numba.config.CACHE_DIR).glob("*/*.nbc")]
    torque = friction_torque(Friction(1.0, 0.5, 1e-9, None), 1.0, 4.0, 0.0)
    print(torque, apply_dead_zone(3.0, 1.0), known)
    assert torque == 3.0
"""
SOURCE = '''"""1 + 1"""
def f(λ: float = 2.0, *, n: "1" = 0) -> float:
    if not λ < -1e-3 or n in (
        3,
    ):
        raise ValueError(f"{n + 1} is more than 4", 5)
    n += 1  # 6
    return (λ * (n)) - 7
'''
CHANGES = [
    ("2.0", "3.0"), ("0", "1"), ("not", ""), ("<", ">"), ("-", ""), ("1e-3", "1.001"), ("or", "and"),
    ("in", "not in"), ("3", "4"), ("+=", "-="), ("1", "2"), ("*", "/"), ("-", "+"), ("7", "8"),
]  # fmt: skip


def words(text: str) -> list[str]:
    said = (tokenize.STRING, tokenize.COMMENT)
    return [token.string for token in tokenize.generate_tokens(io.StringIO(text).readline) if token.type in said]


def test_every_operator_constant_and_sign_of_a_computation_is_changed() -> None:
    assert [(mutant.old, mutant.new) for mutant in mutants("f.py", SOURCE)] == CHANGES
    assert [mutant.after for mutant in mutants("f.py", SOURCE)][-1] == "return (λ * (n)) - 8"


def test_a_mutant_differs_in_one_line_and_has_the_same_texts() -> None:
    for mutant in chosen(60, seed=2):
        text = (ROOT / mutant.path).read_text(encoding="utf-8")
        changed = mutant.of(text)
        assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(text)), mutant
        assert len([1 for a, b in zip(text.splitlines(), changed.splitlines(), strict=True) if a != b]) == 1, mutant
        assert words(changed) == words(text), mutant


def test_mutants_are_spread_over_the_packages_and_reproducible_by_seed() -> None:
    some = chosen(100, seed=1)
    assert some == chosen(100, seed=1) != chosen(100, seed=2)
    there = Counter(mutant.path for mutant in all_there())
    a_share_of_its_own = {path for path, mutants in there.items() if mutants >= there.total() / len(some)}
    assert a_share_of_its_own <= {mutant.path for mutant in some}
    assert {mutant.path.rpartition("/")[0] for mutant in some} == {path.rpartition("/")[0] for path in sources()}
    imports = Imports()
    assert imports.touched_by("plant/dynamics.py") > {"plant/dynamics.py", "backend/realtime/control_loop.py"}
    assert "plant/compilation.py" not in imports.touched_by("plant/dynamics.py")
    near = {path: belonging_to(path, reaching(imports.steps_to(path))) for path in {mutant.path for mutant in some}}
    assert [path for path, tests in near.items() if not tests] == []


def test_mutants_without_effect_are_not_generated() -> None:
    def made(text: str) -> list[tuple[str, str]]:
        return [(mutant.old, mutant.new) for mutant in mutants("f.py", text)]

    assert made("a < b") == [("<", ">")]  # two floats are never equal
    assert made("a < b.size") == made("a < len(b)") == [("<", "<="), ("<", ">")]
    assert made("a <= 3") == [("<=", "<"), ("<=", ">="), ("3", "4")]
    assert made("f(1e3, -20, 9)") == [("1e3", "2000.0"), ("-", ""), ("20", "40"), ("9", "10")]
    assert made("_LOG.info('%d', 1 + n)") == made("Specialised(f, 0.0, 1)") == []
    assert made("sqrt(1 + n)") == [("1", "2"), ("+", "-")]


def test_mutants_are_assigned_to_importing_tests_and_to_all_live_tests() -> None:
    away = reaching(Imports().steps_to("backend/identification/motor.py"))
    near = belonging_to("backend/identification/motor.py", away)
    assert "tests/identification/test_motor.py" in near
    further = set(away) - set(near)
    assert further
    assert not any(test.startswith("tests/identification/") for test in further)
    assert {"tests/api/test_operate.py", "tests/realtime/test_supervisor.py"} <= set(live_tests())
    assert not any("e2e" in test for test in live_tests())


def test_every_explained_mutant_has_a_reason() -> None:
    assert all((ROOT / path).is_file() and len(because.split()) > 5 for (path, _, _), because in explained().items())


def test_a_mutant_runs_in_a_copy_and_only_affected_code_is_recompiled(tmp_path: Path) -> None:
    base, tree = Tree(tmp_path / "base"), Tree(tmp_path / "tree")
    for copy in (base, tree):
        copy.bring_up_to_date(
            name
            for name in tracked()
            if name.startswith(("plant/", "backend/__", "backend/control/", "backend/errors", "backend/units"))
        )
        (copy.root / "test_torque.py").write_text(TORQUE, encoding="utf-8")
    asked, touched = ["-q", "test_torque.py"], {DYNAMICS}
    assert base.test(asked, 100.0)[0] == 0
    mutant = next(m for m in mutants(DYNAMICS, (ROOT / DYNAMICS).read_text("utf-8")) if m.old == "+")
    file = tree.root / DYNAMICS
    before = file.read_bytes(), file.stat().st_mtime_ns
    with tree.changed(mutant.path, mutant.of(file.read_text("utf-8"))):
        code, said = tree.test(asked, 100.0, base, touched)
    assert code == 1
    assert "\n-1.0 2.0 ['pid.apply_dead_zone']\n" in said
    assert (file.read_bytes(), file.stat().st_mtime_ns) == before
    assert tree.test(["-q", "-p", "no:timeout", "--collect-only", "test_torque.py"], 0.0)[0] is None
