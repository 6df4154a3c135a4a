"""Verilog of a block, with port names that VHDL can also spell."""

import gc
import re
from contextlib import contextmanager

from amaranth._toolchain.yosys import find_yosys
from amaranth.back import rtlil
from amaranth.hdl import Const, ValueCastable
from amaranth.lib import wiring

__all__ = ["flat_ports", "rtlil_to_verilog", "to_fast_verilog", "to_rtlil", "to_verilog"]

VHDL_RESERVED = frozenset("""
abs access after alias all and architecture array assert attribute begin block body buffer bus case
component configuration constant disconnect downto else elsif end entity exit file for function
generate generic group guarded if impure in inertial inout is label library linkage literal loop
map mod nand new next nor not null of on open or others out package port postponed procedure
process pure range record register reject rem report return rol ror select severity shared signal
sla sll sra srl subtype then to transport type unaffected units until use variable wait when while
with xnor xor
""".split())
SV_RESERVED = frozenset("""
always assign automatic begin bit break byte case cell checker class clocking config const
constraint context continue cover cross default design do edge else end endcase enum event expect
export extends extern final first_match for force forever fork function generate genvar global if
import initial inout input inside instance int integer interface intersect join large local logic
longint matches medium module negedge new null output package packed parameter posedge primitive
priority program property protected pure rand ref reg release repeat return scalared sequence
shortint signed small solve static string strong struct super supply0 supply1 table tagged task
this time tri type typedef union unique unsigned use var vectored virtual void wait wand weak while
wildcard wire with within wor
""".split())
#: Attributes that Amaranth adds for its own simulator and debuggers.
_INTERNAL = "-remove generator -remove top -remove src " \
            "-remove amaranth.hierarchy -remove amaranth.decoding"
LEGAL = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


def flat_ports(component):
    """Map port names, joined with one underscore, to the signals of ``component``.

    Members that are constants (always_ready, always_valid) have no port.

    Raises
    ------
    NameError
        If a name is not legal in both VHDL and SystemVerilog, or is made by two members.
    """
    ports = {}
    for path, member, value in component.signature.flatten(component):
        value = value.as_value() if isinstance(value, ValueCastable) else value
        if isinstance(value, Const):
            continue
        name = "_".join(map(str, path))
        if not LEGAL.fullmatch(name) or name in VHDL_RESERVED | SV_RESERVED:
            raise NameError(f"Port {name!r} is not a legal name in both VHDL and SystemVerilog")
        if name in ports:
            raise NameError(f"Port {name!r} is made by two members")
        direction = "i" if member.flow == wiring.In else "o"
        ports[name] = (value, direction)
    return ports


@contextmanager
def _collector_off():
    """Without Python's garbage collector, which would take nearly half of the time: Amaranth makes
    millions of small objects that are all in use until the end."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def to_rtlil(component, name):
    """RTLIL of ``component`` as module ``name``, ports named as :func:`flat_ports` does.

    Raises
    ------
    NameError
        If the block shares its name with one of its ports, which VHDL does not allow.
    """
    with _collector_off():
        return rtlil.convert(component, name=name, ports=_named_ports(component, name),
                             emit_src=False)


def rtlil_to_verilog(text):
    """Verilog of the RTLIL ``text``, by yosys, as :func:`amaranth.back.verilog.convert` does it."""
    return _yosys(text, "proc -nomux -norom; memory_collect",
                  *(f"attrmap {option}{_INTERNAL}" for option in ("", "-modattr ")),
                  "write_verilog -norename")


def to_verilog(component, name):
    """Verilog text of ``component`` as module ``name``, ports named as :func:`flat_ports` does.

    Raises
    ------
    NameError
        If the block shares its name with one of its ports, which VHDL does not allow.
    """
    return rtlil_to_verilog(to_rtlil(component, name))


def to_fast_verilog(component, name):
    """Flat, optimised Verilog of ``component``, which simulates about twice as fast.

    Amaranth writes every next state as a process of its own; sharing and simplifying their logic
    leaves the simulator less to do in each clock. Ports are those of :func:`to_verilog`.
    """
    return _yosys(to_rtlil(component, name),
                  "proc; flatten; opt -full; memory_collect; opt_mem; opt_clean",
                  "write_verilog -noattr")


def _yosys(text, *commands):
    """What yosys writes after these commands, given a design in RTLIL."""
    yosys = find_yosys(lambda version: version >= (0, 40))
    return yosys.run(["-q", "-"], "\n".join((
        f"read_rtlil <<rtlil\n{text}\nrtlil", *commands, "")), ignore_warnings=True)


def _named_ports(component, name):
    ports = flat_ports(component)
    if name in ports:
        raise NameError(f"Block {name!r} shares its name with one of its ports")
    return {port: (value, None) for port, (value, _) in ports.items()}
