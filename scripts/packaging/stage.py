"""The copy of the checkout that a wheel is built from, with all modules in one package.

``scripts/cyclope`` becomes ``cyclope/commands``, the rest of ``scripts`` stands at the top of
``cyclope``, the other packages stand beside it. Absolute imports are rewritten where the parser
finds them; what cannot be rewritten is refused.
"""

import ast
import re
import shutil
import tomllib

__all__ = ["rewrite", "stage"]

#: Packages of the checkout, and their names in the wheel.
_PACKAGES = {
    "hdl": "cyclope.hdl", "model": "cyclope.model", "calibration": "cyclope.calibration",
    "scripts.cyclope": "cyclope.commands", "scripts": "cyclope",
}
#: What only works in a checkout.
_LEFT_OUT = (
    "scripts/demo.py", "scripts/packaging", "scripts/rtl/readme_tables.py",
    "scripts/rtl/report.py", "scripts/rtl/size.py",
    "scripts/setup.py",
)


def _moved(module):
    """The name in the wheel of a module of the checkout; None for other modules."""
    for package, moved in _PACKAGES.items():
        if f"{module}.".startswith(f"{package}."):
            return moved + module[len(package):]
    return None


def _from(node):
    """Old and new text of a ``from ... import``."""
    moved = _moved(node.module)
    for alias in node.names:
        if _moved(f"{node.module}.{alias.name}") != f"{moved}.{alias.name}":
            raise SyntaxError(f"line {node.lineno}: {alias.name} has another name in the wheel; "
                              "import what is inside it")
    return f"from {node.module} import", f"from {moved} import"


def _import(alias):
    """Old and new text of a module in an ``import``."""
    moved = _moved(alias.name)
    if alias.asname:
        return alias.name, moved
    if moved.rpartition(".")[2] == alias.name:
        return alias.name, f"{moved} as {alias.name}"
    raise SyntaxError(f"line {alias.lineno}: `import {alias.name}` needs an `as`, the module has "
                      "another name in the wheel")


def rewrite(source, modules=()):
    """Python text with the imports of the wheel.

    Parameters
    ----------
    source : :class:`str`
        Text with the imports of the checkout.
    modules : collection of :class:`str`
        All modules of the checkout.

    Raises
    ------
    SyntaxError
        If an import, or a string that is a module's name, cannot be rewritten.
    """
    edits = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and not node.level and _moved(node.module):
            edits.append((node.lineno, node.col_offset, *_from(node)))
        elif isinstance(node, ast.Import):
            edits += [(alias.lineno, alias.col_offset, *_import(alias))
                      for alias in node.names if _moved(alias.name)]
        elif isinstance(node, ast.Constant) and "." in str(node.value) and node.value in modules:
            raise SyntaxError(f"line {node.lineno}: '{node.value}' has another name in the wheel; "
                              "make it of __package__")
    lines = source.encode().splitlines(keepends=True)
    for number, column, *texts in sorted(edits, reverse=True):
        old, new = map(str.encode, texts)
        line = lines[number - 1]
        if not line.startswith(old, column):
            raise SyntaxError(f"line {number}: write {texts[0]!r} on one line")
        lines[number - 1] = line[:column] + new + line[column + len(old):]
    return b"".join(lines).decode()


def stage(root, folder):
    """Write the project that a wheel is built from.

    Parameters
    ----------
    root : :class:`pathlib.Path`
        The checkout, or an unpacked source distribution.
    folder : :class:`pathlib.Path`
        Where to; an empty folder.

    Raises
    ------
    SyntaxError
        If a module cannot be rewritten.
    FileNotFoundError
        If something that is to be left out is not there: it has another name, perhaps.
    """
    project = (root / "pyproject.toml").read_text()
    patterns = ["*.py", *tomllib.loads(project)["tool"]["setuptools"]["package-data"]["*"]]
    files = {path for package in _PACKAGES if "." not in package
             for pattern in patterns for path in (root / package).rglob(pattern)}
    for name in _LEFT_OUT:
        path = root / name
        path.stat()
        files -= {path, *path.rglob("*")}
    modules = {".".join(path.relative_to(root).with_suffix("").parts) for path in files}
    for path in files:
        package = ".".join(path.relative_to(root).parent.parts)
        target = folder.joinpath(*_moved(package).split("."), path.name)
        target.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix != ".py":
            shutil.copy(path, target)
            continue
        try:
            target.write_text(rewrite(path.read_text(), modules))
        except SyntaxError as error:
            raise SyntaxError(f"{path.relative_to(root)}, {error}") from None
    for name in ("LICENSE", "README.md"):
        shutil.copy(root / name, folder)
    (folder / "pyproject.toml").write_text(re.sub(
        r'"(scripts\.[\w.]+)(:\w+")', lambda match: f'"{_moved(match[1])}{match[2]}', project))
