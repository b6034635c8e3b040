"""Which module defines what a package lists: imports as they are read, and as they are followed."""

import ast
from functools import cache
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]


@cache
def listed(package: str) -> dict[str, str]:
    """Return the full name of the module behind each public name of a package; of a module its own."""
    stub = ROOT.joinpath(*package.split("."), "__init__.pyi")
    if not stub.is_file():
        return {}
    return {
        alias.name: f"{package}.{statement.module or alias.name}"
        for statement in ast.parse(stub.read_text(encoding="utf-8")).body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }


@cache
def imported(file: Path) -> frozenset[str]:
    """Return the modules that a file imports, those of public names behind their package, and names in modules."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
            for alias in node.names:
                found.add(listed(node.module).get(alias.name, f"{node.module}.{alias.name}"))
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return frozenset(found)


def module_graph() -> grimp.ImportGraph:
    """Return who imports whom in the product, with the modules behind the public names of packages."""
    graph = grimp.build_graph("plant", "backend", cache_dir=None)
    follow_names(graph)
    return graph


def follow_names(graph: grimp.ImportGraph) -> None:
    """Add to a graph the imports of the modules behind the public names of packages."""
    for module in sorted(name for name in graph.modules if not graph.is_module_squashed(name)):
        path = ROOT.joinpath(*module.split("."))
        file = path / "__init__.py" if (path / "__init__.py").is_file() else path.with_suffix(".py")
        for name in imported(file) & graph.modules:
            if name != module:
                graph.add_import(importer=module, imported=name)
