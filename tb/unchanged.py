"""Tests that passed before with the very same files and tools are not run again; long ones first.

A part of pytest's configuration, see ``tb/conftest.py``. What passes is written down under
``build/passed`` with the key of its file (:mod:`tb.dependencies`). With ``--skip-unchanged``, as
``make test`` has it, a test whose key is still the same is reported as *unchanged*, which counts as
passed. Never written down: what failed or was skipped, what is marked ``always_run``, and what
depends on a file that was written while the tests ran.
"""

import json
import os
import time
from pathlib import Path

import pytest

from tb.dependencies import Dependencies, tools

#: Seconds from which on a test is worth an early start; shorter ones stay in their order.
LONG = 4
#: Durations that a fresh clone begins with: lines of seconds and a test. The name is put together
#: here so that no test counts as changed when they are measured anew.
DURATIONS = Path(__file__).with_name("durations").with_suffix(".txt")
_KEY = pytest.StashKey()


def pytest_addoption(parser):
    group = parser.getgroup("cyclope")
    group.addoption("--skip-unchanged", action="store_true",
                    help="leave out tests that passed before with the same files and tools")
    group.addoption("--write-durations", action="store_true",
                    help=f"write {DURATIONS.name} anew from this run, for fresh clones")


def pytest_configure(config):
    config.addinivalue_line(
        "markers", "always_run: depends on more than the repository's files and its tools")
    worker = getattr(config, "workerinput", None)
    config.stash[_KEY] = ledger = (
        Ledger(config) if worker is None else _Known(worker["unchanged"]))
    config.pluginmanager.register(ledger)


class _Known:
    """What tells which tests are unchanged, and their order; in a worker of xdist, all there is."""

    def __init__(self, known):
        self.known = known

    def is_unchanged(self, item):
        return (self.known["skip"] and item.nodeid in self.known["passed"]
                and item.get_closest_marker("always_run") is None)

    def _rank(self, item):
        """Unchanged ones first, at no cost; then the longest; then as they stand in their files."""
        seconds = self.known["seconds"].get(item.nodeid, 0)
        return not self.is_unchanged(item), -seconds if seconds >= LONG else 0

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items):
        items.sort(key=self._rank)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item):
        if not self.is_unchanged(item):
            return None
        hook = item.ihook
        hook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        hook.pytest_runtest_logreport(report=pytest.TestReport(
            item.nodeid, item.location, {}, "passed", None, "call",
            user_properties=[("unchanged", True)]))
        hook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_makereport(self, item):
        outcome = yield
        outcome.get_result().recordable = item.get_closest_marker("always_run") is None


class Ledger(_Known):
    """What passed, by test file; in the process that hears of all results.

    Parameters
    ----------
    config : pytest's configuration
    """

    def __init__(self, config):
        self.begin = time.time()
        self.root, self.folder = config.rootpath, config.rootpath / "build" / "passed"
        self._write_durations = config.getoption("write_durations")
        self.keys, self._results = {}, {}
        files = Dependencies(self.root, tools())
        passed, seconds = [], dict(_durations())
        for test in files.tests():
            self.keys[test] = key = files.key(test)
            entry = self._read(test)
            seconds |= entry["seconds"]
            if entry["key"] == key:
                passed += entry["passed"]
        super().__init__({"skip": config.getoption("skip_unchanged"),
                          "passed": dict.fromkeys(passed, True), "seconds": seconds})

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node):
        node.workerinput["unchanged"] = self.known

    def pytest_report_teststatus(self, report):
        return ("unchanged", "u", "UNCHANGED") if _is_unchanged(report) else None

    def pytest_runtest_logreport(self, report):
        if _is_unchanged(report):
            return
        phases, seconds = self._results.setdefault(report.nodeid, ({}, []))
        phases[report.when] = (
            report.outcome if getattr(report, "recordable", False) else "not to be recorded")
        seconds.append(report.duration)

    def pytest_terminal_summary(self, terminalreporter):
        if "unchanged" in terminalreporter.stats:
            terminalreporter.write_line(
                "unchanged: passed before with the same files and tools; `make test FRESH=1` runs "
                "all of them")

    def pytest_sessionfinish(self):
        """Write down what passed, and strike out what did not."""
        now = Dependencies(self.root, tools())
        results = {}
        for nodeid, (phases, seconds) in self._results.items():
            good = phases == dict.fromkeys(("setup", "call", "teardown"), "passed")
            results.setdefault(nodeid.partition("::")[0], {})[nodeid] = good, round(sum(seconds), 2)
        for test, found in results.items():
            key = self.keys.get(test)
            kept = (key is not None and now.key(test) == key
                    and now.newest(test) < self.begin)
            entry = self._read(test)
            if entry["key"] != key:
                entry = {"key": key, "passed": [], "seconds": entry["seconds"]}
            good = {nodeid for nodeid, (passed, _) in found.items() if passed and kept}
            entry["passed"] = sorted((set(entry["passed"]) - set(found)) | good)
            entry["seconds"] |= {nodeid: seconds for nodeid, (_, seconds) in found.items()}
            self._write(test, entry)
        if self._write_durations:
            lines = sorted((f"{seconds:.0f} {nodeid}\n" for found in results.values()
                            for nodeid, (_, seconds) in found.items() if seconds >= LONG),
                           key=lambda line: (-int(line.split()[0]), line))
            DURATIONS.write_text("".join(lines))

    def _read(self, test):
        try:
            return json.loads(self._file(test).read_text())
        except (OSError, ValueError):
            return {"key": None, "passed": [], "seconds": {}}

    def _write(self, test, entry):
        file = self._file(test)
        file.parent.mkdir(parents=True, exist_ok=True)
        part = file.with_name(f"{file.name}.{os.getpid()}")
        part.write_text(json.dumps(entry))
        part.replace(file)

    def _file(self, test):
        return self.folder / f"{test.removesuffix('.py').replace('/', '.')}.json"


def _is_unchanged(report):
    """Of a test or, which has no such properties, of a file that cannot be collected."""
    return dict(getattr(report, "user_properties", ())).get("unchanged", False)


def _durations():
    if DURATIONS.exists():
        for line in DURATIONS.read_text().splitlines():
            seconds, nodeid = line.split(" ", 1)
            yield nodeid, float(seconds)
