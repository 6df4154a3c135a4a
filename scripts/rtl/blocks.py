"""The list of all blocks, for export, sizes, lint and tests."""

import inspect
import re
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from amaranth.lib import wiring

import hdl
from hdl.config import PRESETS
from scripts.paths import HDL

__all__ = ["BLOCKS", "TOP", "UNITS", "VARIANTS", "Block", "find", "present"]

#: Folders of ``hdl/``, in the order in which data flows.
UNITS = ("acquisition", "preprocessing", "stereo", "link", "display", "common")


@dataclass(frozen=True)
class Block:
    """A component of the design under its file's stem.

    Parameters
    ----------
    name : :class:`str`
        Stem of the file, name of the Verilog module and of the VHDL entity. For a variant a comma
        and its preset follow.
    unit : :class:`str`
        Folder below ``hdl/``; empty for the top.
    """

    name: str
    unit: str

    @property
    def stem(self):
        """Stem of the file."""
        return self.name.partition(",")[0]

    @property
    def preset(self):
        """Preset of the block unless another is given."""
        variant = self.name.partition(", ")[2]
        return variant or ("paper" if self.name.startswith("paper") else "capsule")

    @property
    def source(self):
        """Path of the Amaranth file."""
        return HDL / self.unit / f"{self.stem}.py"

    @property
    def twin(self):
        """Path of the hand-written VHDL twin, or None."""
        path = self.source.with_suffix(".vhd")
        return path if path.exists() else None

    @property
    def component_class(self):
        """The first component in the ``__all__`` of the file."""
        module = import_module(".".join(filter(None, (hdl.__name__, self.unit, self.stem))))
        for name in module.__all__:
            value = getattr(module, name)
            if isinstance(value, type) and issubclass(value, wiring.Component):
                return value
        raise LookupError(f"{self.source.relative_to(HDL.parent)} has no public component")

    def arguments(self, config):
        """Constructor arguments for ``config``, matched by name; others keep their defaults."""
        choices = {
            "config": config, "width": config.width, "height": config.height,
            "beams": config.beams, "lanes": config.lanes, "spot_depth": config.spot_depth,
            "clock_hz": config.clock_hz, "baud": config.baud, "preset": config.preset,
            "labels": config.labels,
        }
        if self.name == "spot_queue":
            choices["depth"] = config.spot_depth
        if self.name == "binarise":
            choices["pixel_bits"] = 8
        wanted = inspect.signature(self.component_class).parameters
        return {name: value for name, value in choices.items() if name in wanted}

    def component(self, config=None):
        """A new component, as in the design of ``config``; that of its preset by default."""
        return self.component_class(**self.arguments(config or PRESETS[self.preset]))


#: Every block, in the order in which data flows.
BLOCKS = tuple(Block(name, unit) for unit, names in {
    "acquisition": "sequencer exposure laser_guard camera addressed_camera frame_gate image_bank "
                   "frame_banks frame_memory sram_frames",
    "preprocessing": "background noise hysteresis histogram threshold remap binarise erosion "
                     "labelling label_joiner component_sums two_pass_labelling spot_queue centre",
    "stereo": "undistort epipolar depth",
    "link": "point_limiter points texture scheduler framer uart_tx transmitter uart_rx receiver "
            "registers capture_timer reply_fields table_access commands",
    "display": "overlay vga",
    "common": "table_memory stage point_fifo sram activity",
}.items() for name in names.split())
#: Blocks whose ports are different in a second preset. They are proved and checked too, but are not
#: exported.
VARIANTS = (Block("table_access, paper", "link"), Block("commands, paper", "link"))
#: The whole design.
TOP = Block("instrument", "")
#: Designs made of other blocks, each of which has its own bench and proofs.
ASSEMBLIES = (
    Block("front_end", "acquisition"), Block("point_link", "link"),
    *(Block(name, "") for name in (
        "reconstruction", "capsule_points", "capsule", "paper_points", "paper")), TOP)


def present():
    """Blocks that have a file: the listed ones, then any others, then the assemblies."""
    unlisted = (
        Block(file.stem, unit) for unit in UNITS
        for file in sorted((HDL / unit).glob("[a-z]*.py"))
        if "(wiring.Component)" in file.read_text())
    listed = dict.fromkeys((*BLOCKS, *unlisted, *ASSEMBLIES))
    return tuple(block for block in listed if block.source.exists())


def find(name):
    """The block called ``name``, which may also be the path of its file.

    Raises
    ------
    LookupError
        If there is none.
    """
    stem = re.sub(r"\.\w+$", "", Path(name).name)
    for block in present():
        if block.name == stem:
            return block
    names = ", ".join(block.name for block in present())
    raise LookupError(f"There is no block {name!r}; there are: {names or 'none'}.")
