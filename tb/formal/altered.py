"""Modules of the design with planted faults."""

import sys
import types

from scripts.paths import ROOT

__all__ = ["altered"]


def altered(name, edits):
    """The module ``name`` with ``edits`` in its text: pairs of what is there and what is instead.

    Raises
    ------
    LookupError
        If a text is not there, or more than once.
    """
    file = ROOT.joinpath(*name.split(".")).with_suffix(".py")
    text = file.read_text()
    for old, new in edits:
        if text.count(old) != 1:
            raise LookupError(f"The text {old!r} stands {text.count(old)} times in {file.name}, "
                              "not once")
        text = text.replace(old, new)
    module = types.ModuleType(f"{name}_altered")
    module.__package__ = name.rpartition(".")[0]
    sys.modules[module.__name__] = module  # where a dataclass or an enumeration looks itself up
    exec(compile(text, str(file), "exec"), module.__dict__)
    return module
