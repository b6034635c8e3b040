"""Contracts of import-linter about the public names of packages, which ``__init__.pyi`` lists."""

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output
from importlinter.contracts.forbidden import ForbiddenContract

from tests.imports import follow_names, listed


class PublicNamesContract(Contract):
    """Forbid an import of a module from outside its package, unless the package's stub lists the module.

    Options:
        packages: the packages, each with its public names in ``__init__.pyi``.
    """

    type_name = "public_names"

    packages = fields.ListField(subfield=fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        broken = [
            f"{importer} imports {module}: let {package} list what is public, and import that"
            for package in self.packages  # type: ignore[attr-defined]  # import-linter's own descriptors
            for module in sorted(graph.find_descendants(package) - public_modules(package))
            for importer in sorted(graph.find_modules_that_directly_import(module))
            if importer != package and not importer.startswith(f"{package}.")
        ]
        return ContractCheck(kept=not broken, metadata={"broken": broken})

    def render_broken_contract(self, check: ContractCheck) -> None:
        for line in check.metadata["broken"]:
            output.print_error(line)


class FollowedForbiddenContract(ForbiddenContract):
    """Forbid imports as ``forbidden`` does, those too that lie behind a public name of a package."""

    type_name = "followed_forbidden"

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        follow_names(graph)
        return super().check(graph, verbose)


def public_modules(package: str) -> set[str]:
    """Return the modules that a package lists as a whole."""
    return {module for name, module in listed(package).items() if module == f"{package}.{name}"}
