"""Which files of the repository a test module depends on, and a hash of all that it depends on.

Found in the sources, without running them, and rather too many than too few:

- what a file imports, anywhere in it, and the packages that lead there;
- modules whose dotted names stand in its strings, as benches are named, and code for ``python -c``;
- Python files whose names stand in its strings;
- where it looks for files or modules by itself (``glob``, ``import_module``, ``exec``, half a
  module's name, ...), all Python of the repository but other tests;
- where a file of ``tb`` starts processes, all of the repository but other tests;
- the ``conftest.py`` of its folders;
- every file that is neither Python nor a document; documents where a string names one.

To these come the versions of Python, of all packages and of the simulators, and the environment
variables that tests look at.
"""

import ast
import functools
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
from importlib.metadata import distributions

__all__ = ["PACKAGES", "Dependencies", "tools"]

#: Packages of the repository.
PACKAGES = ("hdl", "model", "calibration", "scripts", "tb")
#: Folders of what is built, and of no concern.
_LEFT_OUT = {".git", ".venv", "build", "out", "__pycache__", ".pytest_cache", ".ruff_cache"}
_DOCUMENTS = (".md", ".png", "LICENSE", ".gitignore", ".editorconfig", "durations.txt")
#: Names of what finds files or modules that no import tells of.
_SEARCHES = {"import_module", "__import__", "glob", "rglob", "iterdir", "listdir", "scandir",
             "walk", "walk_packages", "iter_modules", "exec", "eval", "runpy", "run_path",
             "spec_from_file_location"}
_PROCESSES = {"subprocess", "Popen", "system", "popen", "spawnv", "multiprocessing"}
#: Their processes are simulators, provers and compilers, which get what they read from them, and
#: they look for files in folders of what is built or of what a user has only; and this file.
_KNOWN = {"tb/hdlsim.py", "tb/formal/symbiyosys.py", "scripts/simulation/compiler.py",
          "tb/dependencies.py", "calibration/capture.py", "calibration/files.py",
          "scripts/results/frames.py", "scripts/results/measurement.py",
          "scripts/results/outputs.py", "scripts/simulation/spot_engine.py"}
#: The folder within which a file looks for Python.
_WITHIN = {"scripts/simulation/sources.py": "hdl/",
           # and in model/optics/, which it imports all of
           "scripts/simulation/live_rig.py": "calibration/"}
_MODULE = re.compile(rf"\b(?:{'|'.join(PACKAGES)})(?:\.\w+)+")
#: The beginning of a module's name, to which something is added.
_PART = re.compile(rf"\b(?:{'|'.join(PACKAGES)})(?:\.\w+)*\.(?:\w+_)?$")
_FILE = re.compile(r"[\w-]+\.\w+")
_VARIABLES = ("CI", "WAVES", "PYTHONHASHSEED", "CXX", "CXXFLAGS")


def _is_test(name):
    return name.rpartition("/")[2].startswith("test_")


class _Facts(ast.NodeVisitor):
    """What one Python file says: modules and files that it names, and whether it searches."""

    def __init__(self, package):
        self.package = package
        self.modules, self.files = set(), set()
        self.searches = self.starts = False

    def visit_Import(self, node):  # noqa: N802
        for each in node.names:
            self.modules.add(each.name)
            self._name(each.name.partition(".")[0])

    def visit_ImportFrom(self, node):  # noqa: N802
        base = node.module or ""
        if node.level:
            above = self.package[:len(self.package) - node.level + 1]
            base = ".".join([*above, *filter(None, [base])])
        self.modules |= {base, *(f"{base}.{each.name}" for each in node.names)}
        self._name(base)
        for each in node.names:
            self._name(each.name)

    def visit_Expr(self, node):  # noqa: N802
        if not (isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)):
            self.generic_visit(node)  # all but docstrings

    def visit_Constant(self, node):  # noqa: N802
        if isinstance(node.value, str):
            self.modules.update(_MODULE.findall(node.value))
            self.files.update(_FILE.findall(node.value))
            self.searches |= bool(_PART.search(node.value))

    def visit_Name(self, node):  # noqa: N802
        self._name(node.id)

    def visit_Attribute(self, node):  # noqa: N802
        self._name(node.attr)
        self.generic_visit(node)

    def _name(self, name):
        self.searches |= name in _SEARCHES
        self.starts |= name in _PROCESSES


@functools.cache
def tools():
    """Versions of all that runs the tests, and what the environment asks of them."""
    found = [sys.version, platform.platform()]
    for program in ("ghdl", "c++", "verilator"):
        path = shutil.which(program)
        answer = path and subprocess.run([path, "--version"], capture_output=True, text=True).stdout
        found.append(f"{program} {answer}")
    found += sorted(f"{each.metadata['Name']} {each.version}" for each in distributions())
    found += [f"{name}={os.environ.get(name)}" for name in _VARIABLES]
    found += sorted(f"{name}={value}" for name, value in os.environ.items()
                    if name.startswith("CYCLOPE_"))
    return "\n".join(found)


class Dependencies:
    """The files below a root, and what depends on which; they are read once.

    Parameters
    ----------
    root : :class:`pathlib.Path`
        The checkout.
    tools : :class:`str`
        What else keys depend on.
    """

    def __init__(self, root, tools=""):
        self.root, self._tools = root, tools
        self.names = []
        for folder, folders, files in os.walk(root):
            folders[:] = sorted(set(folders) - _LEFT_OUT)
            within = os.path.relpath(folder, root).replace(os.sep, "/")
            self.names += sorted(name if within == "." else f"{within}/{name}" for name in files)
        self._known = set(self.names)
        self._python = [name for name in self.names if name.endswith(".py")]
        self._others = {name for name in self._python if not _is_test(name)}
        self._always = {
            name for name in self.names if not name.endswith((".py", *_DOCUMENTS))}
        self._by_name = {}
        for name in self._python:
            self._by_name.setdefault(name.rpartition("/")[2], []).append(name)
        self._needs = {}

    def of(self, test):
        """Names of all files, from the root, that the test file ``test`` depends on."""
        waiting, found = [test, *self._conftests(test)], set(self._always)
        while waiting:
            name = waiting.pop()
            if name not in found:
                found.add(name)
                waiting += self._direct(name)
        return sorted(found)

    def key(self, test):
        """Hash of the files of :meth:`of`, their names and the tools, in hexadecimal."""
        digest = hashlib.sha256(self._tools.encode())
        for name in self.of(test):
            digest.update(f"\0{name}\0{self._digest(name)}".encode())
        return digest.hexdigest()

    def newest(self, test):
        """When the youngest of the files was written, in seconds of the system's clock."""
        return max((self.root / name).stat().st_mtime for name in self.of(test))

    def tests(self):
        """Names of all test files."""
        return [name for name in self._python if _is_test(name)]

    def _conftests(self, test):
        parts = test.split("/")[:-1]
        folders = ["/".join(parts[:length]) for length in range(len(parts) + 1)]
        names = (f"{folder}/conftest.py".lstrip("/") for folder in folders)
        return [name for name in names if name in self._known]

    @functools.cache  # noqa: B019  (as long as this object, which is as long as a run)
    def _digest(self, name):
        return hashlib.sha256((self.root / name).read_bytes()).hexdigest()

    def _direct(self, name):
        if name not in self._needs:
            self._needs[name] = self._read(name) if name.endswith(".py") else ()
        return self._needs[name]

    def _read(self, name):
        facts = _Facts(name.split("/")[:-1])
        facts.visit(ast.parse((self.root / name).read_bytes(), name))
        needs = set()
        for module in facts.modules:
            parts = module.split(".")
            for length in range(1, len(parts) + 1):
                path = "/".join(parts[:length])
                needs |= {f"{path}.py", f"{path}/__init__.py"} & self._known
        if name in _KNOWN:
            return needs
        for file in facts.files:
            needs.update(self._by_name.get(file, ()))
            if file.endswith(_DOCUMENTS):
                needs.update(
                    each for each in self.names if each == file or each.endswith(f"/{file}"))
        if facts.searches:
            within = _WITHIN.get(name, "")
            needs |= {each for each in self._others if each.startswith(within)}
        if facts.starts and name.startswith("tb/"):
            needs |= self._others | {each for each in self.names if not each.endswith(".py")}
        return needs
