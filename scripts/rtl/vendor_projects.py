"""Projects of the whole design for ISE, Vivado and Libero."""

import contextlib
import io
import logging
from pathlib import Path
from string import Template

from scripts.rtl.blocks import TOP

__all__ = ["ISE", "LIBERO", "VIVADO", "edalize_project", "libero_project"]

TEMPLATES = Path(__file__).resolve().parent / "templates"
ISE = {"family": "virtex2p", "device": "xc2vp30", "package": "ff896", "speed": "-7"}
VIVADO = {"part": "xc7a100tcsg324-1"}
LIBERO = {
    "family": "ProASIC3", "die": "A3P1000", "package": "484 FBGA", "speed": "STD",
    "voltage": "1.5", "range": "COM",
}


def edalize_project(folder, tool, options):
    """Write a project with edalize, without any vendor tool."""
    from edalize.edatool import get_edatool

    folder.mkdir()
    logging.disable(logging.WARNING)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            get_edatool(tool)(work_root=str(folder), edam={
                "name": TOP.name, "toplevel": TOP.name, "parameters": {},
                "files": [{"name": f"../verilog/{TOP.name}.v", "file_type": "verilogSource"}],
                "tool_options": {tool: options},
            }).configure()
    finally:
        logging.disable(logging.NOTSET)


def libero_project(folder):
    """Write a Libero script; that of edalize has an absolute path and a flow for newer parts."""
    folder.mkdir()
    template = Template((TEMPLATES / "libero.tcl").read_text())
    (folder / f"{TOP.name}.tcl").write_text(template.substitute(
        LIBERO, name=TOP.name, source=f"../verilog/{TOP.name}.v"))
