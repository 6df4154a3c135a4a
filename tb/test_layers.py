"""Who may import whom, and how long a function may be."""

import ast
from pathlib import PurePosixPath

import pytest

from scripts.paths import ROOT

#: What each part of the tree may import besides itself. Parts of ``scripts`` count on their own.
MAY_IMPORT = {
    "hdl": set(),
    "model": {"hdl.protocol"},
    "calibration": {"hdl.protocol", "model"},
    "scripts.paths": {"hdl"},  # where the package is
    "scripts.results": {"hdl", "model", "calibration", "scripts.paths"},
    "scripts.measure": {"model", "calibration", "scripts.results"},
    "scripts.host": {"hdl", "model", "calibration", "scripts.paths", "scripts.results"},
    "scripts.simulation": {
        "hdl", "model", "calibration", "scripts.paths", "scripts.results", "scripts.host"},
    "scripts.view": {
        "hdl.protocol", "model", "calibration", "scripts.results", "scripts.measure",
        "scripts.host"},
    "scripts.rtl": {"hdl", "model", "calibration", "scripts.paths"},
    "scripts.packaging": set(),
    "scripts.setup": set(),
    "scripts.cyclope": {
        "hdl", "model", "calibration", "scripts.paths", "scripts.results", "scripts.measure",
        "scripts.host", "scripts.view", "scripts.simulation", "scripts.rtl"},
    "scripts.demo": {
        "hdl", "model", "calibration", "scripts.paths", "scripts.results", "scripts.simulation",
        "scripts.cyclope"},
    "tb": {"hdl", "model", "calibration", "scripts"},
}
FIRST_PARTY = ("hdl", "model", "calibration", "scripts", "tb")
LONGEST = 150
FILES = sorted(path for part in FIRST_PARTY for path in (ROOT / part).rglob("*.py"))


def part_of(module):
    """The part of the tree that a module belongs to."""
    names = module.split(".")
    return ".".join(names[:2]) if names[0] == "scripts" and len(names) > 1 else names[0]


def imports(path):
    """Modules of the tree that a file imports, wherever in it, and the lines."""
    package = list(PurePosixPath(path.relative_to(ROOT).as_posix()).parent.parts)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found = [name.name for name in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join([*package[:len(package) - node.level + 1], base]).rstrip(".")
            # `from scripts import paths` names a module, `from scripts.paths import ROOT` does not.
            found = [f"{base}.{name.name}" for name in node.names] if base in (
                "scripts", "hdl") else [base]
        else:
            continue
        yield from ((name, node.lineno) for name in found if name.split(".")[0] in FIRST_PARTY)


def test_nothing_imports_upwards():
    wrong = []
    for path in FILES:
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        own = part_of(module)
        for name, line in imports(path):
            if part_of(name) != own and not any(
                    name == allowed or name.startswith(allowed + ".")
                    for allowed in MAY_IMPORT.get(own, ())):
                wrong.append(f"{path.relative_to(ROOT)}:{line} imports {name}")
    assert wrong == []


@pytest.mark.parametrize("part", ["hdl", "model", "calibration", "scripts"])
def test_functions_fit_a_look(part):
    long = [
        f"{path.relative_to(ROOT)}: {node.name}, {node.end_lineno - node.lineno + 1} lines"
        for path in FILES if path.is_relative_to(ROOT / part)
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.end_lineno - node.lineno >= LONGEST]
    assert long == []


def test_few_files_at_the_top_of_scripts():
    files = [path.name for path in (ROOT / "scripts").glob("*.py") if path.name != "__init__.py"]
    assert len(files) <= 4, files
