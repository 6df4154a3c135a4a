"""Writes the folders of the flows: the design, tops for boards, constraints, projects, a page."""

from dataclasses import replace
from functools import lru_cache

from hdl.config import PRESETS
from hdl.instrument import Instrument
from model.errors import UserError
from scripts.rtl.blocks import TOP
from scripts.rtl.flows import projects
from scripts.rtl.flows.board_top import board_top
from scripts.rtl.flows.parts import BOARDS, FLOWS, PARTS, boards_of, lacks, lacks_bits
from scripts.rtl.flows.readme import page
from scripts.rtl.synthesis import synthesise
from scripts.rtl.timing import mark_registers, plan
from scripts.rtl.verilog import memory_bits, ports, verilog

__all__ = ["Flow", "TooSmallError", "choose", "describe", "design", "prepare"]

_PROJECTS = {"xilinx-ise": projects.ise, "xilinx-vivado": projects.vivado,
             "libero": projects.libero, "lattice-ecp5": projects.ecp5}


class TooSmallError(UserError):
    """No part of a flow has room for the design."""


def choose(preset="capsule", size=None, beams=None, lanes=None):
    """The configuration with these choices, and the preset's own for the others.

    Raises
    ------
    UserError
        If they are out of range.
    """
    if preset not in PRESETS:
        raise UserError(f"There is no preset {preset!r}; there are {', '.join(PRESETS)}.")
    base = PRESETS[preset]
    width, height = size or (base.width, base.height)
    beams = beams or base.beams
    try:
        return replace(base, width=width, height=height, beams=beams,
                       lanes=lanes or min(base.lanes, beams))
    except ValueError as error:
        raise UserError(f"The design cannot be made: {error}.") from error


def describe(config):
    """The choices of a configuration in a line."""
    return (f"Preset {config.preset}: {config.width} x {config.height} pixels, {config.beams} "
            f"beams on {config.lanes} lanes, system clock {config.clock_hz / 1e6:g} MHz")


@lru_cache(maxsize=4)
def design(config, make=Instrument):
    """The design of a configuration, its Verilog, and what it needs of timing."""
    component = make(config)
    text = verilog(component, TOP.name)
    return component, text, plan(make(config), text, TOP.name)


class Flow:
    """A flow that is ready to be written.

    Parameters
    ----------
    name : :class:`str`
        Of :data:`.parts.FLOWS`.
    files : dict of :class:`str` to :class:`str`
        Texts by path in the flow's folder.
    left_out : list of :class:`str`
        A sentence for each part that is too small.
    """

    def __init__(self, name, files, left_out):
        self.name, self.files, self.left_out = name, files, left_out

    def write(self, folder):
        """Write the files."""
        for path, text in self.files.items():
            file = folder / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)


def prepare(name, config, part=None, make=Instrument, count=synthesise):
    """The :class:`Flow` called ``name`` for a configuration.

    Parameters
    ----------
    part : :class:`str`, optional
        The only part to write files for.
    make : callable
        Gives the design of a configuration.
    count : callable
        Gives the resources that a Verilog text and its top use in a family of parts.

    Raises
    ------
    TooSmallError
        If the design fits none of its parts.
    UserError
        If a path between clocks is not known to be safe, or there is no such part.
    """
    boards = boards_of(name, part)
    if not boards:
        known = ", ".join(dict.fromkeys(board.part for board in BOARDS[name]))
        raise UserError(f"The flow {name} has no part {part!r}; it has {known}.")
    config = replace(config, clock_hz=FLOWS[name])
    _, text, timing = design(config, make)
    found = ports(text, TOP.name)
    bits = memory_bits(text)
    short = {board.name: lacks_bits(PARTS[board.part], bits) for board in boards}
    used = {family: count(text, TOP.name, family) for family in dict.fromkeys(
        PARTS[board.part].family for board in boards if not short[board.name])}
    short |= {board.name: lacks(PARTS[board.part], used[PARTS[board.part].family])
              for board in boards if not short[board.name]}
    left_out = list(dict.fromkeys(filter(None, short.values())))
    fitting = [board for board in boards if not short[board.name]]
    if not fitting:
        raise TooSmallError(f"{describe(config)} fits no part of {name}: {'; '.join(left_out)}.")
    files = {f"rtl/{TOP.name}.v": mark_registers(text, TOP.name, timing)}
    shares = {}
    for board in fitting:
        sources = [f"rtl/{TOP.name}.v", f"rtl/{board.name}.v"]
        files[sources[1]] = board_top(board, found, timing, TOP.name)
        files |= _PROJECTS[name](board, found, timing, sources)
        chip = PARTS[board.part]
        shares[board.name] = {
            resource: chip.share(resource, used[chip.family][resource])
            for resource in chip.capacity
            if chip.capacity[resource] and resource in used[chip.family]}
    files["README.md"] = page(name, fitting, describe(config), shares, left_out, timing)
    return Flow(name, files, left_out)
